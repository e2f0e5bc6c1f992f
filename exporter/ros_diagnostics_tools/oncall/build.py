"""An Alertmanager configuration and duties -> the same configuration with the people on call.

Every duty becomes a receiver and a route of its own, active in one time interval. Its own, because
Alertmanager remembers for `--data.retention` what a receiver was sent: a person who comes back
within that time would not get a fault that had ended meanwhile and begins again.

It works on YAML's nodes and leaves open what a word means (`no`, `17:00`), so that everything else
in the configuration stays as it is written.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import yaml

from ros_diagnostics_exporter import durations
from ros_diagnostics_exporter.config.errors import ConfigError, Finding, quoted
from ros_diagnostics_tools.oncall.file import Level, OnCall, Person
from ros_diagnostics_tools.oncall.rota import Duty
from ros_diagnostics_tools.yaml_nodes import get, items, made, scalar

_DAY = timedelta(days=1)
_MINUTE = timedelta(minutes=1)
_GROUP_INTERVAL = 300.0  # seconds; Alertmanager's default
_SLACK = 10.0  # seconds, by which a group may be late
_BUILT = "on call until "

Duties = Mapping[Level, Sequence[Duty]]


def build(oncall: OnCall, duties: Duties, base: Path, until: datetime, header: str) -> str:
    """The configuration in ``base`` with the people on call, as YAML.

    Args:
        oncall: The file.
        duties: Who is on call at each level, without gaps.
        base: alertmanager.yml; each route to a level's receiver is replaced.
        until: Where the duties end; from then on all people of a level are notified.
        header: Lines of comment for the beginning.

    Raises:
        ConfigError: the configuration cannot be read, or does not fit oncall.yml.
    """
    site = _fitting(oncall, base)
    horizon = _BUILT + until.isoformat()
    overlap = site.overlap({level.receiver for level in oncall.levels})
    for level in oncall.levels:
        site.add("receivers", *_receivers(level, duties[level], oncall.people, site))
        site.add("time_intervals", *_intervals(level, duties[level], overlap))
    for receiver, levels in _by_receiver(oncall.levels).items():
        routes = [_route(level, duties[level], horizon) for level in levels]
        for node, _ in site.routes_to(receiver):
            node.flow_style = False
            node.value.append((made("routes"), made(routes)))
        if receiver not in site.receivers:  # of the routes' parents, which send nothing themselves
            site.add("receivers", made({"name": receiver}))
    begin = min(duty.start for each in duties.values() for duty in each)
    site.add("time_intervals", _interval(horizon, begin, until))
    text: str = yaml.serialize(site.root, Dumper=yaml.BaseDumper, allow_unicode=True, width=10_000)
    return f"{header}\n{text}"


def check(oncall: OnCall, base: Path) -> list[Finding]:
    """What to be warned of where the two are built together.

    Raises:
        ConfigError: they cannot be; see `build`.
    """
    site = _fitting(oncall, base)
    return [*site.taken_away({level.receiver for level in oncall.levels})]


def _fitting(oncall: OnCall, base: Path) -> _Configuration:
    site = _Configuration(base)
    if problems := [*_misfits(oncall, site)]:
        raise ConfigError(problems)
    return site


def built_until(content: str) -> datetime | None:
    """Where the duties of a built configuration end; None if it is not one, or is damaged."""
    try:
        intervals = yaml.safe_load(content)["time_intervals"]
        names = [each["name"] for each in intervals if each["name"].startswith(_BUILT)]
        return datetime.fromisoformat(names[0].removeprefix(_BUILT))
    except (yaml.YAMLError, LookupError, TypeError, AttributeError, ValueError):
        return None


def hours(start: datetime, end: datetime) -> list[dict[str, Any]]:
    """The time from ``start`` until ``end``, both UTC, as Alertmanager's time intervals have it.

    Their fields repeat (days of a month, hours of a day), so every piece names year and month. UTC
    is their default: no clock change and no table of time zones is between rota and Alertmanager.
    """
    found = []
    while start < end:
        midnight = start.replace(hour=0, minute=0)
        if start > midnight or end - start < _DAY:
            stop = min(end, midnight + _DAY)
            to = f"{stop:%H:%M}" if stop < midnight + _DAY else "24:00"
            piece = {"times": [{"start_time": f"{start:%H:%M}", "end_time": to}]}
            last = start
        else:
            next_month = (start.replace(day=1) + 31 * _DAY).replace(day=1)
            stop = min(end.replace(hour=0, minute=0), next_month)
            piece, last = {}, stop - _DAY
        date = {
            "years": [f"{start.year}"],
            "months": [f"{start.month}"],
            "days_of_month": [f"{start.day}:{last.day}"],
        }
        found.append({**date, **piece})
        start = stop
    return found


def _by_receiver(levels: Iterable[Level]) -> dict[str, list[Level]]:
    found: dict[str, list[Level]] = {}
    for level in levels:
        found.setdefault(level.receiver, []).append(level)
    return found


def _name(level: Level, duty: Duty) -> str:
    """The name of a duty's receiver and time interval; the same whenever it is built."""
    return f"on-call/{level.title}/{duty.start:%Y-%m-%dT%H:%MZ}/{duty.person}"


