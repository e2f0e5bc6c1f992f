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


def test_everything_that_robots_say_is_escaped():
    evil = robot(
        EVIL,
        component(EVIL, "ERROR", message=EVIL, group=EVIL, hardware_id=EVIL),
        silent_reason=EVIL,
    )
    said = {**fleet(evil, {**evil, "up": False}), "fleet": EVIL, "version": EVIL}
    page = read(landing(said, "/metrics"))
    assert not {tag for tag, _ in page.tags} & {"script", "img"}
    assert all(not name.startswith("on") for _, attrs in page.tags for name in attrs)
    assert page.text.count(EVIL) >= 5


def test_the_page_loads_nothing_and_the_browser_is_told_so(serve):
    answer = ask(serve(fleet=lambda: fleet(robot("a"))), "/")
    page = read(answer.text)
    assert not {tag for tag, _ in page.tags} & {"script", "img", "link", "iframe"}
    assert not any("src" in attrs for _, attrs in page.tags)
    policy = answer.headers["Content-Security-Policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy


def test_all_links_of_the_page_lead_somewhere(serve):
    server = serve(telemetry_path="/m", fleet=lambda: fleet(robot("a")))
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


def test_the_worst_robots_come_first_and_fine_ones_only_in_the_list():
    said = fleet(
        robot("fine", component("Motor 1", "OK")),
        robot("warned", component("Motor 2", "WARN")),
        robot("silent", component("Motor 3", "STALE"), **SILENT),
        robot("broken", component("Motor 4", "ERROR", message="Over temperature")),
    )
    text = read(landing(said, "/metrics")).text
    problems, _, everything = text.partition("All robots: 4")
    order = [problems.index(name) for name in ("silent", "broken", "warned")]
    assert order == sorted(order)
    assert "fine" not in problems
    assert "fine OK" in everything
    assert "Motor 4: ERROR Over temperature for 1 min" in problems
    assert "Motor 3" not in problems  # of a silent robot everything is stale


def test_a_fault_of_a_robot_that_fell_silent_is_still_shown():
    said = fleet(robot("a", component("Motor 1", "STALE", level_before_stale="ERROR"), **SILENT))
    assert "Motor 1: STALE (was ERROR)" in read(landing(said, "/metrics")).text


def test_a_thousand_robots_make_a_page_that_a_phone_can_show():
    long = component("Motor 1", "ERROR", message="&" * 100_000)
    broken = [robot(f"robot_{n}", long) for n in range(1_000)]
    page = landing(fleet(*broken), "/metrics")
    assert "and 800 more robots with problems" in page
    assert len(page) < 500_000


def test_stale_counts_as_what_fleet_yml_says():
    critical = component("Arm", "STALE", state="CRITICAL")
    planned = component("Pendant", "STALE", planned_stale=True)
    text = read(landing(fleet(robot("a", critical, planned), robot("b", planned)), "/m")).text
    assert state_of(robot("a", critical, planned)) == "CRITICAL"
    assert state_of(robot("b", planned)) == "OK"
    assert "Arm: STALE, counts as CRITICAL (was OK)" in text
    assert "Pendant" not in text


def test_a_check_that_finds_too_few_is_critical_and_says_how_few():
    short = {"check": "motors", "found": 1, "expected": 2}
    said = robot("a", component("Motor 1", "OK"), short_checks=[short])
    assert state_of(said) == "CRITICAL"
    assert "check motors finds 1 of 2" in read(landing(fleet(said), "/m")).text
