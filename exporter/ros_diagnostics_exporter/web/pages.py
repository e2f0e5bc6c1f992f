"""The landing page: an overview of the fleet in one self-contained HTML page, for phones too."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator
from html import escape as escape_markup
from typing import Any

from ros_diagnostics_exporter import __version__
from ros_diagnostics_exporter.severity import (
    SEVERITIES,
    ago,
    faults_of,
    level_text,
    short_check_texts,
    state_of,
)
from ros_diagnostics_exporter.texts import natural, one_line

MAX_MESSAGE = 300  # characters of a component's message
MAX_LISTED = 200  # robots with problems, and components of one robot; the API has them all

STYLE = """
:root { color-scheme: light dark; --line: #8884; }
body { font: 16px/1.45 system-ui, sans-serif; margin: 0 auto; max-width: 60rem; padding: 1rem; }
h1 { font-size: 1.4rem; margin: 0; overflow-wrap: anywhere; }
h2 { font-size: 1.1rem; margin: 1.6rem 0 .4rem; }
nav { margin: .6rem 0; } nav a { margin-right: 1rem; white-space: nowrap; }
.sum { display: flex; flex-wrap: wrap; gap: .5rem; padding: 0; list-style: none; }
.sum li { border: 1px solid var(--line); border-radius: .5rem; padding: .3rem .8rem; }
.sum b { font-size: 1.3rem; margin-right: .3rem; }
article { border: 1px solid var(--line); border-left-width: .5rem; border-radius: .3rem;
  margin: .5rem 0; padding: .4rem .8rem; overflow-wrap: anywhere; }
article ul { margin: .2rem 0; padding-left: 1.1rem; }
.UNKNOWN { border-left-color: #7c4dcc; } .CRITICAL { border-left-color: #d4213d; }
.STALE { border-left-color: #8a6d3b; } .WARNING { border-left-color: #e0a100; }
.OK { border-left-color: #2e8b57; } .PENDING { border-left-color: #888; }
.word { font-weight: 600; } .dim { opacity: .75; }
.all { columns: 12rem; padding: 0; list-style: none; overflow-wrap: anywhere; }
"""


def landing(fleet: dict[str, Any], telemetry_path: str) -> str:
    """The page for ``fleet``, as /api/v1/fleet returns it; all texts in it are escaped."""
    states = [(state_of(robot), robot) for robot in fleet["robots"]]
    states.sort(key=lambda each: (-SEVERITIES[each[0]], natural(each[1]["robot"])))
    return "".join(_page(fleet, states, telemetry_path))


def _page(
    fleet: dict[str, Any], states: list[tuple[str, dict[str, Any]]], telemetry_path: str
) -> Iterator[str]:
    title = f"{fleet['fleet']}: ROS diagnostics"
    yield '<!doctype html><html lang="en"><head><meta charset="utf-8">'
    yield '<meta name="viewport" content="width=device-width, initial-scale=1">'
    yield '<meta http-equiv="refresh" content="10">'
    yield f"<title>{escape(title)}</title><style>{STYLE}</style></head><body>"
    yield f"<h1>{escape(title)}</h1><p class=dim>ros-diagnostics-exporter {escape(__version__)}, "
    yield f"{_moment(fleet['time'])}</p>"
    # Relative links, for proxies that add a path prefix.
    yield f'<nav><a href="{escape(telemetry_path.lstrip("/"))}">Metrics</a> '
    yield '<a href="api/v1/fleet">Fleet (JSON)</a> <a href="api/v1/events">Events (JSON)</a> '
    yield '<a href="-/ready">Ready</a> <a href="api/v1/openapi.json">OpenAPI</a></nav>'
    yield from _summary(Counter(state for state, _ in states))
    yield from _problems([each for each in states if each[0] not in {"OK", "PENDING"}], fleet)
    yield from _all(states)
    yield "</body></html>\n"


def _summary(count: Counter[str]) -> Iterator[str]:
    yield "<ul class=sum>"
    for state in SEVERITIES:
        if count[state] or state == "OK":
            yield f"<li><b>{count[state]}</b>{state}</li>"
    yield "</ul>"


def _problems(states: list[tuple[str, dict[str, Any]]], fleet: dict[str, Any]) -> Iterator[str]:
    yield f"<h2>Robots with problems: {len(states)}</h2>"
    if not states:
        yield "<p>None.</p>"
    for state, robot in states[:MAX_LISTED]:
        yield f'<article class="{state}"><span class=word>{escape(robot["robot"])}</span> {state}'
        if not robot["up"]:
            yield f" ({escape(robot['silent_reason'] or 'silent')})"
        if robot["maintenance"]:
            yield " <span class=dim>in maintenance</span>"
        yield from _faults(robot, fleet["time"])
        yield "</article>"
    yield from _and_more(len(states) - MAX_LISTED, "robots with problems")


def _faults(robot: dict[str, Any], now: float) -> Iterator[str]:
    faults = faults_of(robot)
    yield "<ul>"
    for short in short_check_texts(robot):
        yield f"<li>{escape(short)}</li>"
    for each in faults[:MAX_LISTED]:
        before = each["level_before_stale"]
        was = f" (was {escape(before)})" if before else ""
        yield f"<li>{escape(each['component'])}: <span class=word>{escape(level_text(each))}</span>"
        yield f"{was} {_message(each['message'])} <span class=dim>{ago(each['since'], now)}</span>"
        yield "</li>"
    yield "</ul>"
    yield from _and_more(len(faults) - MAX_LISTED, "components")


def _all(states: list[tuple[str, dict[str, Any]]]) -> Iterator[str]:
    yield f"<h2>All robots: {len(states)}</h2><ul class=all>"
    for state, robot in sorted(states, key=lambda each: natural(each[1]["robot"])):
        yield f"<li>{escape(robot['robot'])} <span class=dim>{state}</span></li>"
    yield "</ul>"


def _and_more(number: int, what: str) -> Iterator[str]:
    if number > 0:
        yield f'<p>and {number} more {what}: <a href="api/v1/fleet">Fleet (JSON)</a></p>'


def _message(text: str) -> str:
    return escape(text if len(text) <= MAX_MESSAGE else text[:MAX_MESSAGE] + "…")


def escape(text: str) -> str:
    """Text for HTML: markup, invisible and direction-changing characters are escaped."""
    return escape_markup(one_line(text))


def _moment(unix: float) -> str:
    return time.strftime("%Y-%m-%d %H:%M:%S UTC", time.gmtime(unix))