def _everybody(level: Level) -> str:
    return f"on-call/{level.title}/everybody"


def _route(level: Level, duties: Sequence[Duty], horizon: str) -> dict[str, Any]:
    """A route with one below it for each duty, and one for the time after the last."""
    each = [
        {"receiver": name, "active_time_intervals": [name], "continue": True}
        for name in (_name(level, duty) for duty in duties)
    ]
    after = {"receiver": _everybody(level), "mute_time_intervals": [horizon]}
    matchers = {"matchers": list(level.matchers)} if level.matchers else {}
    return {"receiver": _everybody(level), **matchers, "routes": [*each, after]}


def _intervals(level: Level, duties: Sequence[Duty], overlap: timedelta) -> Iterator[yaml.Node]:
    for duty in duties:
        yield _interval(_name(level, duty), duty.start, duty.end + overlap)


def _interval(name: str, start: datetime, end: datetime) -> yaml.Node:
    found: yaml.Node = made({"name": name, "time_intervals": hours(start, end)})
    for piece in items(get(found, "time_intervals")):
        piece.flow_style = True  # in one line
    return found


def _receivers(
    level: Level, duties: Sequence[Duty], people: Mapping[str, Person], site: _Configuration
) -> Iterator[yaml.Node]:
    """A receiver for each duty, and one with everybody, like those that the level names."""
    like = [pair for name in level.like for pair in _integrations(site.receivers[name])]
    addressed = {_name(level, duty): [people[duty.person]] for duty in duties}
    addressed[_everybody(level)] = [people[name] for name in level.people()]
    for name, persons in addressed.items():
        receiver = made({"name": name})
        receiver.value += _addressed(like, persons)
        receiver.flow_style = False
        yield receiver


_Pairs = list[tuple[yaml.Node, yaml.Node]]
# The integrations that have an address of a person, and the key that has it.
_TO = {"email_configs": "to", "sns_configs": "phone_number"}
# Of the exporter, where a webhook records notifications and reaches nobody.
_RECORDS = "/api/v1/notifications"


def _integrations(receiver: yaml.Node) -> _Pairs:
    """`email_configs` and so on, with their lists."""
    return [(key, value) for key, value in receiver.value if scalar(key) != "name"]


def _addressed(like: _Pairs, people: Sequence[Person]) -> _Pairs:
    """The integrations with these people's addresses; without those that reach none of them.

    Integrations that have no address of a person (a chat, a webhook) are copied as they are, but
    those that record notifications only once each.
    """
    found: dict[str, yaml.SequenceNode] = {}
    recorded: set[str] = set()
    for key, configs in like:
        kind = scalar(key)
        into = found.setdefault(kind, made([]))
        into.flow_style = False
        for config in items(configs):
            url = _record_url(config)
            if not url or url not in recorded:
                into.value += _copies(config, kind, people)
            recorded.add(url)
    return [(made(kind), configs) for kind, configs in found.items() if configs.value]


