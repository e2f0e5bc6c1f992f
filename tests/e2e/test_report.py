"""The weekly report on a real Prometheus: availability as dashboards have it, mailed by SMTP."""

import json
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from ros_diagnostics_exporter.api.occurrences import occurrences
from ros_diagnostics_exporter.api.week import known, week
from ros_diagnostics_exporter.metrics.families import EXPORTER
from ros_diagnostics_exporter.metrics.week import ROWS
from ros_diagnostics_exporter.web.server import Server
from ros_diagnostics_tools.main import main
from support.committed_dashboards import filled, queries
from support.past import start_with
from support.web_server import serve
from testbed.engine import Engine
from testbed.site import Site

__all__ = ["serve"]  # a fixture
Report = Callable[..., Any]
SLOT = 300
DAY = 86_400
END = int(time.time()) // SLOT * SLOT
# Robot -> part -> its seconds of each slot; b is down for the last two days.
PARTS = {
    "a": lambda _at: {"ok": 240, "warning": 30, "critical": 30},
    "b": lambda at: {"silent": 300} if at > END - 2 * DAY else {"ok": 200, "maintenance": 100},
    "new": lambda at: {"ok": 300} if at > END - DAY else {},
}
# (robot, capability) -> part -> its seconds of each slot of the last two days.
CAPABILITIES = {
    ("a", "lifting"): {"able": 200, "lost": 100},
    ("b", "lifting"): {"able": 300},
    ("", "transport"): {"able": 150, "lost": 60, "unknown": 90},
}
# Robot -> result -> goals of each slot of the last two days; `a` says when it works by itself.
GOALS = {
    "a": {"succeeded": 3, "aborted": 1, "cancelled": 1, "preempted": 5, "unknown": 1},
    "b": {"succeeded": 2, "aborted": 0},
}
LABELS = {"scope": "component", "state": "critical", "severity": "critical", "robot": "a"}


def samples() -> str:
    """Both records of two weeks as OpenMetrics, each fifteen days a series."""
    robot, fleet = list[str](), dict[str, dict[int, int]]()
    for name, of in PARTS.items():
        for part in ("ok", "warning", "critical", "silent", "maintenance"):
            for at in range(END - 15 * DAY + SLOT, END + 1, SLOT):
                seconds = of(at).get(part, 0)
                if seconds:
                    robot.append(
                        f'robot:ros_diagnostics_part_seconds:sum5m{{fleet="hall",robot="{name}",'
                        f'part="{part}"}} {seconds} {at}'
                    )
                    of_part = fleet.setdefault(part, {})
                    of_part[at] = of_part.get(at, 0) + seconds
    lines = [
        f'fleet:ros_diagnostics_part_seconds:sum5m{{fleet="hall",part="{part}"}} {seconds} {at}'
        for part, by_time in fleet.items()
        for at, seconds in sorted(by_time.items())
    ]
    able = [
        f'capability:ros_diagnostics_part_seconds:sum5m{{fleet="hall",robot="{robot}",'
        f'capability="{name}",part="{part}"}} {seconds} {at}'
        for (robot, name), parts in CAPABILITIES.items()
        for part, seconds in parts.items()
        for at in range(END - 2 * DAY + SLOT, END + 1, SLOT)
    ]
    types = "# TYPE {}:ros_diagnostics_part_seconds:sum5m gauge"
    records = [types.format("robot"), *robot, types.format("fleet"), *lines]
    records += [types.format("capability"), *able]
    return "\n".join([*records, *work(), *families_of_the_week(), "# EOF\n"])


def work() -> Iterator[str]:
    """What robots did in the last two days, as rules record it."""
    slots = range(END - 2 * DAY + SLOT, END + 1, SLOT)
    name = "action:ros_diagnostics_goals:increase5m"
    yield f"# TYPE {name} gauge"
    for robot, results in GOALS.items():
        for result, number in results.items():
            labels = f'fleet="hall",robot="{robot}",action="go",result="{result}"'
            yield from (f"{name}{{{labels}}} {number} {at}" for at in slots)
    for name, number in (("interventions", 0.25), ("autonomous_seconds", 200)):
        series = f"robot:ros_diagnostics_{name}:increase5m"
        yield f"# TYPE {series} gauge"
        labels = 'fleet="hall",robot="a"'
        yield from (f"{series}{{{labels}}} {number} {at}" for at in slots)


def families_of_the_week() -> Iterator[str]:
    """What an exporter with this event log served at the end of either week."""
    weeks = [(end, week(known(occurrences(log()), []), end)) for end in (END - 7 * DAY, END)]
    for family, read in ROWS:
        names = ("fleet", *family.labels[len(EXPORTER) :])
        yield f"# TYPE {family.name} gauge"
        series: dict[tuple[str, ...], list[str]] = {}
        for end, found in weeks:
            for labels, value in read(found):
                series.setdefault(("hall", *labels), []).append(f"{value} {end}")
        for labels, values in series.items():
            pairs = ",".join(f'{n}="{v}"' for n, v in zip(names, labels, strict=True))
            yield from (f"{family.name}{{{pairs}}} {value}" for value in values)


