"""Contacts, notification options, periods and escalations -> Alertmanager's routes and receivers.

In Nagios a host or service has contacts, each with options and hours of its own. Here that is a
route by robot (and component) with one route for each contact below it. What has no contacts stays
with the routes of the shipped alertmanager.yml, which follow.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any, Literal

from ros_diagnostics_exporter import durations
from ros_diagnostics_tools.nagios.importer import advice, plugin, rotas
from ros_diagnostics_tools.nagios.importer.hours import ALWAYS, Hours, hours
from ros_diagnostics_tools.nagios.importer.inheritance import Thing
from ros_diagnostics_tools.nagios.importer.ledger import Effect
from ros_diagnostics_tools.nagios.importer.robots import Robot, check_name
from ros_diagnostics_tools.nagios.importer.rotas import Turn
from ros_diagnostics_tools.nagios.importer.site import Site
from ros_diagnostics_tools.names import escaped

Kind = Literal["host", "service"]
# An option of Nagios -> the alerts, without RosDiagnostics.
ALERTS: dict[Kind, dict[str, tuple[str, ...]]] = {
    "service": {
        "w": ("ComponentWarning", "ValueWarning", "ValueFalling"),
        "c": ("ComponentCritical", "ComponentStale", "ValueCritical", "CheckShort"),
        "f": ("ComponentFlapping", "ComponentIntermittent"),
    },
    "host": {
        "d": ("RobotSilent", "RobotPending", "ManyComponents"),
        "f": ("RobotFlapping",),
        "s": ("Maintenance",),
    },
}
ALL_OPTIONS: dict[Kind, str] = {"host": "d,u,r,f,s", "service": "w,u,c,r,f,s"}
OF_KIND = {kind: tuple(sorted(sum(of.values(), ()))) for kind, of in ALERTS.items()}
# What of a contact Nagios' commands notify, beside its mail.
MACROS = {"$CONTACTPAGER$": "pager"} | {f"$CONTACTADDRESS{n}$": f"address{n}" for n in range(1, 7)}
NOTIFICATION_INTERVAL = 30.0  # Nagios' own where the files do not say
NOBODY = "nagios-nobody"
PROBLEMS = "-problems"  # of a receiver without recoveries
ROUTES = "alertmanager-routes.yml"
ESCALATIONS = f"{ROUTES}: routes of RosDiagnosticsUnacknowledged"
NO_ESCALATION = "no route: it names no robot, or no contact who is notified of what escalates here"
# The exporter records who was notified of what (docs/notifications.md).
NOTIFIED = "http://localhost:9877/api/v1/notifications"
EMAIL = {
    "from": '{{ template "site.email.from" . }}',
    "headers": {
        "Subject": '{{ template "ros_diagnostics.email.subject" . }}',
        "References": '{{ template "ros_diagnostics.email.thread" . }}',
        "X-ROS-Diagnostics-Faults": '{{ template "ros_diagnostics.email.faults" . }}',
    },
    "text": '{{ template "ros_diagnostics.email.text" . }}',
    "html": '{{ template "ros_diagnostics.email.html" . }}',
}


@dataclass(frozen=True)
class Recipient:
    """Who receives which alerts, whether their recoveries too, and when."""

    receiver: str
    contact: str
    alerts: tuple[str, ...]
    hours: Hours


@dataclass
class Routing:
    """What goes into alertmanager.yml."""

    routes: list[dict[str, Any]] = field(default_factory=list)
    receivers: dict[str, dict[str, Any]] = field(default_factory=dict)
    time_intervals: dict[str, list[dict[str, Any]]] = field(default_factory=dict)
    rotas: dict[str, list[Turn]] = field(default_factory=dict)

    def content(self, inhibit_rules: list[dict[str, Any]]) -> dict[str, Any]:
        """The fragment: lists to be added to those of alertmanager.yml."""
        found: dict[str, Any] = {"routes": self.routes}
        found["time_intervals"] = [
            {"name": name, "time_intervals": each} for name, each in self.time_intervals.items()
        ]
        found["inhibit_rules"] = inhibit_rules
        found["receivers"] = list(self.receivers.values())
        return found


def routing(site: Site, robots: list[Robot], time_zone: str) -> Routing:
    """All routes: escalations, then each service's, then each host's; hours in ``time_zone``."""
    return _Router(site, robots, time_zone).made


class _Router:
    def __init__(self, site: Site, robots: list[Robot], time_zone: str) -> None:
        self._site = site
        self._time_zone = time_zone
        self._escalated_by: set[Thing] = set()
        self._checks: dict[str, set[str]] = {}  # filter -> the names of its checks
        for robot in robots:
            for service, check in robot.services:
                self._checks.setdefault(check.words, set()).add(check_name(service))
        self.made = Routing()
        self._escalations(robots)
        found: dict[tuple[str, Kind, tuple[Recipient, ...]], list[str]] = {}
        for robot in robots:
            for key in self._of_robot(robot):
                found.setdefault(key, []).append(robot.name)
        ordered = sorted(found.items(), key=lambda item: -len(item[0][0]))  # as _longest_words
        for (words, kind, recipients), names in ordered:
            for part in self._parts(words):
                matchers = [_alerts(OF_KIND[kind]), *part, _robots(names)]
                self.made.routes.append(self._route(matchers, recipients))

    def _parts(self, words: str) -> list[list[str]]:
        """Matchers for the components that a filter selects, and for the checks that count them."""
        if not words:
            return parts(words)
        names = "|".join(map(escaped, sorted(self._checks[words])))
        return [*parts(words), [f"check =~ {_quoted(names)}"]]

    def _of_robot(self, robot: Robot) -> Iterator[tuple[str, Kind, tuple[Recipient, ...]]]:
        """The filter of components and the recipients of each service, and those of the host."""
        of_parts: list[Recipient] = []
        of_all: list[Recipient] = []
        for service, check in robot.services:
            recipients = self._recipients("service", service.thing, robot.host)
            of_parts += recipients
            if not self.contacts(service.thing, robot.host, ROUTES):
                continue
            if check.words.lower() in plugin.EVERYTHING:
                of_all += recipients
            else:
                yield check.words, "service", tuple(dict.fromkeys(recipients))
        if of_all:
            yield "", "service", tuple(dict.fromkeys(of_all))
        of_host = self._recipients("host", robot.host, robot.host)
        if not self.contacts(robot.host, robot.host, ROUTES):
            return  # nobody is notified in Nagios, which warns about it; here the site's address is
        known = {each.receiver for each in of_host if "ManyComponents" in each.alerts}
        of_host += [
            replace(each, alerts=("ManyComponents",))
            for each in of_parts
            if "ComponentCritical" in each.alerts and each.receiver not in known
        ]
        yield "", "host", tuple(dict.fromkeys(of_host))

    # -- recipients --------------------------------------------------------------------------

    def _recipients(self, kind: Kind, thing: Thing, host: Thing) -> list[Recipient]:
        where = ROUTES
        options = _options(kind, thing, "notification_options", where)
        enabled = thing.take("notifications_enabled", f"{where}: a route to nobody") != "0"
        period = _implied(thing, host, "notification_period")
        period.take("notification_period", f"{where}: active_time_intervals")
        its_hours = hours(self._site, period.get("notification_period"))
        found = []
        for contact in self.contacts(thing, host, where):
            recipient = self._recipient(kind, contact, options, its_hours)
            if enabled and recipient is not None:
                found.append(recipient)
        return found

    def contacts(self, thing: Thing, host: Thing, where: str) -> list[Thing]:
        """The contacts of a host or service; a service without any has its host's."""
        named = any(key in thing for key in ("contacts", "contact_groups"))
        source = thing if named else host
        names = self._site.names("contact", source.list("contacts"))
        source.take("contacts", f"{where}: receivers")
        source.take("contact_groups", f"{where}: receivers")
        members = self._site.members("contact")
        for group in source.list("contact_groups"):
            thing_of_group = self._site.find("contactgroup", group)
            if thing_of_group is not None:
                thing_of_group.take("contactgroup_name", f"{where}: receivers")
            names += members.get(group, [])
        found = (self._site.find("contact", name) for name in dict.fromkeys(names))
        return [each for each in found if each is not None]

    def _recipient(
        self, kind: Kind, contact: Thing, options: frozenset[str], its_hours: Hours
    ) -> Recipient | None:
        where = ROUTES
        enabled = contact.take(f"{kind}_notifications_enabled", f"{where}: routes to the contact")
        options &= _options(kind, contact, f"{kind}_notification_options", where, default="n")
        if not contact.get(f"{kind}_notification_options"):
            remedy = f"has no {kind}_notification_options, and then Nagios notifies it of no {kind}"
            contact.lose("contact_name", remedy)
        key = f"{kind}_notification_period"
        contact.take(key, f"{where}: active_time_intervals")
        both = its_hours.both(hours(self._site, contact.get(key)))
        alerts = tuple(
            alert for option, named in ALERTS[kind].items() if option in options for alert in named
        )
        if enabled == "0" or both.never or not alerts:
            return None
        receiver = self._receiver(contact, recovery="r" in options)
        return Recipient(receiver, contact.get("contact_name"), alerts, both)

    def _receiver(self, contact: Thing, *, recovery: bool) -> str:
        where = f"{ROUTES}: receivers"
        name = f"nagios-{contact.take('contact_name', where)}" + ("" if recovery else PROBLEMS)
        receiver: dict[str, Any] = {"name": name, "webhook_configs": [_notified(recovery)]}
        if email := contact.take("email", where):
            receiver["email_configs"] = [{"to": email, "send_resolved": recovery, **EMAIL}]
        else:
            remedy = f"has no email: add its way to the receiver {name}"
            contact.lose("contact_name", remedy, Effect.NO_LONGER)
        self._ways(contact)
        self.made.receivers.setdefault(name, receiver)
        return name

    def _ways(self, contact: Thing) -> None:
        """Report in which ways beside mails Nagios notifies a contact."""
        for kind in ALERTS:
            key = f"{kind}_notification_commands"
            commands = (self._site.find("command", each) for each in contact.list(key))
            lines = [each.get("command_line") for each in commands if each is not None]
            for macro, key_of_way in MACROS.items():
                if key_of_way in contact and any(macro in line for line in lines):
                    contact.lose(key_of_way, advice.ADVICE["pager"], Effect.NO_LONGER)
            others = [each for each in lines if "$CONTACT" not in each]
            if others:
                remedy = "a way of its own: add sns_configs or a webhook to the contact's receiver"
                contact.lose(key, remedy, Effect.NO_LONGER)

    # -- routes ------------------------------------------------------------------------------

    def _route(self, matchers: list[str], recipients: Iterable[Recipient]) -> dict[str, Any]:
        """A route with one below it for each recipient; who has none gets nothing."""
        self.made.receivers.setdefault(NOBODY, {"name": NOBODY})
        below = []
        for each in self._relieved(dict.fromkeys(recipients)):
            route: dict[str, Any] = {"receiver": each.receiver, "continue": True}
            route["matchers"] = [_alerts(each.alerts)]
            below.append(route | self._times(each.hours))
        return {"matchers": matchers, "receiver": NOBODY} | ({"routes": below} if below else {})

    def _relieved(self, recipients: Iterable[Recipient]) -> Iterator[Recipient]:
        """The recipients, those who relieve one another as the one receiver of a rota."""
        alike: dict[tuple[tuple[str, ...], bool], list[Recipient]] = {}
        for each in recipients:
            recovery = not each.receiver.endswith(PROBLEMS)
            alike.setdefault((each.alerts, recovery), []).append(each)
        for (alerts, recovery), found in alike.items():
            if rotas.relieve_one_another(each.hours for each in found):
                yield Recipient(self._rota(found, recovery=recovery), "", alerts, ALWAYS)
            else:
                yield from found

    def _rota(self, recipients: list[Recipient], *, recovery: bool) -> str:
        names = "-".join(each.contact for each in recipients)
        name = f"nagios-rota-{names}" + ("" if recovery else PROBLEMS)
        emails = (self._site.find("contact", each.contact) for each in recipients)
        to = ", ".join(filter(None, (each.get("email") for each in emails if each is not None)))
        config = {"to": to, "send_resolved": recovery, **EMAIL}
        self.made.receivers[name] = {
            "name": name,
            "webhook_configs": [_notified(recovery)],
            "email_configs": [config],
        }
        self.made.rotas[name] = [Turn(each.contact, each.hours) for each in recipients]
        return name

    def _times(self, hours: Hours) -> dict[str, list[str]]:
        if hours.always:
            return {}
        route = {}
        if active := hours.intervals():
            self.made.time_intervals[hours.name] = self._located(active)
            route["active_time_intervals"] = [hours.name]
        if hours.muted:
            self.made.time_intervals[f"{hours.name} (off)"] = self._located(hours.muted)
            route["mute_time_intervals"] = [f"{hours.name} (off)"]
        return route

    def _located(self, intervals: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
        """Intervals in the zone of Nagios' hours; without a location they are UTC."""
        return [{**each, "location": self._time_zone} for each in intervals]

    # -- escalations -------------------------------------------------------------------------

    def _escalations(self, robots: list[Robot]) -> None:
        by_name = {robot.name: robot for robot in robots}
        found: dict[tuple[str, Kind, int, tuple[Recipient, ...]], list[str]] = {}
        for kind in ALERTS:
            named = self._escalations_of(kind, by_name)
            for (name, words), things in named.items():
                for step, recipients in self._steps(kind, by_name[name], things):
                    found.setdefault((words, kind, step, recipients), []).append(name)
        for (words, kind, step, recipients), names in sorted(found.items(), key=_longest_words):
            scope = 'scope = "robot"' if kind == "host" else 'scope != "robot"'
            unacknowledged = ["alertname = RosDiagnosticsUnacknowledged", f'step = "{step}"', scope]
            for part in self._parts(words):
                matchers = [*unacknowledged, *part, _robots(names)]
                self.made.routes.append(self._route(matchers, recipients))
        for kind in ALERTS:
            for thing in self._site.all(f"{kind}escalation"):
                if thing not in self._escalated_by:
                    thing.withdraw(ESCALATIONS, NO_ESCALATION)

    def _escalations_of(
        self, kind: Kind, robots: dict[str, Robot]
    ) -> dict[tuple[str, str], list[Thing]]:
        """Of each robot and filter the escalations, the first to notify first."""
        found: dict[tuple[str, str], list[Thing]] = {}
        for thing in self._site.all(f"{kind}escalation"):
            for name in self._site.hosts_of(thing, ESCALATIONS):
                for words in self._escalated(robots.get(name), thing, kind):
                    found.setdefault((name, words), []).append(thing)
        for things in found.values():
            things.sort(key=lambda thing: thing.number("first_notification", 1))
        return found

    def _escalated(self, robot: Robot | None, thing: Thing, kind: Kind) -> list[str]:
        """The filters of the services that an escalation names on a robot; "" for the robot."""
        if robot is None:
            for key in ("host_name", "hostgroup_name"):
                thing.lose(key, "some of its hosts are not robots: they are not in fleet.yml")
            return []
        if kind == "host":
            return [""]
        wanted = thing.list("service_description")
        thing.take("service_description", ESCALATIONS)
        found = [
            "" if check.words.lower() in plugin.EVERYTHING else check.words
            for service, check in robot.services
            if service.name in wanted or "*" in wanted
        ]
        if not found:
            thing.lose("service_description", f"{robot.name} has no ROS check of this name")
        return list(dict.fromkeys(found))

    def _steps(
        self, kind: Kind, robot: Robot, things: list[Thing]
    ) -> Iterator[tuple[int, tuple[Recipient, ...]]]:
        """Step 1 is the first escalation, step 2 all that follow."""
        for step, of_step in ((1, things[:1]), (2, things[1:])):
            recipients = [
                each for thing in of_step for each in self._escalation(kind, robot, thing, step)
            ]
            if recipients:
                yield step, tuple(dict.fromkeys(recipients))

    def _escalation(self, kind: Kind, robot: Robot, thing: Thing, step: int) -> Iterator[Recipient]:
        after = self._interval(robot, thing) * max(thing.number("first_notification", 1) - 1, 0)
        thing.take("first_notification", f"{ESCALATIONS}, step {step}")
        thing.lose(
            "first_notification",
            f"about {durations.written(after)} after the first notification in Nagios; the time of "
            f"step {step} is in prometheus/rules/escalation.yml",
            Effect.OTHERWISE,
        )
        period = hours(self._site, thing.take("escalation_period", ESCALATIONS))
        worst: dict[Kind, str] = {"host": "d", "service": "c"}
        for contact in self.contacts(thing, robot.host, ESCALATIONS):
            found = self._recipient(kind, contact, frozenset(worst[kind]), period)
            if found is not None:
                self._escalated_by.add(thing)
                yield replace(found, alerts=("Unacknowledged",))

    def _interval(self, robot: Robot, thing: Thing) -> float:
        """Seconds between two notifications before an escalation: the object's own interval."""
        wanted = thing.list("service_description")
        services = [service for service, _ in robot.services if service.name in wanted]
        source = services[0].inherited("notification_interval") if services else robot.host
        return self._site.seconds(source.number("notification_interval", NOTIFICATION_INTERVAL))


def _notified(recovery: bool) -> dict[str, Any]:
    return {"url": NOTIFIED, "send_resolved": recovery}


def _longest_words(item: tuple[tuple[str, Any, Any, Any], Any]) -> int:
    """The longer filter is the more specific one; the first route that matches gets the alert."""
    return -len(item[0][0])


def _implied(thing: Thing, host: Thing, key: str) -> Thing:
    return thing if key in thing.values or key not in host.values else host


def _options(kind: Kind, thing: Thing, key: str, where: str, default: str = "a") -> frozenset[str]:
    """The letters of notification options: all for ``a``, none for ``n``.

    Where none is given, Nagios takes ``a`` for hosts and services, and ``n`` for contacts.
    """
    written = thing.take(key, f"{where}: alerts and send_resolved") or default
    letters = frozenset(each.strip()[:1] for each in written.split(",") if each.strip())
    if letters & {"a"}:
        letters = frozenset(ALL_OPTIONS[kind].split(","))
    if "u" in letters:
        remedy = {
            "host": "u: UNREACHABLE is a fault of the uplink, one for all behind it",
            "service": "u: a robot that is silent is one alert, not one of each component",
        }
        thing.lose(key, remedy[kind], Effect.OTHERWISE)
    if kind == "service" and "s" in letters and key in thing.values:
        thing.lose(
            key,
            "s: a downtime is one of the robot, and notified to its host's contacts",
            Effect.OTHERWISE,
        )
    return frozenset() if letters & {"n"} else letters


def parts(words: str) -> list[list[str]]:
    """Matchers for the components that a filter of a plug-in selects by name, or by their group."""
    if not words:
        return [[]]
    found = _quoted(f"(?i).*{escaped(words)}.*")
    return [[f"component =~ {found}"], [f"group =~ {found}"]]


def _quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


def _robots(names: list[str]) -> str:
    return f"robot =~ {_quoted('|'.join(map(escaped, names)))}"


def _alerts(names: Iterable[str]) -> str:
    return f'alertname =~ "RosDiagnostics({"|".join(names)})"'
