"""The exporter's pages in Chromium: accessible by axe-core, and renewed without losing focus."""

import base64
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bcrypt
import pytest

from e2e.dashboards.browser import CHROMIUM_OPTIONS, chromium
from support.web_server import (
    ask,
    broken,
    component,
    downtime,
    fleet,
    no_history,
    occurrence,
    plain,
    problem,
    robot,
    seldom,
    serve,
    tls_config,
)

__all__ = ["plain", "seldom", "serve", "tls_config"]  # fixtures
sync_api = pytest.importorskip("playwright.sync_api", reason="no Python package playwright")
axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="no axe-core")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(chromium() is None, reason="no Chromium"),
]

FAULT = "0123456789ab"
WCAG_AA = {"runOnly": ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"]}
LEVELS = ("OK", "WARN", "ERROR", "STALE")
ROBOTS = [
    robot(
        "broken",
        *(component(f"Motor {level}", level) for level in LEVELS),
        problems=[
            broken("Motor ERROR", fault=FAULT, recording=f"/api/v1/faults/{FAULT}/recording.mcap"),
            broken("Motor WARN", "warning", confirmed=None),
            broken("Motor STALE", "stale", suppressed="maintenance"),
        ],
        maintenance=True,
        downtimes=[downtime()],
    ),
    robot("silent", up=False, silent_reason="mute", problems=[problem("robot", "silent")]),
    robot("declared", up=False, silent_reason="never_seen"),
    robot("fine", component("Motor", "OK")),
]
COMMON = problem("common", "critical", component="Map", confirmed=1_010.0, fault="ba9876543210")
ENDED = occurrence(
    *("component", "critical"),
    robot="broken",
    group="/Motor",
    component="Motor ERROR",
    evidence="over current; values Level: 12.3 V",
    end="OK: runs",
    acknowledged=[{"at": 1_015.0, "author": "ann", "comment": "on it"}],
    notified=[{"at": 1_012.0, "receiver": "email", "step": "", "after": "firing"}],
)
PAGES = [
    *("/", "/?q=nowhere", "/robots/broken", "/robots/nobody"),
    *(f"/faults/{FAULT}", "/faults/ended", "/faults/x"),
]


def history(fault: str) -> dict[str, Any]:
    known = [] if fault == "x" else [ENDED, ENDED]
    return no_history(fault) | {"events_since": 600.0, "occurrences": known}


@pytest.fixture(scope="module")
def window() -> Iterator[Any]:
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium(), args=CHROMIUM_OPTIONS)
        yield browser
        browser.close()


@pytest.mark.parametrize("width", [390, 1920])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_every_page_is_accessible_and_fits_the_screen(serve, window, scheme, width):
    server = serve(fleet_snapshot=lambda: fleet(*ROBOTS, problems=[COMMON]), fault_history=history)
    # The policy forbids scripts of others, axe-core too: that it works is seen below.
    context = window.new_context(
        bypass_csp=True, color_scheme=scheme, viewport={"width": width, "height": 900}
    )
    page = context.new_page()
    found = {}
    for path in PAGES:
        page.goto(f"http://{server.addresses[0]}{path}")
        result = axe.Axe().run(page, options=WCAG_AA).response
        assert len(result["passes"]) > 10
        found[path] = [(each["id"], each["nodes"][0]["html"]) for each in result["violations"]]
        assert page.evaluate("document.documentElement.scrollWidth <= window.innerWidth"), path
    context.close()
    assert found == {path: [] for path in PAGES}


ANN = {"username": "ann", "password": "secret"}


def serve_with_forms(serve, folder: Path, done: list[Any]) -> Any:
    """A server at which ann may acknowledge; what she did goes into the list."""
    users = folder / "web.yml"
    hashed = bcrypt.hashpw(b"secret", bcrypt.gensalt(rounds=4)).decode()
    users.write_text(f"basic_auth_users: {{ann: {hashed}}}")
    return serve(
        fleet_snapshot=lambda: fleet(*ROBOTS),
        fault_history=history,
        acknowledge=lambda *given: done.append(given),
        web_config=users,
        actions=True,
    )


@pytest.mark.parametrize("width", [390, 1366])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_form_is_accessible_and_a_browser_may_send_it(serve, window, tmp_path, scheme, width):
    done: list[Any] = []
    server = serve_with_forms(serve, tmp_path, done)
    address = f"http://{server.addresses[0]}"
    context = window.new_context(
        bypass_csp=True,
        color_scheme=scheme,
        viewport={"width": width, "height": 900},
        http_credentials=ANN,
    )
    page = context.new_page()
    for path in ("/robots/broken?done=downtime", f"/faults/{FAULT}?done=acknowledged"):
        page.goto(address + path)
        result = axe.Axe().run(page, options=WCAG_AA).response
        assert [(each["id"], each["nodes"][0]["html"]) for each in result["violations"]] == []
        assert page.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
    page.goto(f"{address}/faults/{FAULT}")
    page.get_by_label("What is being done").fill("new gears")
    page.get_by_role("button", name="Acknowledge").click()
    page.get_by_role("status").filter(has_text="Acknowledged.").wait_for()
    assert [(fault, *person[:2]) for fault, person in done] == [(FAULT, "ann", "new gears")]
    assert page.url == f"{address}/faults/{FAULT}?done=acknowledged"
    context.close()


