"""The pages: the fleet at a glance and one for each robot, self-contained, for phones too.

Here is what they show; `templates/` has how. Every text is escaped there, by Jinja2.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from itertools import islice
from typing import Any, NamedTuple
from urllib.parse import quote

from jinja2 import Environment, PackageLoader, StrictUndefined

from ros_diagnostics_exporter import __version__
from ros_diagnostics_exporter.event_texts import event_text, notified_text
from ros_diagnostics_exporter.fleet_texts import (
    ahead_texts,
    clock,
    downtime_texts,
    query_text,
    span,
    unclaimed_texts,
    unread_text,
)
from ros_diagnostics_exporter.model import place
from ros_diagnostics_exporter.severity import (
    COLOURS,
    OF_CAPABILITY_STATE,
    SEVERITIES,
    ShownProblem,
    as_planned,
    component_path,
    component_text,
    is_robot,
    part_path,
    problem_state,
    shown_as_they_are,
    shown_problems,
    silent_text,
    state_of,
    subject,
)
from ros_diagnostics_exporter.texts import natural, one_line
from ros_diagnostics_exporter.web.grafana import Grafana
from ros_diagnostics_exporter.web.mission_section import MissionSection
from ros_diagnostics_exporter.web.runbooks import alert_of, filled_in, link_to
from ros_diagnostics_exporter.web.search import MAX_FOUND, find, find_components

MAX_MESSAGE = 300  # characters of a text that a robot sent
MAX_ROBOTS = 200  # robots with problems; the API has them all
MAX_PROBLEMS = 10  # of a robot on the page of the fleet; the robot's own page has more
MAX_LISTED = 500  # problems and components on a robot's page, and values on it
EVENTS = 50  # of a robot that are shown
DOWNTIMES = ("15m", "30m", "1h", "2h", "4h", "8h", "1d", "3d")  # that a form offers
MAX_ENDED = 20  # times that a fault lasted, on its page; the API has them all


NO_GRAFANA = Grafana()


def landing(
    fleet: dict[str, Any],
    telemetry_path: str,
    query: str = "",
    *,
    acts: bool = False,
    grafana: Grafana = NO_GRAFANA,
) -> str:
    """The page of ``fleet``, as /api/v1/fleet returns it; all texts in it are escaped.

    With a ``query`` only the robots, problems and components that have this text in them, in any
    case, and counts of these; with ``acts`` its problems link the forms of their pages.
    """
    now = fleet["time"]
    components = find_components(fleet, query) if query else []
    fleet = find(fleet, query) if query else fleet
    count = Counter(state_of(each) for each in fleet["robots"] if is_robot(each))
    always = "" if query else "OK"  # what a search has not found is not counted
    counts = {each: count[each] for each in SEVERITIES if count[each] or each == always}
    robots = [(state_of(robot), robot) for robot in fleet["robots"]]
    troubled = [each for each in robots if each[1]["problems"] or SEVERITIES[each[0]] > 0]
    troubled.sort(key=_worst_first)
    common, common_number = shown_problems(fleet, now, MAX_LISTED)
    return _render(
        "fleet.html",
        title=f"{fleet['fleet']}: ROS diagnostics",
        now=now,
        unread=unread_text(fleet),
        dashboard=grafana.of(fleet["fleet"]),
        query=query,
        acts=acts,
        version=__version__,
        telemetry_path=telemetry_path,
        counts=counts,
        unclaimed=[] if query else unclaimed_texts(fleet),
        queries=[query_text(each) for each in fleet.get("queries", ()) if each["error"]],
        capabilities=[] if query else _of_fleet(fleet),
        components=components[:MAX_FOUND],
        component_number=len(components),
        common=common,
        common_number=common_number,
        troubled=[_troubled(state, robot, now) for state, robot in troubled[:MAX_ROBOTS]],
        troubled_number=len(troubled),
        robots=_by_name(each for each in robots if is_robot(each[1])),
        devices=_by_name(each for each in robots if not is_robot(each[1])),
    )


def _by_name(robots: Iterable[tuple[str, dict[str, Any]]]) -> list[tuple[str, str]]:
    return sorted(((state, each["robot"]) for state, each in robots), key=lambda it: natural(it[1]))


def robot_page(
    fleet: dict[str, Any],
    name: str,
    events: Iterable[dict[str, Any]],
    history: Iterable[dict[str, Any]] = (),
    *,
    missions: MissionSection | None = None,
    acting: Acting | None = None,
    grafana: Grafana = NO_GRAFANA,
) -> str | None:
    """The page of one robot with its ``events``, the newest first; None if there is no such robot.

    ``history`` are the ``entries`` of /api/v1/why; with ``acting`` it has forms. What the section
    of ``missions`` has is in neither of the lists below it. All texts in it are escaped.
    """
    robot = next((each for each in fleet["robots"] if each["robot"] == name), None)
    if robot is None:
        return None
    now = fleet["time"]
    problems, problem_number = shown_problems(robot, now, MAX_LISTED)
    shown = {_line(each) for each in missions.moments} if missions else set()
    in_order = [each for each in history if (each["time"], each["text"]) not in shown][-EVENTS:]
    shown |= {(each["time"], each["text"]) for each in in_order}
    others = (each for each in events if _line(each) not in shown)
    return _render(
        "robot.html",
        title=f"{name}: ROS diagnostics",
        now=now,
        unread=unread_text(fleet),
        dashboard=grafana.of(fleet["fleet"], name),
        fleet=fleet["fleet"],
        name=name,
        state=state_of(robot),
        marks=downtime_texts(robot, now) + ahead_texts(robot, now),
        links=robot["links"],
        capabilities=_capabilities(robot),
        facts=_facts(robot, now),
        problems=problems,
        problem_number=problem_number,
        missions=missions,
        history=in_order,
        components=_components(robot, problems),
        component_number=len(robot["components"]),
        events=list(islice(others, EVENTS)),
        acting=acting,
        downtimes=DOWNTIMES,
        planned=robot["downtimes"] + robot["downtimes_ahead"],
        parts=sorted({each["component"] for each in robot["components"]}, key=natural)[:MAX_LISTED],
    )


def _line(event: dict[str, Any]) -> tuple[float, str]:
    """An event's time and text, as the history has them."""
    return event["time"], one_line(event_text(event))


