"""The dashboards in a real Grafana, seen in Chromium: texts, colours, links, a dead monitoring."""

import re
from collections.abc import Iterator
from contextlib import ExitStack
from typing import Any, NamedTuple
from urllib.parse import parse_qs, urlsplit

import pytest

from e2e.dashboards import browser, odd_names
from e2e.dashboards.watched_fleet import WatchedFleet
from support.committed_dashboards import BOARDS
from support.served_fleet import serving
from testbed.polling import until
from testbed.site import Site

ABSENT = browser.missing()
pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(900),
    pytest.mark.skipif(bool(ABSENT), reason=ABSENT),
]

FLEET = "ros-diagnostics-fleet"
ROBOT = "ros-diagnostics-robot"
COMPONENT = "ros-diagnostics-component"
ALERTS = "ros-diagnostics-alerts"
MONITORING = "ros-diagnostics-monitoring"
WEEK = "ros-diagnostics-week"
WALL = "kiosk&_dash.hideVariables&_dash.hideLinks&_dash.hideTimePicker"  # as docs say
NONE_OF_BROKEN = {"Values with a metric of their own"}  # which that robot does not have
OF_THE_WEEK = [  # as counted by the exporter, of which the history has the end alone
    panel["title"]
    for panel in BOARDS[WEEK]["panels"]
    if any("ros_diagnostics_week_" in each["expr"] for each in panel.get("targets", ()))
]


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    with browser.windows() as found:
        yield found


