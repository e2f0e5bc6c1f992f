from __future__ import annotations

from html.parser import HTMLParser

from ros_diagnostics_exporter.severity import state_of
from ros_diagnostics_exporter.web.pages import landing
from support.web_server import ask, component, fleet, robot

EVIL = "\"'><script>alert(1)</script><img src=x onerror=alert(1)>&amp;"
SILENT = {"up": False, "silent_reason": "mute"}


class _Reader(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict]] = []
        self.text = ""

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, data):
        self.text += data


def read(page: str) -> _Reader:
    reader = _Reader()
    reader.feed(page)
    return reader


def test_all_texts_of_robots_are_escaped():
    evil = robot(
        EVIL,
        component(EVIL, "ERROR", message=EVIL, group=EVIL, hardware_id=EVIL),
        silent_reason=EVIL,
    )
    given = {**fleet(evil, {**evil, "up": False}), "fleet": EVIL, "version": EVIL}
    page = read(landing(given, "/metrics"))
    assert not {tag for tag, _ in page.tags} & {"script", "img"}
    assert all(not name.startswith("on") for _, attrs in page.tags for name in attrs)
    assert page.text.count(EVIL) >= 5


def test_the_page_loads_nothing_and_its_policy_forbids_it(serve):
    answer = ask(serve(fleet_snapshot=lambda: fleet(robot("a"))), "/")
    page = read(answer.text)
    assert not {tag for tag, _ in page.tags} & {"script", "img", "link", "iframe"}
    assert not any("src" in attrs for _, attrs in page.tags)
    policy = answer.headers["Content-Security-Policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy


def test_all_links_of_the_page_work(serve):
    server = serve(telemetry_path="/m", fleet_snapshot=lambda: fleet(robot("a")))
    links = [attrs["href"] for tag, attrs in read(ask(server, "/").text).tags if tag == "a"]
    assert len(links) >= 5
    assert {ask(server, f"/{link}").status for link in links} == {200}


def test_a_silent_robot_is_unknown_and_one_never_seen_is_pending():
    ok, stale = component("x", "OK"), component("x", "STALE")
    warn, error = component("y", "WARN"), component("z", "ERROR")
    assert state_of(robot("a", ok)) == "OK"
    assert state_of(robot("a", ok, warn)) == "WARNING"
    assert state_of(robot("a", warn, stale)) == "STALE"
    assert state_of(robot("a", stale, error, warn)) == "CRITICAL"
    assert state_of(robot("a", error, **SILENT)) == "UNKNOWN"
    assert state_of(robot("a", up=False, silent_reason="never_seen")) == "PENDING"
    assert state_of(robot("a")) == "OK"


def test_problems_are_listed_worst_first_and_ok_robots_only_in_the_full_list():
    given = fleet(
        robot("fine", component("Motor 1", "OK")),
        robot("warned", component("Motor 2", "WARN")),
        robot("silent", component("Motor 3", "STALE"), **SILENT),
        robot("broken", component("Motor 4", "ERROR", message="Over temperature")),
    )
    text = read(landing(given, "/metrics")).text
    problems, _, everything = text.partition("All robots: 4")
    order = [problems.index(name) for name in ("silent", "broken", "warned")]
    assert order == sorted(order)
    assert "fine" not in problems
    assert "fine OK" in everything
    assert "Motor 4: ERROR Over temperature for 1 min" in problems
    assert "Motor 3" not in problems  # of a silent robot everything is stale


def test_a_silent_robots_earlier_fault_is_still_shown():
    given = fleet(robot("a", component("Motor 1", "STALE", level_before_stale="ERROR"), **SILENT))
    assert "Motor 1: STALE (was ERROR)" in read(landing(given, "/metrics")).text


def test_the_size_of_the_page_is_limited():
    long = component("Motor 1", "ERROR", message="&" * 100_000)
    broken = [robot(f"robot_{n}", long) for n in range(1_000)]
    page = landing(fleet(*broken), "/metrics")
    assert "and 800 more robots with problems" in page
    assert len(page) < 500_000


def test_stale_counts_as_configured_in_fleet_yml():
    critical = component("Arm", "STALE", state="CRITICAL")
    planned = component("Pendant", "STALE", planned_stale=True)
    text = read(landing(fleet(robot("a", critical, planned), robot("b", planned)), "/m")).text
    assert state_of(robot("a", critical, planned)) == "CRITICAL"
    assert state_of(robot("b", planned)) == "OK"
    assert "Arm: STALE, counts as CRITICAL (was OK)" in text
    assert "Pendant" not in text


def test_a_failed_check_is_critical_and_shows_the_numbers():
    short = {"check": "motors", "found": 1, "expected": 2}
    given = robot("a", component("Motor 1", "OK"), short_checks=[short])
    assert state_of(given) == "CRITICAL"
    assert "check motors finds 1 of 2" in read(landing(fleet(given), "/m")).text