def _record_url(config: yaml.Node) -> str:
    """The URL of a webhook that records notifications; "" for all other integrations."""
    urls = (scalar(value) for key, value in config.value if scalar(key) == "url")
    return next((url for url in urls if url.endswith(_RECORDS)), "")


def _copies(config: yaml.Node, kind: str, people: Sequence[Person]) -> list[yaml.Node]:
    """One mail to all of them, or one text message for each."""
    if kind == "email_configs":
        emails = [person.email for person in people if person.email]
        return [_with(config, _TO[kind], ", ".join(emails))] if emails else []
    if kind == "sns_configs":
        return [_with(config, _TO[kind], person.phone) for person in people if person.phone]
    return [copy.deepcopy(config)]


def _misfits(oncall: OnCall, site: _Configuration) -> Iterator[Finding]:
    """What of oncall.yml does not fit the configuration, or the other way round."""
    for level in oncall.levels:
        like = [name for name in level.like if name in site.receivers]
        for name in set(level.like) - set(like):
            what = f"{site.path.name} has no receiver {quoted(name)}"
            remedy = "name receivers to copy in like, such as like: [email]"
            yield oncall.document.problem(level.place, what, remedy)
        pairs = [
            (kind, configs)
            for name in like
            for kind, configs in _integrations(site.receivers[name])
            if not all(map(_record_url, items(configs)))
        ]
        kinds = [scalar(kind) for kind, _ in pairs]
        if like and not pairs:
            what = f"the receiver {' and '.join(like)} of {site.path.name} sends nothing"
            remedy = "name receivers to copy in like, such as like: [email]"
            yield oncall.document.problem(level.place, what, remedy)
        for name in level.everybody():
            if pairs and not _addressed(pairs, [oncall.people[name]]):
                what = f"{quoted(name)} cannot be reached by {' or '.join(kinds)} of {level.title}"
                remedy = "add the person's email or phone"
                yield oncall.document.problem(("people", name), what, remedy)
        yield from _route_misfits(oncall, level, site)


def _route_misfits(oncall: OnCall, level: Level, site: _Configuration) -> Iterator[Finding]:
    routes = site.routes_to(level.receiver)
    if not routes:
        what = f"no route of {site.path.name} has the receiver {quoted(level.receiver)}"
        remedy = "add one, such as {matchers: [severity = critical], receiver: %s, continue: true}"
        place = (*level.place, "receiver")
        yield oncall.document.problem(place, what, remedy % level.receiver)
    for node, _ in routes:
        for key in ("routes", "active_time_intervals", "mute_time_intervals"):
            if (own := get(node, key)) is not None:
                what = f"{quoted(key)} is not possible in the route to {quoted(level.receiver)}"
                remedy = (
                    _BELOW
                    if key == "routes" and items(own)
                    else "remove it: hours are in oncall.yml"
                )
                yield Finding(site.path, own.start_mark.line + 1, "route", what, remedy)


_BELOW = (
    "add {matchers: [severity = critical], receiver: on-call, continue: true} as its first one, "
    "and give the level receiver: on-call and the receivers to copy in like"
)