@pytest.fixture
def prometheus(site: Site) -> Engine:
    """A Prometheus that has the records of two weeks."""
    return start_with(site, site.write("weeks.om", samples()))


def log() -> list[dict[str, Any]]:
    """The events of two faults of the week, and of one of the week before."""
    of = {**LABELS, "group": "/Motor", "component": "Motor 1", "robot": "a"}
    events = []
    for number, at in enumerate([END - 3 * DAY, END - 2 * DAY, END - 9 * DAY]):
        since = {"since": at - 60.0, **of}
        events += [
            {"time": float(at), "kind": "fault_began", **since},
            {"time": at + 5.0, "kind": "notified", "after": "firing", "receiver": "x", **since},
            {"time": at + 120.0 * (number + 1), "kind": "acknowledged", "author": "n", **since},
            {"time": at + 600.0, "kind": "fault_ended", "reason": "recovered", **since},
        ]
    wrong = {"details": {"problems": [{"about": "Laser 1", "state": "STALE"}]}}
    for at, details in ((END - DAY, wrong), (END - 100, {}), (END - 8 * DAY, wrong)):
        of_goal = {"robot": "a", "component": "go", "after": "aborted"}
        events.append({"time": float(at), "kind": "goal", **of_goal, **details})
    return [{"id": number, **each} for number, each in enumerate(events, 1)]


@pytest.fixture
def exporter(serve):
    """One with that event log."""
    return serve(
        faults=lambda: {"fleet": "hall", "time": 0.0, "faults": [], "events_since": 1.0},
        find_events=lambda wanted: [each for each in log() if each["kind"] == wanted.kind][::-1],
    )


@pytest.fixture
def report(prometheus: Engine, exporter: Server, capsys: pytest.CaptureFixture[str]) -> Report:
    """A function that has the command write the report of that week; its JSON, if it is that."""
    asked = ["--url", f"http://{exporter.addresses[0]}", "--until", _iso(END)]
    asked += ["--prometheus", f"http://{prometheus.address}", "--target", "95"]

    def report(*words: str) -> Any:
        assert main(["report", "--week", *asked, *words]) == 0
        said = capsys.readouterr().out
        return json.loads(said) if "json" in words else said

    return report


def panel(title: str) -> str:
    """The query of a panel of the shipped dashboard, over seven days."""
    exprs = (each.expr for each in queries() if each.place == title and each.ref == "A")
    return filled(next(exprs), {"fleet": "hall", "__range": "7d"})


def test_the_report_has_the_numbers_of_the_dashboards_and_is_mailed(site, prometheus, report):
    found = report("--output", "json")

    for title, names in (
        ("Availability of the robots", "robot"),
        ("Availability of the fleets", ""),
    ):
        shown = {
            each.labels.get(names, ""): each.value
            for each in prometheus.query(panel(title), END)
            if each.labels["part"] == "available"
        }
        reported = {each["robot"]: each["availability"] for each in found["robots"]}
        mine = reported if names else {"": found["week"]["availability"]}
        assert mine == pytest.approx(shown)
    assert found["robots"][0]["robot"] == "b"
    assert found["robots"][0]["availability"] == nearly(5 * 200 / (5 * 200 + 2 * 300))
    days = {each["robot"]: each["days"] for each in found["robots"]}
    assert days["b"] == nearly([1.0] * 5 + [0.0] * 2)
    assert days["new"] == [None] * 6 + [1.0]
    assert days["a"] == pytest.approx([0.9] * 7)

    slots = DAY / SLOT
    counted = slots * (7 * 300 + 5 * 200 + 2 * 300 + 300)
    lost = slots * (7 * 30 + 2 * 300)
    assert found["week"]["budget_minutes"] == pytest.approx(
        (0.05 * counted - lost) / 60, abs=2 * SLOT / 60
    )
    assert found["week_before"]["availability"] == nearly((270 + 200) / 500)
    assert found["week"]["to_acknowledge"] == {"number": 2, "median": 180.0, "longest": 240.0}
    assert found["week"]["to_recover"] == {"number": 2, "median": 660.0, "longest": 660.0}
    assert (found["week"]["faults"], found["week"]["notifications"]) == (2, 2)
    assert found["week_before"]["faults"] == 1
    assert found["week_before"]["to_acknowledge"]["median"] == 360.0
    assert [each["robot"] for each in found["capabilities"]] == ["a", ""]
    assert found["capabilities"][0]["could"] == pytest.approx(2 / 3)
    assert found["week"]["lost_seconds"] == pytest.approx(2 * slots * 100, abs=100)
    assert found["week_before"]["lost_seconds"] == 0
    assert [each["robot"] for each in found["missions"]] == ["a", "b"]
    assert found["missions"][0]["success"] == 0.75
    because = "2 goals of go were aborted this week: 1 of them while Laser 1 was STALE."
    assert found["because"] == [because]
    [part] = found["worst_parts"]
    assert (part["robot"], part["times"], part["seconds"]) == ("a", 2, 1_320.0)

    site.start_mail_server()
    to = ("--mail-to", "shift@example.org", "--mail-from", "portal@example.org")
    report(*to, "--smtp", site.addresses.smtp)
    [sent] = site.inbox.mails()
    assert sent.recipients == ("shift@example.org",)
    assert sent.subject.startswith("hall: robots, week until ")
    share = f"{found['week']['availability'] * 100:.2f} %"
    assert f"Availability: {share}" in sent.text
    assert f"<td>{share}</td>" in sent.html
    goals = round(slots * 2 * (3 + 1 + 2))
    assert f"Missions: Success: 83 % of {goals} goals; " in sent.text
    for shown_in in (sent.text, sent.html):
        assert because in shown_in
    file = site.folder / "report.html"
    report("--file", str(file))
    assert file.read_text().split() == sent.html.split()