def rejected(why: str) -> str:
    """The page after a form that was not followed."""
    return _render("rejected.html", title="Not saved", why=why)


def runbook_page(alert: str, names: Mapping[str, str]) -> str | None:
    """The runbook of an alert, with the names of what it is about; None if there is none.

    All texts are escaped.
    """
    text = filled_in(alert, names)
    return text and _render("runbook.html", title=alert, text=text, robot=names.get("robot", ""))


def missing_runbook(alert: str) -> str:
    """The page for an alert without a runbook."""
    return _render("missing_runbook.html", title="No such runbook", name=alert)


def missing_robot(fleet: dict[str, Any], name: str) -> str:
    """The page for the name of a robot that there is not."""
    return _render("missing.html", title=f"{fleet['fleet']}: no such robot", name=name)


def fault_page(
    fleet: dict[str, Any],
    fault: str,
    history: dict[str, Any],
    acting: Acting | None = None,
    grafana: Grafana = NO_GRAFANA,
) -> str | None:
    """The page of the fault with that id, None if nothing is known of it; all texts are escaped.

    ``history`` is each time that it lasted, as /api/v1/faults/ID returns it; with ``acting`` it
    has forms.
    """
    now = fleet["time"]
    ended = [_ended(each) for each in history["occurrences"] if each["until"] is not None]
    for of in (fleet, *fleet["robots"]):
        its = [each for each in of["problems"] if each["fault"] == fault]
        if not its:
            continue
        (found,) = shown_as_they_are(its, of, now)
        robot = of.get("robot", "")
        return _render(
            "fault.html",
            title=f"{robot or fleet['fleet']}: {found.subject}",
            now=now,
            unread=unread_text(fleet),
            dashboard=grafana.of(fleet["fleet"], robot, its[0]),
            fleet=fleet["fleet"],
            robot=robot,
            fault=found,
            path=component_path(its[0]),
            others=_other_faults(fleet, fault),
            marks=downtime_texts(of, now) if robot else [],
            ended=ended[:MAX_ENDED],
            ended_number=len(ended),
            name=fault if history["occurrences"] else "",
            acting=acting,
            downtimes=DOWNTIMES,
            parts=[each for each in (its[0]["component"],) if each],
        )
    if not ended:
        return None
    robot, subject_of = ended[0].fault["robot"], ended[0].subject
    return _render(
        "ended_fault.html",
        title=f"{robot or fleet['fleet']}: {subject_of}",
        now=now,
        unread=unread_text(fleet),
        dashboard=grafana.of(fleet["fleet"], robot, ended[0].fault),
        fleet=fleet["fleet"],
        robot=robot,
        ended=ended[:MAX_ENDED],
        ended_number=len(ended),
        name=fault,
    )