class _Configuration:
    """An Alertmanager configuration, as YAML's nodes."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.root = _compose(path)
        self.receivers = {scalar(get(r, "name")): r for r in items(get(self.root, "receivers"))}
        # All routes but the root, each with the group_interval (seconds) that applies to it.
        try:
            self._routes = [*_below(get(self.root, "route"), _GROUP_INTERVAL)]
        except ValueError as error:  # a group_interval
            what, remedy = str(error), "write it like 5s or 1m30s"
            raise ConfigError([Finding(path, None, "route", what, remedy)]) from None

    def routes_to(self, receiver: str) -> list[tuple[yaml.MappingNode, float]]:
        """The routes that name this receiver, with their group_interval in seconds."""
        return [each for each in self._routes if scalar(get(each[0], "receiver")) == receiver]

    def taken_away(
        self, receivers: Container[str], below: yaml.Node | None = None, inherited: str = ""
    ) -> Iterator[Finding]:
        """What no longer goes to the receiver of a route, because one below it matches first.

        With `continue` it is meant to: Alertmanager goes on to the next routes, but not to the
        receiver above them. Looks at all routes, or at those ``below`` one.
        """
        route = get(self.root, "route") if below is None else below
        above = scalar(get(route, "receiver")) or inherited
        sends = bool(_integrations(self.receivers[above])) if above in self.receivers else False
        routes = items(get(route, "routes"))
        for number, child in enumerate(routes, 1):
            receiver, goes_on = scalar(get(child, "receiver")), scalar(get(child, "continue"))
            is_taken = receiver in receivers and goes_on == "true" and receiver != above
            if is_taken and sends and not any(map(_takes_all, routes[number:])):
                what = f"alerts for {quoted(receiver)} no longer go to {quoted(above)}, above it"
                remedy = f"add - receiver: {above} as the last of the routes below that"
                yield Finding(self.path, child.start_mark.line + 1, "route", what, remedy)
            yield from self.taken_away(receivers, child, above)

    def overlap(self, receivers: Iterable[str]) -> timedelta:
        """How long a person is notified beyond the end of a duty: whole minutes.

        Alertmanager looks at a group, and at the hours of its route, once in group_interval, and
        drops what is due outside of the hours. What is resolved before the end has to be sent when
        it looks next. What is resolved after the end is sent to the next person, but only if that
        one got the problem, which is when it has looked once. Hence twice the interval.
        """
        longest = max(each for name in receivers for _, each in self.routes_to(name))
        return math.ceil((2 * longest + _SLACK) / 60) * _MINUTE

    def add(self, key: str, *entries: yaml.Node) -> None:
        """Append entries to a list at the top of the configuration."""
        if get(self.root, key) is None:
            self.root.value.append((made(key), made([])))
        found = get(self.root, key)
        found.flow_style = False
        found.value += entries


def _takes_all(route: yaml.Node) -> bool:
    return not any(items(get(route, "matchers"))) and not any(
        get(route, key) for key in ("match", "match_re")
    )


def _compose(path: Path) -> yaml.Node:
    remedy = "name Alertmanager's configuration with --config"
    try:
        node = yaml.compose(path.read_text(encoding="utf-8"), Loader=yaml.BaseLoader)
    except OSError as error:
        what = f"cannot be read ({error.strerror})"
        raise ConfigError([Finding(path, None, "", what, remedy)]) from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        what = f"is not valid YAML ({error})"
        raise ConfigError([Finding(path, None, "", what, remedy)]) from None
    if not isinstance(node, yaml.MappingNode) or get(node, "route") is None:
        raise ConfigError([Finding(path, None, "", "has no route", remedy)])
    return node


def _below(route: yaml.Node, inherited: float) -> Iterator[tuple[yaml.MappingNode, float]]:
    """All routes below this one, with their group_interval."""
    own = scalar(get(route, "group_interval"))
    interval = durations.parse(own) if own else inherited
    for child in items(get(route, "routes")):
        if not isinstance(child, yaml.MappingNode):
            continue
        child_own = scalar(get(child, "group_interval"))
        yield child, durations.parse(child_own) if child_own else interval
        yield from _below(child, interval)


def _with(mapping: yaml.Node, key: str, value: str) -> yaml.Node:
    """A copy of a mapping with another value."""
    found = copy.deepcopy(mapping)  # nodes that are shared would get an anchor each
    found.value = [pair for pair in found.value if scalar(pair[0]) != key]
    found.value.insert(0, (made(key), made(value)))
    return found
