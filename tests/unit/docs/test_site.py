"""The site of the documentation is built without a warning and takes nothing from elsewhere."""

import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest

from e2e.dashboards.browser import CHROMIUM_OPTIONS, chromium
from support.called import called

CHECKOUT = Path(__file__).parents[3]
pytest.importorskip("material", reason="./run docs installs it")
site_pages = pytest.importorskip("site_pages")


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)]
    called(command, cwd=CHECKOUT, timeout=300)
    return folder


def test_every_page_and_runbook_is_there_and_can_be_found(site: Path):
    pages = [each.relative_to(CHECKOUT / "docs") for each in (CHECKOUT / "docs").rglob("*.md")]
    assert not [each for each in pages if not (site / each).with_suffix(".html").exists()]
    index = (site / "search" / "search_index.json").read_text("utf-8")
    assert '"alerts/RosDiagnosticsRobotSilent.html' in index
    assert "SECURITY.html" in index
    assert "iframe-worker.js" in (site / "index.html").read_text("utf-8")  # finds in a folder, too


def test_nothing_is_taken_from_another_server(site: Path):
    taken = re.compile(
        r"<(?:script|link|img|iframe)\b[^>]*\b(?:src|href)=\"?https?://(?!127\.)[^\s\">]+"
    )
    assert not [
        found for page in site.rglob("*.html") for found in taken.findall(page.read_text("utf-8"))
    ]


# Wider than the screen, and in nothing that scrolls.
TOO_WIDE = """() => [...document.querySelectorAll('.md-content *')].filter((element) => {
    const box = element.getBoundingClientRect();
    if (!box.width || box.right <= document.documentElement.clientWidth + 1) return false;
    for (let each = element.parentElement; each; each = each.parentElement)
        if (['auto', 'scroll'].includes(getComputedStyle(each).overflowX)) return false;
    return true;
}).map((element) => element.outerHTML.slice(0, 80))"""
FOUND = ".md-search-result__item a"


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    sync_api = pytest.importorskip("playwright.sync_api", reason="no Python package playwright")
    if chromium() is None:
        pytest.skip("no Chromium")
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium(), args=CHROMIUM_OPTIONS)
        yield browser
        browser.close()


@pytest.mark.slow
@pytest.mark.parametrize("width", [1366, 390])
def test_nothing_is_wider_than_the_screen(site: Path, browser: Any, width: int):
    page = browser.new_context(viewport={"width": width, "height": 844}, offline=True).new_page()
    wide = {}
    for file in sorted(site.rglob("*.html")):
        page.goto(file.as_uri(), wait_until="domcontentloaded")
        wide[file.name] = page.evaluate(TOO_WIDE)

    assert len(wide) > 50
    assert {name: found for name, found in wide.items() if found} == {}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "page_name"),
    [("PagerDuty", "receivers.html"), ("forget", "alerts.html"), ("test page", "commands.html")],
)
def test_a_search_finds_in_a_folder_without_a_network(
    site: Path, browser: Any, words: str, page_name: str
):
    page = browser.new_context(viewport={"width": 1366, "height": 844}, offline=True).new_page()
    page.goto((site / "index.html").as_uri())
    page.wait_for_selector("[data-md-component=search-query]", state="attached")
    page.click(".md-search__input")
    page.keyboard.type(words)
    page.wait_for_selector(FOUND, timeout=60_000)
    links = page.eval_on_selector_all(FOUND, "found => found.map((each) => each.href)")

    assert page_name in {link.partition("?")[0].rpartition("/")[2] for link in links}


@pytest.mark.parametrize(
    ("folder", "text", "moved"),
    [
        (".", "[a](docs/x.md#y), [b](SECURITY.md)", "[a](x.md#y), [b](SECURITY.md)"),
        (".", "[a](tools/x.py), [b](docs/away.md), ![c](docs/images/p.svg)", "a, b, c"),
        (".", "[a](https://x.example/docs/x.md), [b](#y)", None),
        ("docs", "[a](x.md), [b](../README.md#y)", "[a](x.md), [b](index.md#y)"),
        ("docs/alerts", "[a](../x.md), [b](../../README.md)", "[a](../x.md), [b](../index.md)"),
        ("docs/alerts", "![a](../images/there.svg)", "![a](../images/there.svg)"),
    ],
)
def test_a_link_leads_to_a_page_of_the_site_or_to_nothing(folder, text, moved):
    there = {"x.md", "images/there.svg"}
    files = Mock(get_file_from_path=lambda page: page if page in there else None)
    assert site_pages.moved(text, folder, files) == (text if moved is None else moved)
    config = Mock(nav=[{"Alerts": ["index.md", {"Runbooks": []}]}, {"Other": "x.md"}])
    runbooks = site_pages.on_config(config).nav[0]["Alerts"][1]["Runbooks"]
    assert {"RobotSilent": "alerts/RosDiagnosticsRobotSilent.md"} in runbooks