@pytest.fixture(scope="module")
def grafana(watched: WatchedFleet, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with browser.serving(watched.site) as address:
        yield address


@pytest.fixture
def page(chromium: Any, grafana: str) -> Iterator[browser.Page]:
    yield from window(chromium, grafana, browser.TALL)


def window(chromium: Any, address: str, size: tuple[int, int]) -> Iterator[browser.Page]:
    width, height = size
    page = chromium.new_page(viewport={"width": width, "height": height})
    page.set_default_timeout(120_000)  # ms: a busy machine takes long to load Grafana's pages
    try:
        yield browser.Page(address, page)
    finally:
        page.close()


# --- A fleet in every state ---


@pytest.mark.parametrize("board", BOARDS)
def test_every_panel_shows_data_and_no_error(page: browser.Page, board: str):
    chosen = {"fleet": "hall", "robot": "broken"} if board == ROBOT else {}
    page.open(board, last="6h", **chosen)  # recorded until half an hour ago
    page.wait_for("Data as of", ":")
    titles = set(shown(board)) - NONE_OF_BROKEN - set(OF_THE_WEEK)
    without = ""

    def all_have_data() -> bool:
        nonlocal without
        texts = {title: page.text(title) for title in titles}
        without = ", ".join(title for title, text in texts.items() if "No data" in text)
        return not without

    until(all_have_data, lambda: f"data in {without}", 150, every=1)
    page.page.wait_for_load_state("networkidle")
    errors = page.page.locator(
        ".panel-info-corner--error, [data-testid='data-testid Panel status error']"
    )
    assert errors.count() == 0


def test_the_numbers_of_the_week_are_shown_with_data(page: browser.Page, watched: WatchedFleet):
    page.open_until(WEEK, watched.history_end)
    assert len(OF_THE_WEEK) >= 5
    nothing = {"", "No data"}
    for title in OF_THE_WEEK:
        until(lambda title=title: page.text(title) not in nothing, f"data in {title!r}", 120)


def test_pings_and_computers_are_shown_with_data(page: browser.Page):
    page.open(MONITORING)
    shown = BOARDS[MONITORING]["panels"]
    rows = [row for row in shown if row["type"] == "row" and row["title"] in {"Hosts", "Computers"}]
    for row in rows:
        title = re.compile(rf"^{row['title']}( \(|$)")  # Grafana 9 writes the number behind it
        # Not click(): it waits until the page is idle, which is long with all panels in view.
        page.page.get_by_text(title).first.evaluate("row => row.click()")
    page.wait_for("Hosts", "ap_9")
    page.wait_for("Computers", "well")
    titles = [panel["title"] for row in rows for panel in row["panels"]]
    for title in titles:
        until(lambda title=title: "No data" not in page.text(title), f"data in {title!r}", 120)

    probes = sorted(row[:3] for row in page.rows("Hosts"))
    assert probes == [
        ["down", "ap_9", "uplink"],
        ["down", "warned", "http"],
        ["up", "well", "ping"],
    ]
    (computer,) = page.rows("Computers")
    assert computer[:2] == ["up", "well"]
    assert all(computer), "a cell is empty"


def shown(board: str) -> list[str]:
    """The titles of all panels whose row is open, without those with a variable in it."""
    return [
        panel["title"]
        for panel in BOARDS[board]["panels"]
        if panel["type"] != "row" and "$" not in panel["title"]
    ]


def test_problems_are_listed_with_state_message_and_acknowledgement(page: browser.Page):
    page.open(FLEET)
    page.wait_for("Problems", "spare part ordered")
    rows = page.rows("Problems")

    (motor,) = (row for row in rows if (row[1], row[3]) == ("broken", "Motor 1"))
    assert motor[0] == "CRITICAL"
    assert motor[2].startswith("Motor failure; values: Temperature: 42 degC")
    assert motor[5] == "acknowledged by ann: spare part ordered"
    (silent,) = (row for row in rows if row[1] == "silent")
    assert silent[0] == "SILENT"
    assert silent[2].startswith("nobody publishes on its topics")
    (fresh,) = (row for row in rows if row[1] == "fresh")
    assert fresh[5] == "nobody yet: not confirmed"
    (maintained,) = (row for row in rows if row[1] == "maintained")
    assert maintained[5] == "maintenance"
    (cut_off,) = (row for row in rows if row[1] == "cut_off")
    assert (cut_off[0], rows[-1]) == ("UNREACHABLE", cut_off), "its uplink explains it"
    rows = [row for row in rows if row not in (cut_off, maintained)]
    order = ["CRITICAL", "SILENT", "STALE", "FLAPPING", "WARNING", "PENDING"]
    assert [row[0] for row in rows] == sorted((row[0] for row in rows), key=order.index)


@pytest.mark.parametrize(
    ("rank", "state"),
    [(6, "CRITICAL"), (5, "SILENT"), (3, "UNREACHABLE"), (2, "STALE"), (1, "WARNING")],
)
def test_a_state_has_its_colour_in_a_table(page: browser.Page, rank: int, state: str):
    page.open(FLEET, state=f"== {rank}")
    page.wait_for("Problems", state)

    assert page.background("Problems", state) == f"rgb({', '.join(map(str, COLOURS[state]))})"


COLOURS = {
    "CRITICAL": (193, 18, 31),
    "SILENT": (27, 58, 134),
    "UNREACHABLE": (144, 190, 248),
    "STALE": (147, 80, 201),
    "WARNING": (255, 217, 47),
    "OK": (31, 127, 99),
    "PENDING": (208, 208, 208),
}


@pytest.mark.parametrize(
    ("board", "title", "states"),
    [
        (FLEET, "States of the robots", set(COLOURS)),
        (ROBOT, "States of the components", {"CRITICAL", "WARNING", "OK"}),
        (COMPONENT, "State over time", {"CRITICAL", "STALE", "OK"}),
    ],
)
def test_a_timeline_has_the_colours_of_the_states(
    page: browser.Page, board: str, title: str, states: set[str]
):
    chosen = {ROBOT: {"fleet": "hall", "robot": "broken"}, COMPONENT: {"component": "Motor 1"}}
    page.open(board, **chosen.get(board, {}))
    page.panel(title).locator("canvas").first.wait_for(state="attached")
    missing: set[str] = set()

    def all_are_there() -> bool:
        nonlocal missing
        found = page.pixels(title)
        missing = {state for state in states if not any(near(COLOURS[state], c) for c in found)}
        return not missing

    until(all_are_there, lambda: f"colours of {missing}: {page.pixels(title)}", 150, every=1)
    others = set(COLOURS) - states
    assert not [c for c in page.pixels(title) for state in others if near(COLOURS[state], c)]


def near(one: tuple[int, int, int], other: tuple[int, int, int]) -> bool:
    return all(abs(a - b) <= 4 for a, b in zip(one, other, strict=True))


def test_the_menu_leads_from_a_component_to_a_robot(page: browser.Page):
    """It passes all variables: "All" robots of one page are no robot of the other."""
    page.open(COMPONENT, component="Motor 1", robots="$__all")
    page.wait_for("State on each robot", "broken")
    page.page.get_by_text("ROS diagnostics", exact=True).last.click()
    target = page.page.locator(f"a[href*='/d/{ROBOT}']").first.get_attribute("href")
    page.follow(target)

    page.wait_for("All components", "Battery")


def test_on_a_phone_the_first_screen_has_problems(chromium: Any, grafana: str):
    for page in window(chromium, grafana, browser.PHONE):
        page.open(FLEET)
        page.wait_for("Problems", "CRITICAL")

        first = page.panel("Problems").get_by_text("CRITICAL").first.bounding_box()
        assert first["y"] + first["height"] <= browser.PHONE[1]


def test_on_a_wall_one_screen_has_problems_robots_and_the_time(chromium: Any, grafana: str):
    for page in window(chromium, grafana, browser.WALL):
        page.follow(f"/d/{FLEET}?{WALL}&from=now-10m&to=now")
        page.wait_for("Problems", "CRITICAL")

        shown_first = ("Robots by state", "Problems", "All robots of north")
        for title in ("Data as of", *shown_first):
            box = page.panel(title).bounding_box()
            assert box["y"] + box["height"] <= browser.WALL[1], title


# --- Odd names, and a monitoring that dies ---


class OddSite(NamedTuple):
    """A fleet with odd names, and how to end its exporter."""

    grafana: str
    fleet: odd_names.OddFleet
    site: Site
    exporter: ExitStack


@pytest.fixture(scope="module")
def odd(tmp_path_factory: pytest.TempPathFactory) -> Iterator[OddSite]:
    folder = tmp_path_factory.mktemp("odd")
    fleet = odd_names.OddFleet(folder)
    with ExitStack() as exporter, Site(folder) as site:
        address = exporter.enter_context(serving(fleet.served.scrape))
        site.start_alertmanager()
        site.start_prometheus(exporters=[address], interval=1)
        site.wait_until_ready()
        with browser.serving(site) as grafana:
            fault = 'fleet:ros_diagnostics_fault_start:held{scope="component"}'
            until(lambda: site.query(fault), "a confirmed fault", 60, every=0.5)
            yield OddSite(grafana, fleet, site, exporter)


@pytest.fixture
def odd_page(chromium: Any, odd: OddSite) -> Iterator[browser.Page]:
    yield from window(chromium, odd.grafana, browser.TALL)


def test_links_with_odd_names_lead_to_their_robot_and_component(odd_page: browser.Page):
    odd_page.open(FLEET)
    odd_page.wait_for("Problems", odd_names.COMPONENT)
    to_robot = odd_page.link("Problems", odd_names.ROBOT)
    to_component = odd_page.link("Problems", odd_names.COMPONENT)

    assert parse_qs(urlsplit(to_robot).query)["var-robot"] == [odd_names.ROBOT]
    assert parse_qs(urlsplit(to_component).query)["var-component"] == [odd_names.COMPONENT]
    odd_page.follow(to_robot)
    odd_page.wait_for("Problems", odd_names.COMPONENT)
    odd_page.wait_for("Values without a unit", odd_names.KEY)
    odd_page.follow(to_component)
    odd_page.wait_for("State on each robot", odd_names.ROBOT)
    odd_page.wait_for("Outliers", odd_names.ROBOT)


def test_a_healthy_fleet_has_no_problems(odd: OddSite, odd_page: browser.Page):
    odd_page.open(FLEET)
    odd_page.wait_for("Working robots", "0%")  # its only robot is CRITICAL
    odd.fleet.broken = False
    odd_page.page.reload()

    odd_page.wait_for("Problems", "No problems")
    odd_page.wait_for("Working robots", "100%")
    odd.fleet.broken = True
    odd_page.page.reload()
    odd_page.wait_for("Problems", "CRITICAL")


def test_a_dead_alertmanager_is_announced_and_faults_stay(odd: OddSite, odd_page: browser.Page):
    odd.site.alertmanager.process.stop()
    odd_page.open(FLEET)

    odd_page.wait_for(
        "Monitoring", f"Alertmanager {odd.site.addresses.alertmanager} has not answered for"
    )
    odd_page.wait_for("Problems", odd_names.COMPONENT)
    odd_page.wait_for("Number of problems", "1")
    odd_page.open(ALERTS)
    odd_page.wait_for("Monitoring", "has not answered for")
    odd_page.wait_for("Suppressed", "No data")
    odd_page.wait_for("Silences", "No data")


def test_a_dead_exporter_is_announced_and_its_faults_stay(odd: OddSite, odd_page: browser.Page):
    odd.exporter.close()
    odd_page.open(ROBOT)

    odd_page.wait_for("Monitoring", "The exporter of odd has not answered for")
    odd_page.wait_for("Problems", odd_names.COMPONENT)
    odd_page.open(FLEET)
    odd_page.wait_for("Problems", odd_names.COMPONENT)
    (row,) = odd_page.rows("Problems")
    assert row[0] == "CRITICAL"
    assert row[4], "since when"
    assert row[5] == "not known"


def test_a_dead_prometheus_looks_well_nowhere(odd: OddSite, odd_page: browser.Page):
    odd.exporter.close()
    odd.site.prometheus.process.stop()

    for board in BOARDS:
        odd_page.open(board)
        odd_page.wait_for("Monitoring", "Prometheus does not answer")
        red = odd_page.background("Monitoring", DEAD)
        assert "linear-gradient" in red or red == "rgb(193, 18, 31)"  # before 9.5 graded
        texts = {title: odd_page.text(title) for title in shown(board)}
        well = [title for title, text in texts.items() if text in {"OK", "0"} or "No pro" in text]
        assert well == []


DEAD = (
    "Prometheus does not answer: nothing on this page is known, and nobody is notified; "
    "the exporter's own page says since when"
)
