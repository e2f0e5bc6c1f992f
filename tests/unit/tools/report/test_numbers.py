"""The numbers of a week, of a Prometheus that the test plays."""

from collections.abc import Iterable
from urllib.parse import parse_qs, urlsplit

import pytest

from ros_diagnostics_exporter.http_client import UnreachableError
from ros_diagnostics_tools.report.availability import DAY, Recorded
from ros_diagnostics_tools.report.numbers import numbers

END = 1_790_000_000.0
WEEK = 7 * DAY
Series = tuple[dict[str, str], float]


class PlayedPrometheus:
    """Answers a query by the name of its series and its range; notes expression and time."""

    url = "http://prometheus:9090"

    def __init__(self) -> None:
        self.asked: list[tuple[str, float]] = []
        self.found: dict[tuple[str, str, float], list[Series]] = {}

    def has(self, record: str, days: int, end: float, series: Iterable[Series]) -> None:
        self.found[record, f"[{days}d]", end] = list(series)

    def get(self, path: str) -> object:
        query = parse_qs(urlsplit(path).query)
        (expr,), (moment,) = query["query"], query["time"]
        self.asked.append((expr, float(moment)))
        rows = [
            {"metric": labels, "value": [float(moment), str(seconds)]}
            for (record, days, end), series in self.found.items()
            if f"{record}:" in expr and days in expr and float(moment) == end
            for labels, seconds in series
        ]
        return {"data": {"result": rows}}


@pytest.fixture
def prometheus():
    return PlayedPrometheus()


def report(prometheus, fleet="hall", moments=()):
    return numbers(Recorded(prometheus, fleet), [], (END, None), 0.99, moments)


def part(name, **labels):
    return {"part": name, **labels}


def test_the_fleets_name_is_escaped_in_what_is_asked(prometheus):
    report(prometheus, 'a "hall"')
    assert prometheus.asked
    assert all('{fleet="a \\"hall\\""}' in expr for expr, _ in prometheus.asked)


def test_what_is_no_prometheus_is_named(prometheus):
    prometheus.get = lambda _path: {"data": []}
    with pytest.raises(UnreachableError, match="http://prometheus:9090 is not a Prometheus"):
        report(prometheus)


def test_the_week_is_beside_the_week_before(prometheus):
    prometheus.has("fleet", 7, END, [(part("ok"), 900.0), (part("critical"), 100.0)])
    prometheus.has("fleet", 7, END - WEEK, [(part("ok"), 500.0), (part("silent"), 500.0)])
    found = report(prometheus)
    assert (found["begin"], found["end"]) == (END - WEEK, END)
    assert found["week"]["availability"] == 0.9
    assert found["week_before"]["availability"] == 0.5


def test_the_budget_is_in_minutes(prometheus):
    prometheus.has("fleet", 7, END, [(part("ok"), 597_000.0), (part("critical"), 3_000.0)])
    assert report(prometheus)["week"]["budget_minutes"] == pytest.approx(50.0)
    assert report(prometheus)["week_before"]["budget_minutes"] is None


def test_the_robot_that_was_least_available_is_first_and_one_of_which_nothing_counts_last(
    prometheus,
):
    shares = {"r1": 0.9, "r10": 0.5, "r2": 0.5}
    series = [
        (part(name, robot=robot), seconds)
        for robot, share in shares.items()
        for name, seconds in (("ok", share), ("critical", 1 - share))
    ]
    prometheus.has("robot", 7, END, [(part("maintenance", robot="r0"), 9.0), *series])
    assert [each["robot"] for each in report(prometheus)["robots"]] == ["r2", "r10", "r1", "r0"]