def missing_fault(fleet: dict[str, Any], fault: str, history: dict[str, Any]) -> str:
    """The page for an id of which no fault lasts, and none is in the event log."""
    return _render(
        "missing_fault.html",
        title=f"{fleet['fleet']}: no such fault",
        name=fault,
        events_since=history["events_since"],
        now=fleet["time"],
    )


class Acting(NamedTuple):
    """Who looks at a page may act: the token for its forms, and what was done just now or ""."""

    token: str
    done: str


class _Ended(NamedTuple):
    """A fault that has ended; ``fault`` as /api/v1/faults/ID has it."""

    state: str
    subject: str
    fault: dict[str, Any]
    notified: list[tuple[float, str]]


def _ended(fault: dict[str, Any]) -> _Ended:
    sent = [(each["at"], notified_text(each)) for each in fault["notified"]]
    return _Ended(problem_state(fault), subject(fault), fault, sent[:MAX_PROBLEMS])


class _Troubled(NamedTuple):
    """A robot with problems on the page of the fleet; ``more`` problems are not shown."""

    name: str
    state: str
    marks: list[str]
    problems: list[ShownProblem]
    more: int


class _Component(NamedTuple):
    """A component on its robot's page."""

    state: str
    path: str
    mark: str  # why it is no fault, in a word
    text: str
    shown_values: list[dict[str, Any]]


def _other_faults(fleet: dict[str, Any], fault: str) -> str:
    """How many faults there are beside one, and how many of them are CRITICAL; "" if none."""
    problems = (each for of in (fleet, *fleet["robots"]) for each in of["problems"])
    states = [problem_state(each) for each in problems if each["fault"] not in (None, fault)]
    critical = states.count("CRITICAL")
    if len(states) < 2:
        return "".join(f"one more fault, {state}" for state in states)
    return f"{len(states)} more faults" + (f", {critical} of them CRITICAL" if critical else "")


def _worst_first(entry: tuple[str, dict[str, Any]]) -> tuple[Any, ...]:
    """A sort key: robots of which all is suppressed come last; in one state confirmed first."""
    state, robot = entry
    suppressed = [each["suppressed"] is not None for each in robot["problems"]]
    confirmed = any(each["confirmed"] is not None for each in robot["problems"])
    all_suppressed = bool(suppressed) and all(suppressed) and not confirmed
    return all_suppressed, -SEVERITIES[state], not confirmed, natural(robot["robot"])


def _troubled(state: str, robot: dict[str, Any], now: float) -> _Troubled:
    problems, number = shown_problems(robot, now, MAX_PROBLEMS)
    more = number - len(problems)
    return _Troubled(robot["robot"], state, downtime_texts(robot, now), problems, more)


def _facts(robot: dict[str, Any], now: float) -> dict[str, str | None]:
    """What is shown of a robot first; what is empty is left out."""
    received = robot["last_message"]
    ago = "never" if received is None else f"{span(now - received)} ago, {_at(received, now)}"
    silent = "" if robot["up"] else f"; silent: {silent_text(robot['silent_reason'])}"
    return {
        "Last message": f"{ago}{silent}",
        "Topic": f"{robot['topic']} in {place(robot['domain_id'])}" if robot["topic"] else None,
        "Profile": robot["profile"],
        "Address": robot["address"],
        **robot["labels"],
    }


class _Capability(NamedTuple):
    """What a robot can do, on its page: the worst first; ``parts`` keep it from being OK."""

    state: str
    name: str
    text: str
    parts: list[str]