def test_the_dashboard_of_the_week_has_the_numbers_of_the_report(prometheus, report):
    found = report("--output", "json")
    chosen = {"fleet": "hall", "target": "95", "__range": "7d"}
    shown = {
        (each.place, each.ref): prometheus.query(filled(each.expr, chosen), END)
        for each in queries()
        if each.board == "ros-diagnostics-week"
    }

    def values(title: str, ref: str, *by: str) -> dict[tuple[str, ...], float]:
        rows = shown[title, ref]
        return {tuple(row.labels.get(n, "") for n in by): row.value for row in rows}

    def beside(title: str, refs: str, of: Callable[[dict[str, Any]], float]) -> None:
        weeks = [of(found[name]) for name in ("week", "week_before")]
        assert [values(title, ref)[()] for ref in refs] == pytest.approx(weeks), title

    beside("Availability", "AB", lambda week: week["availability"])
    beside("Budget left (robot minutes)", "AB", lambda week: week["budget_minutes"])
    beside("Critical faults", "AB", lambda week: week["faults"])
    beside("Notifications", "AB", lambda week: week["notifications"])
    for title, name in (
        ("Time to acknowledge", "to_acknowledge"),
        ("Time to recover", "to_recover"),
    ):
        beside(title, "AE", lambda week, name=name: week[name]["number"])
        beside(title, "BD", lambda week, name=name: week[name]["median"])
        assert values(title, "C")[()] == found["week"][name]["longest"]

    robots = {(each["robot"],): each for each in found["robots"]}
    expected = {("Week", *robot): each["availability"] for robot, each in robots.items()}
    for back in range(7):
        name = time.strftime("%a %-d", time.gmtime(END - (back + 0.5) * 86_400))
        expected |= {(name, *robot): each["days"][6 - back] for robot, each in robots.items()}
    of_days = values("Availability by day", "A", "day", "robot")
    assert {key: share for key, share in of_days.items() if key[0] != "Known for"} == (
        pytest.approx({key: share for key, share in expected.items() if share is not None})
    )

    parts = {(each["robot"], each["part"]): each for each in found["worst_parts"]}
    for ref, key in (("A", "seconds"), ("B", "times")):
        assert values("Faulty for longest", ref, "robot", "faulty") == {
            part: each[key] for part, each in parts.items()
        }
    nights = {(night,): number for night, number in found["nights"].items()}
    assert values("Notifications by night", "A", "night") == nights
    could = values("Availability of capabilities", "A", "robot", "capability", "part")
    for each in found["capabilities"]:
        assert could[each["robot"], each["capability"], "able"] == pytest.approx(each["could"])
    titles = {title for title, _ref in shown if not title.startswith("$")}
    assert len(titles) == 12  # with the banner's two: none is left out above


def test_the_numbers_of_missions_are_those_of_the_dashboard(prometheus, report):
    found = report("--output", "json")["week"]["missions"]
    chosen = {"fleet": "hall", "__range": "7d"}

    for title, name in (
        ("Success", "success"),
        ("Unknown", "unknown"),
        ("Interventions per hour", "interventions_per_hour"),
        ("Hours between interventions", "hours_between_interventions"),
    ):
        (expr,) = (
            each.expr
            for each in queries()
            if (each.board, each.place, each.ref) == ("ros-diagnostics-missions", title, "A")
        )
        (shown,) = prometheus.query(filled(expr, chosen), END)
        assert found[name] == pytest.approx(shown.value, abs=0.0001), title


def nearly(expected: object) -> object:
    """Before Prometheus 3 both ends of a range belong to it: a slot of a day more."""
    return pytest.approx(expected, abs=SLOT / DAY)


def _iso(unix: int) -> str:
    return time.strftime("%Y-%m-%dT%H:%M:%S+00:00", time.gmtime(unix))


@pytest.mark.parametrize(
    "wrong",
    [["--week", "--mail-to", "a@b"], ["--week", "--smtp", "x"], ["--week", "--target", "101"]],
)
def test_wrong_arguments_are_said(wrong):
    assert main(["report", *wrong]) == 2


def test_what_is_no_prometheus_is_said(exporter, capsys):
    url = f"http://{exporter.addresses[0]}"
    assert main(["report", "--week", "--url", url, "--prometheus", url]) == 1
    assert "404" in capsys.readouterr().err