def test_each_day_has_the_date_on_which_it_begins_the_oldest_first(prometheus):
    prometheus.has("robot", 7, END, [(part("ok", robot="r"), 1.0)])
    prometheus.has("robot", 1, END, [(part("ok", robot="r"), 1.0)])
    prometheus.has("robot", 1, END - 6 * DAY, [(part("critical", robot="r"), 1.0)])
    found = report(prometheus)
    assert found["days"][0] == "Mon 14 Sep"
    assert found["days"][-1] == "Sun 20 Sep"
    (robot,) = found["robots"]
    assert robot["days"] == [0.0, None, None, None, None, None, 1.0]


def test_the_capability_that_was_lost_for_longest_is_first(prometheus):
    prometheus.has(
        "capability",
        7,
        END,
        [
            (part("lost", robot="r", capability="lift"), 60.0),
            (part("able", robot="r", capability="lift"), 180.0),
            (part("unknown", robot="r", capability="lift"), 60.0),
            (part("lost", robot="r", capability="drive"), 600.0),
            (part("lost", robot="", capability="sort"), 100.0),
            (part("able", robot="r", capability="see"), 600.0),
        ],
    )
    found = report(prometheus)
    assert [each["capability"] for each in found["capabilities"]] == ["drive", "sort", "lift"]
    assert found["capabilities"][-1]["could"] == 0.6
    assert found["week"]["lost_seconds"] == 660.0  # of robots; the fleet lost it with one of them


GOALS = "action:ros_diagnostics_goals"
INTERVENTIONS = "robot:ros_diagnostics_interventions"
AUTONOMOUS = "robot:ros_diagnostics_autonomous_seconds"


def goals(robot, **results):
    return [({"robot": robot, "result": each}, number) for each, number in results.items()]


def test_a_fleet_without_goals_and_modes_has_no_missions(prometheus):
    found = report(prometheus)

    assert (found["missions"], found["because"]) == ([], [])
    assert found["week"]["missions"] is None


def test_the_robot_that_reached_the_fewest_of_its_goals_is_first(prometheus):
    prometheus.has(
        GOALS,
        7,
        END,
        [
            *goals("r1", succeeded=9.0, aborted=1.0, preempted=4.0),
            *goals("r2", succeeded=4.0, aborted=4.0, unknown=2.0),
        ],
    )
    prometheus.has(INTERVENTIONS, 7, END, [({"robot": "r3"}, 2.0), ({"robot": "r1"}, 1.0)])
    prometheus.has(AUTONOMOUS, 7, END, [({"robot": "r3"}, 7_200.0), ({"robot": "r1"}, 36_000.0)])
    found = report(prometheus)["missions"]

    assert [each["robot"] for each in found] == ["r2", "r1", "r3"]
    assert [each["success"] for each in found] == [0.5, 0.9, None]
    assert found[0]["unknown"] == 0.2
    assert [each["interventions_per_hour"] for each in found] == [None, 0.1, 1.0]


def test_the_missions_of_the_fleet_are_beside_those_of_the_week_before(prometheus):
    prometheus.has(GOALS, 7, END, goals("r1", succeeded=3.0) + goals("r2", aborted=1.0))
    prometheus.has(GOALS, 7, END - WEEK, goals("r1", succeeded=1.0))
    found = report(prometheus)

    assert found["week"]["missions"]["success"] == 0.75
    assert found["week"]["missions"]["interventions"] is None
    assert found["week_before"]["missions"]["success"] == 1.0


def aborted(time, about="Laser 1"):
    details = {"details": {"problems": [{"about": about, "state": "STALE"}]}} if about else {}
    return {"time": time, "kind": "goal", "component": "dock", "after": "aborted", **details}


def test_it_says_what_was_wrong_when_goals_of_the_week_were_aborted(prometheus):
    moments = [aborted(END - 60.0), aborted(END - 50.0), aborted(END - 40.0, "")]
    moments += [aborted(END - WEEK - 1), aborted(END + 1)]
    (text,) = report(prometheus, moments=moments)["because"]

    assert text == "3 goals of dock were aborted this week: 2 of them while Laser 1 was STALE."