def _capabilities(robot: dict[str, Any]) -> list[_Capability]:
    found = [
        _Capability(state, each["capability"], text, [part_path(part) for part in each["parts"]])
        for each in robot["capabilities"]
        for state, text in [OF_CAPABILITY_STATE[each["state"]]]
    ]
    return sorted(found, key=lambda each: -SEVERITIES[each.state])


def _of_fleet(fleet: dict[str, Any]) -> list[_Capability]:
    found = []
    for each in fleet["capabilities"]:
        (state, text), robots = OF_CAPABILITY_STATE[each["state"]], each["robots"]
        can = f"{robots['ok'] + robots['degraded']} of {sum(robots.values())} robots can"
        others = [f"{robots[key]} {key}" for key in ("lost", "unknown") if robots[key]]
        others += [f"{robots['maintenance']} in maintenance"] if robots["maintenance"] else []
        found.append(_Capability(state, each["capability"], text, [can, *others]))
    return sorted(found, key=lambda each: -SEVERITIES[each.state])


def _components(robot: dict[str, Any], problems: list[ShownProblem]) -> list[_Component]:
    """The components, those with problems first, with the values of what is in trouble."""
    worst: dict[tuple[str, str], str] = {}
    for each in problems:
        worst.setdefault((each.problem["group"], each.problem["component"]), each.state)
    rows = []
    for component in robot["components"]:
        of_problem = worst.get((component["group"], component["component"]), "OK")
        own = "OK" if of_problem == "FLAPPING" else component["state"]  # that of this moment
        rows.append((max(own, of_problem, key=SEVERITIES.__getitem__), component))
    rows.sort(key=lambda each: (-SEVERITIES[each[0]], natural(component_path(each[1]))))
    shown = []
    left = MAX_LISTED
    for state, component in rows[:MAX_LISTED]:
        values = [] if state == "OK" else component["values"][:left]
        left -= len(values)
        text = "; ".join(filter(None, (component_text(component), *_unread(component))))
        of = component_path(component), _mark(component), text
        shown.append(_Component(state, *of, values))
    return shown


def _unread(component: dict[str, Any]) -> Iterator[str]:
    """Which of its values have thresholds that cannot be judged."""
    for value in component["values"]:
        if value["number"] is None and "thresholds" in value:
            what = f"{value['key']} = '{value['value']}'"
            yield f"{what} is no number, its thresholds cannot be judged"


def _mark(component: dict[str, Any]) -> str:
    if as_planned(component):
        return "planned"
    return "suppressed" if component.get("suppressed_because") else ""


# -- filters ---------------------------------------------------------------------------------


def _at(unix: float, now: float) -> str:
    return clock(unix, now, local=False)


def _time_of_day(unix: float) -> str:
    return clock(unix, unix, local=False, seconds=False).removesuffix(" UTC")


def _quoted(name: str) -> str:
    """A name for a URL, its slashes too; what is no Unicode is replaced."""
    return quote(name, safe="", errors="replace")


def _short(text: str) -> str:
    return text if len(text) <= MAX_MESSAGE else text[:MAX_MESSAGE] + "…"


def _bounds(value: dict[str, Any]) -> str:
    """A value's thresholds in words."""
    return ", ".join(
        f"{each['bound']} {each['severity']} {each['value']:g}"
        for each in value.get("thresholds", ())
    )


def _runbook(problem: dict[str, Any], robot: str) -> str:
    alert = alert_of(problem["scope"], problem["state"])
    return alert and link_to(alert, {**problem, "robot": robot})


def _visible(value: object) -> object:
    """Any text that is no markup, in one line: invisible and direction-changing characters show."""
    return value if hasattr(value, "__html__") else one_line(str(value))


def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader(__package__),
        autoescape=True,
        finalize=_visible,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        auto_reload=False,
    )
    environment.filters |= {
        "at": _at,
        "time_of_day": _time_of_day,
        "bounds": _bounds,
        "event_text": event_text,
        "quoted": _quoted,
        "runbook": _runbook,
        "short": _short,
        "span": span,
    }
    return environment


_ENVIRONMENT = _environment()
SCRIPT = _ENVIRONMENT.get_template("refresh.js").render()
STYLE = _ENVIRONMENT.get_template("style.css").render(colours=COLOURS)


def _render(template: str, **shown: Any) -> str:
    return _ENVIRONMENT.get_template(template).render(style=STYLE, script=SCRIPT, **shown)
