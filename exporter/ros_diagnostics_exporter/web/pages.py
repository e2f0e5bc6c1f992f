"""The pages: the fleet at a glance and one for each robot, self-contained, for phones too."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from html import escape as escape_markup
from itertools import islice
from typing import Any
from urllib.parse import quote

from ros_diagnostics_exporter import __version__
from ros_diagnostics_exporter.severity import (
    COLOURS,
    SEVERITIES,
    ShownProblem,
    as_planned,
    clock,
    component_path,
    component_text,
    event_text,
    shown_problems,
    silent_text,
    span,
    state_of,
)
from ros_diagnostics_exporter.texts import natural, one_line

MAX_MESSAGE = 300  # characters of a text that a robot sent
MAX_ROBOTS = 200  # robots with problems; the API has them all
MAX_PROBLEMS = 10  # of a robot on the page of the fleet; the robot's own page has more
MAX_LISTED = 500  # problems and components on a robot's page, and values on it
EVENTS = 50  # of a robot that are shown

STYLE = """
:root { color-scheme: light dark; --line: #8885; --faint: #8881; }
* { box-sizing: border-box; }
body { font: 16px/1.45 system-ui, sans-serif; margin: 0 auto; max-width: 64rem; padding: 1rem;
  overflow-wrap: anywhere; }
h1 { font-size: 1.4rem; margin: 0; line-height: 1.25; }
h2 { font-size: 1.1rem; margin: 1.8rem 0 .5rem; }
h3 { font-size: 1rem; margin: 0; display: inline; }
nav { margin: .6rem 0; } nav a { margin-right: 1rem; white-space: nowrap; }
ul { list-style: none; margin: 0; padding: 0; }
.sum { display: flex; flex-wrap: wrap; gap: .5rem; }
.sum li { border: 1px solid var(--line); border-radius: .4rem; padding: .3rem .7rem; }
.sum b { font-size: 1.3rem; margin-right: .4rem; }
.chip, .mark, .hard, .soft { border-radius: .3rem; font-size: .8rem; font-weight: 600;
  padding: .1rem .45rem; white-space: nowrap; }
.mark, .hard, .soft { border: 1px dashed; display: inline-block; font-weight: 400;
  white-space: normal; }
.hard { border-style: solid; font-weight: 600; }
article { border: 1px solid var(--line); border-left-width: .5rem; border-radius: .3rem;
  margin: .6rem 0; padding: .5rem .8rem .6rem; }
.rows .well { margin-top: .25rem; padding-top: .25rem; }
.rows li { border-top: 1px solid var(--line); margin-top: .45rem; padding-top: .45rem; }
article > .rows:first-child li:first-child { border: 0; margin: 0; padding: 0; }
.what { font-weight: 600; } .dim { opacity: .75; }
.when { display: inline-block; font-size: .9rem; opacity: .75; }
.text { margin: .1rem 0 0; }
.facts, .values { display: grid; gap: 0 1rem; grid-template-columns: max-content 1fr;
  margin: .4rem 0; }
.values { font-size: .9rem; grid-template-columns: minmax(6rem, max-content) 1fr; }
dt { opacity: .75; } dd { margin: 0; }
.all { columns: 14rem; } .all li { padding: .1rem 0; }
.all .chip { display: inline-block; margin-right: .3rem; min-width: 6.2rem; text-align: center; }
""" + "".join(
    f".{state} {{ border-left-color: {colour}; }}\n"
    f".chip.{state} {{ background: {colour}; color: {text}; }}\n"
    for state, (colour, text) in COLOURS.items()
)


def landing(fleet: dict[str, Any], telemetry_path: str) -> str:
    """The page of ``fleet``, as /api/v1/fleet returns it; all texts in it are escaped."""
    return "".join(_landing(fleet, telemetry_path))


def robot_page(
    fleet: dict[str, Any],
    name: str,
    events: Iterable[dict[str, Any]],
    ledger: Iterable[dict[str, Any]] = (),
) -> str | None:
    """The page of one robot with its ``events``, the newest first; None if there is no such robot.

    ``ledger`` are the ``entries`` of /api/v1/why.

    All texts in it are escaped.
    """
    found = (each for each in fleet["robots"] if each["robot"] == name)
    robot = next(found, None)
    return None if robot is None else "".join(_robot_page(fleet, robot, events, ledger))


def missing_robot(fleet: dict[str, Any], name: str) -> str:
    """The page for the name of a robot that there is not."""
    return "".join(
        (
            *_head(f"{fleet['fleet']}: no such robot"),
            f"<h1>There is no robot {escape(name)}</h1>",
            '<nav><a href="../">All robots</a></nav></body></html>\n',
        )
    )


# -- the fleet -------------------------------------------------------------------------------


def _landing(fleet: dict[str, Any], telemetry_path: str) -> Iterator[str]:
    now = fleet["time"]
    robots = [(state_of(robot), robot) for robot in fleet["robots"]]
    troubled = [each for each in robots if each[1]["problems"] or SEVERITIES[each[0]] > 0]
    troubled.sort(key=_worst_first)
    common, number = shown_problems(fleet, now, MAX_LISTED)

    title = f"{fleet['fleet']}: ROS diagnostics"
    yield from _head(title)
    yield f"<h1>{escape(title)}</h1><p class=dim>ros-diagnostics-exporter {escape(__version__)}, "
    yield f"{clock(now, now, local=False)}</p>"
    # Relative links, for proxies that add a path prefix.
    yield f'<nav><a href="{escape(telemetry_path.lstrip("/"))}">Metrics</a> '
    yield '<a href="api/v1/fleet">Fleet (JSON)</a> <a href="api/v1/faults">Faults (JSON)</a> '
    yield '<a href="api/v1/events">Events (JSON)</a> <a href="-/ready">Ready</a> '
    yield '<a href="api/v1/openapi.json">OpenAPI</a></nav>'
    yield from _summary(Counter(state for state, _ in robots))
    if common:
        yield f"<h2>Of many robots: {number}</h2>"
        yield f'<article class="{common[0].state}"><ul class=rows>'
        yield from (_problem(each, now) for each in common)
        yield "</ul></article>"
    yield f"<h2>Robots with problems: {len(troubled)}</h2>"
    if not troubled:
        yield "<p>None.</p>"
    for state, robot in troubled[:MAX_ROBOTS]:
        yield from _troubled(state, robot, now)
    yield from _and_more(len(troubled) - MAX_ROBOTS, "robots with problems", "api/v1/fleet")
    yield from _all(robots)
    yield "</body></html>\n"


def _worst_first(each: tuple[str, dict[str, Any]]) -> tuple[Any, ...]:
    """A sort key: in one state, confirmed problems come first, and quiet ones last."""
    state, robot = each
    confirmed = any(problem["confirmed"] is not None for problem in robot["problems"])
    soft = any(problem["quiet"] is None for problem in robot["problems"])
    return -SEVERITIES[state], not confirmed, not soft, natural(robot["robot"])


def _summary(count: Counter[str]) -> Iterator[str]:
    yield "<ul class=sum>"
    for state in SEVERITIES:
        if count[state] or state == "OK":
            yield f'<li><b>{count[state]}</b><span class="chip {state}">{state}</span></li>'
    yield "</ul>"


def _troubled(state: str, robot: dict[str, Any], now: float) -> Iterator[str]:
    problems, number = shown_problems(robot, now, MAX_PROBLEMS)
    yield f'<article class="{state}"><h3>{_link(robot["robot"])}</h3> {_chip(state)} '
    yield from _marks(robot, now)
    yield "<ul class=rows>"
    yield from (_problem(each, now) for each in problems)
    yield "</ul>"
    yield from _and_more(number - len(problems), "problems", _path(robot["robot"]))
    yield "</article>"


def _all(robots: list[tuple[str, dict[str, Any]]]) -> Iterator[str]:
    yield f"<h2>All robots: {len(robots)}</h2><ul class=all>"
    for state, robot in sorted(robots, key=lambda each: natural(each[1]["robot"])):
        yield f"<li>{_chip(state)} {_link(robot['robot'])}</li>"
    yield "</ul>"


# -- one robot -------------------------------------------------------------------------------


def _robot_page(
    fleet: dict[str, Any],
    robot: dict[str, Any],
    events: Iterable[dict[str, Any]],
    ledger: Iterable[dict[str, Any]],
) -> Iterator[str]:
    now, name = fleet["time"], robot["robot"]
    problems, number = shown_problems(robot, now, MAX_LISTED)
    yield from _head(f"{name}: ROS diagnostics")
    yield f"<h1>{escape(name)} {_chip(state_of(robot))}</h1>"
    yield f"<p class=dim>robot of {escape(fleet['fleet'])}, {clock(now, now, local=False)}</p>"
    yield f'<nav><a href="../">All robots</a> <a href="{_of_api(robot)}">Robot (JSON)</a> '
    yield f'<a href="../api/v1/events?robot={_quoted(name)}">Events (JSON)</a> '
    yield f'<a href="../api/v1/why?robot={_quoted(name)}">Why notified (JSON)</a></nav>'
    yield from _marks(robot, now)
    yield from _facts(robot, now)
    yield f"<h2>Problems: {number}</h2>"
    if problems:
        yield f'<article class="{problems[0].state}"><ul class=rows>'
        yield from (_problem(each, now, evidence=True) for each in problems)
        yield "</ul></article>"
    else:
        yield "<p>None.</p>"
    yield from _and_more(number - len(problems), "problems", _of_api(robot))
    yield from _ledger(ledger, now)
    yield from _components(robot, problems)
    yield from _events(events, now)
    yield "</body></html>\n"


def _facts(robot: dict[str, Any], now: float) -> Iterator[str]:
    received = robot["last_message"]
    ago = "never" if received is None else f"{span(now - received)} ago, {_at(received, now)}"
    silent = "" if robot["up"] else f"; silent: {silent_text(robot['silent_reason'])}"
    facts = {
        "Last message": f"{ago}{silent}",
        "Topic": f"{robot['topic']} in domain {robot['domain_id']}",
        "Profile": robot["profile"],
        "Address": robot["address"],
        **robot["labels"],
    }
    yield "<dl class=facts>"
    for key, text in facts.items():
        if text:
            yield f"<dt>{escape(key)}</dt><dd>{escape(text)}</dd>"
    yield "</dl>"


def _components(robot: dict[str, Any], problems: list[ShownProblem]) -> Iterator[str]:
    """All components, those with problems first, with their values."""
    worst: dict[tuple[str, str], str] = {}
    for each in problems:
        worst.setdefault((each.problem["group"], each.problem["component"]), each.state)
    rows = []
    for component in robot["components"]:
        states = (component["state"], worst.get((component["group"], component["component"]), "OK"))
        state = max(states, key=SEVERITIES.__getitem__)
        rows.append((state, component))
    rows.sort(key=lambda each: (-SEVERITIES[each[0]], natural(component_path(each[1]))))
    yield f"<h2>Components: {len(rows)}</h2><ul class=rows>"
    values = MAX_LISTED
    for state, component in rows[:MAX_LISTED]:
        mark = "quiet" if component.get("quiet_because") else ""
        mark = "planned" if as_planned(component) else mark
        text = _text(component_text(component))
        name = f"<span class=what>{_text(component_path(component))}</span>"
        if mark:
            name += f" <span class=mark>{mark}</span>"
        if state == "OK":
            yield f"<li class=well>{_chip(state)} {name} <span class=dim>{text}</span>"
        else:
            yield f"<li>{_chip(state)} {name}<p class=text>{text}</p>"
            yield from _values(component["values"][: max(0, values)])
            values -= len(component["values"])
        yield "</li>"
    yield "</ul>"
    yield from _and_more(len(rows) - MAX_LISTED, "components", _of_api(robot))


def _values(values: list[dict[str, Any]]) -> Iterator[str]:
    if values:
        yield "<dl class=values>"
        for each in values:
            yield f"<dt>{_text(each['key'])}</dt><dd>{_text(each['value'])}"
            bounds = ", ".join(
                f"{bound['bound']} {bound['severity']} {bound['value']:g}"
                for bound in each.get("thresholds", ())
            )
            yield f" <span class=dim>({bounds})</span></dd>" if bounds else "</dd>"
        yield "</dl>"


def _ledger(ledger: Iterable[dict[str, Any]], now: float) -> Iterator[str]:
    """What led to the notifications of the present faults, or of the last one."""
    shown = list(ledger)[-EVENTS:]
    if shown:
        yield "<h2>The last faults in order</h2><ul class=rows>"
        for each in shown:
            yield f"<li><span class=when>{_at(each['time'], now)}</span> {_text(each['text'])}</li>"
        yield "</ul>"


def _events(events: Iterable[dict[str, Any]], now: float) -> Iterator[str]:
    shown = list(islice(events, EVENTS))
    yield "<h2>Recent events</h2><ul class=rows>"
    for event in shown:
        yield f"<li><span class=when>{_at(event['time'], now)}, {span(now - event['time'])} ago"
        yield f"</span> {_text(event_text(event))}</li>"
    yield "</ul>" if shown else "</ul><p>None.</p>"


# -- on both ---------------------------------------------------------------------------------


def _head(title: str) -> Iterator[str]:
    yield '<!doctype html><html lang="en"><head><meta charset="utf-8">'
    yield '<meta name="viewport" content="width=device-width, initial-scale=1">'
    yield '<meta http-equiv="refresh" content="10">'
    yield f"<title>{escape(title)}</title><style>{STYLE}</style></head><body>"


def _marks(robot: dict[str, Any], now: float) -> Iterator[str]:
    """Downtime and flapping, as marks beside the robot's name."""
    if robot["maintenance"]:
        until = robot["maintenance_until"]
        end = "" if until is None else f" until {clock(until, now, local=False, seconds=False)}"
        yield f"<span class=mark>maintenance{end}</span> "
    flapping = sum(each["state"] == "flapping" and not each["well"] for each in robot["problems"])
    if flapping:
        yield "<span class=mark>flapping</span> "


def _problem(shown: ShownProblem, now: float, *, evidence: bool = False) -> str:
    problem, before = shown.problem, ""
    hard = "hard" if problem["confirmed"] is not None else "soft"
    if evidence and not shown.message.startswith(problem["evidence"]):
        before = f"<p class='text dim'>When confirmed: {_text(problem['evidence'])}</p>"
    return (
        f"<li>{_chip(shown.state)} <span class=what>{_text(shown.subject)}</span> "
        f"<span class={hard}>{escape(shown.standing)}</span> "
        f"<span class=when>since {_at(shown.since, now)}, for {span(now - shown.since)}"
        f"{'; ' if shown.notice else ''}{_text(shown.notice)}</span>"
        f"<p class=text>{_text(shown.message)}</p>{before}</li>"
    )


def _and_more(number: int, what: str, path: str) -> Iterator[str]:
    if number > 0:
        yield f'<p>and {number} more {what}: <a href="{path}">all of them</a></p>'


def _path(robot: str) -> str:
    """The robot's page as a link from the page of the fleet."""
    return f"robots/{_quoted(robot)}"


def _link(robot: str) -> str:
    return f'<a href="{_path(robot)}">{escape(robot)}</a>'


def _of_api(robot: dict[str, Any]) -> str:
    return f"../api/v1/fleet?robot={_quoted(robot['robot'])}"


def _quoted(name: str) -> str:
    """A name for a URL, its slashes too; what is no Unicode is replaced."""
    return quote(name, safe="", errors="replace")


def _chip(state: str) -> str:
    return f'<span class="chip {state}">{state}</span>'


def _at(unix: float, now: float) -> str:
    return clock(unix, now, local=False)


def _text(text: str) -> str:
    return escape(text if len(text) <= MAX_MESSAGE else text[:MAX_MESSAGE] + "…")


def escape(text: str) -> str:
    """Text for HTML: markup, invisible and direction-changing characters are escaped."""
    return escape_markup(one_line(text))