def test_a_page_of_another_site_cannot_send_a_form(serve, window, tmp_path):
    done: list[Any] = []
    server = serve_with_forms(serve, tmp_path, done)
    address = f"http://{server.addresses[0]}"
    login = "Basic " + base64.b64encode(b"ann:secret").decode()
    shown = ask(server, f"/faults/{FAULT}", Authorization=login).text
    token = re.findall('name=token value="([0-9a-f]+)"', shown)[0]
    context = window.new_context(http_credentials=ANN)
    page = context.new_page()
    page.goto(f"{address}/faults/{FAULT}")  # now the browser knows the login
    page.goto("about:blank")
    page.set_content(
        f"<form method=post action='{address}/-/acknowledge'><input name=token value={token}>"
        f"<input name=fault value={FAULT}><input name=comment value=x><button>x</button></form>"
    )
    page.get_by_role("button").click()
    page.get_by_role("alert").wait_for()
    assert "was not sent by a page of this exporter" in page.get_by_role("alert").inner_text()
    assert done == []
    context.close()


def test_a_page_is_renewed_under_its_policy_and_focus_and_words_stay(serve, window):
    robots = [robot("a"), robot("b")]
    server = serve(fleet_snapshot=lambda: fleet(*robots))
    page = window.new_page()
    errors: list[str] = []
    page.on("console", lambda message: errors.append(message.text))
    page.clock.install()
    page.goto(f"http://{server.addresses[0]}/")
    page.get_by_role("link", name="b", exact=True).focus()
    page.get_by_label("Search").evaluate("field => field.value = 'half a wo'")

    robots.append(robot("c", component("Motor", "ERROR"), problems=[broken("Motor")]))
    renewed = page.get_by_role("heading", name="Robots with problems: 1")
    for _ in range(30):  # what is shared by requests is a second old at most
        page.clock.run_for(10_000)
        if renewed.count():
            break
        page.wait_for_timeout(100)
    assert renewed.count() == 1
    assert page.evaluate("document.activeElement.textContent") == "b"
    assert page.get_by_label("Search").input_value() == "half a wo"
    assert errors == []
    assert page.get_by_role("status").count() == 0

    server.stop()
    page.clock.run_for(10_000)
    late = page.get_by_role("status")
    late.wait_for()
    assert "The exporter does not answer: this is as of" in late.inner_text()


def grown(server, page, robots) -> Any:
    """Have a robot break, far down on a page that is scrolled; what shows that it was renewed."""
    robots += [robot(f"r{number}") for number in range(300)]
    page.set_viewport_size({"width": 390, "height": 800})
    page.goto(f"http://{server.addresses[0]}/")
    page.get_by_role("link", name="r200", exact=True).focus()
    page.evaluate("window.scrollTo(0, 1234)")
    robots[-1] = robot("z", component("Motor", "ERROR"), problems=[broken("Motor")])
    return page.get_by_role("heading", name="Robots with problems: 1")


def assert_undisturbed(page) -> None:
    assert page.evaluate("document.activeElement.textContent") == "r200"
    assert page.evaluate("window.scrollY") == 1234
    assert page.get_by_role("status").count() == 0


def test_an_event_renews_a_page_at_once_and_focus_and_scrolling_stay(serve, window):
    robots: list[Any] = []
    last = [1]
    server = serve(fleet_snapshot=lambda: fleet(*robots), last_event=lambda: last[0])
    page = window.new_page()
    errors: list[str] = []
    page.on("console", lambda message: errors.append(message.text))
    page.clock.install()  # no time passes there: nothing but an event renews it
    with page.expect_response("**/-/changes"):
        renewed = grown(server, page, robots)
    for number in range(2, 60):  # a response is shared for a second
        last[0] = number
        page.wait_for_timeout(1_000)
        if renewed.count():
            break
    assert renewed.count() == 1
    assert_undisturbed(page)
    assert errors == []
    page.close()


def test_without_a_stream_the_page_asks_every_ten_seconds(serve, window):
    robots: list[Any] = []
    server = serve(fleet_snapshot=lambda: fleet(*robots))
    server.connections.limit = 9  # no stream, which are a tenth at most
    page = window.new_page()
    page.clock.install()
    with page.expect_response("**/-/changes") as first:
        renewed = grown(server, page, robots)
    assert first.value.status == 503
    for _ in range(30):
        page.clock.run_for(10_000)
        if renewed.count():
            break
        page.wait_for_timeout(100)
    assert renewed.count() == 1
    assert_undisturbed(page)
    page.close()


def test_the_search_works_without_a_script(serve, window):
    server = serve(fleet_snapshot=lambda: fleet(robot("amr_1"), robot("agv_2")))
    context = window.new_context(java_script_enabled=False)
    page = context.new_page()
    page.goto(f"http://{server.addresses[0]}/")
    page.get_by_label("Search").fill("AGV")
    page.get_by_role("button", name="Find").click()
    assert page.get_by_role("main").inner_text().count("agv_2") == 1
    assert "amr_1" not in page.get_by_role("main").inner_text()
    assert ask(server, "/api/v1/fleet").json["robots"][0]["robot"] == "amr_1"
    context.close()
