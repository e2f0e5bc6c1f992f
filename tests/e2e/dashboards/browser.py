"""A real Grafana with the shipped dashboards, and Chromium to look at them."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from urllib.parse import urlencode

from testbed import grafana
from testbed.http import answers
from testbed.polling import until
from testbed.processes import Process
from testbed.site import Site

# Without a sandbox, which root may not use; without connections to other hosts.
CHROMIUM_OPTIONS = [
    *("--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
]
TALL = (1600, 6500)  # pixels: Grafana queries only for panels in view
WALL = (1920, 1080)
PHONE = (390, 844)
NO_GRAFANA = "no Grafana in PATH, or its path in GRAFANA"  # tests/allowed_skips.yml has it


def chromium() -> str | None:
    """The path of an installed Chromium or Chrome."""
    names = ("chromium", "chromium-browser", "google-chrome")
    return next(filter(None, map(shutil.which, names)), None)


def missing() -> str:
    """Why dashboards cannot be looked at; empty if they can."""
    try:
        import playwright.sync_api
    except ImportError:
        playwright = "no Python package playwright"
    else:
        playwright = ""
    absent = {
        NO_GRAFANA: grafana.command() is None,
        "no Chromium": chromium() is None,
        playwright: bool(playwright),
    }
    return ", ".join(name for name, is_absent in absent.items() if is_absent)


@contextmanager
def serving(site: Site) -> Iterator[str]:
    """Run Grafana with the data sources of ``site``; yields its address when it answers."""
    address, folder = site.addresses.grafana, site.folder / "grafana"
    folder.mkdir()
    grafana.write_provisioning(folder / "provisioning", site.addresses)
    command = grafana.command()
    assert command is not None
    process = Process("Grafana", command, grafana.environment(folder, address), folder / "log.txt")
    process.start()
    try:
        until(lambda: answers(address, "/api/health"), process.describe, 120)
        yield address
    finally:
        process.stop()


class Page:
    """A dashboard in a window."""

    def __init__(self, address: str, page: Any) -> None:
        self._address = address
        self.page = page

    def open(self, board: str, *, last: str = "10m", **variables: str) -> None:
        """Open a dashboard with values of its variables and wait for its first panel."""
        values = {f"var-{name}": value for name, value in variables.items()}
        query = urlencode({"from": f"now-{last}", "to": "now", "theme": "dark", **values})
        self.follow(f"/d/{board}?{query}")

    def open_until(self, board: str, end: float) -> None:
        """Open a dashboard with the hour until a Unix time and wait for its first panel."""
        begin, last = (int(1000 * each) for each in (end - 3_600, end))
        self.follow(f"/d/{board}?from={begin}&to={last}")

    def follow(self, path: str) -> None:
        """Open a path of Grafana."""
        self.page.goto(f"http://{self._address}{path}", wait_until="domcontentloaded")
        self.page.wait_for_selector("section.panel-container, [data-viz-panel-key]")

    def panel(self, title: str) -> Any:
        """Return the element of a panel; the second selector is that of Grafana 10 and later."""
        return self.page.locator(
            f'section[aria-label="{title} panel"],'
            f' section[data-testid="data-testid Panel header {title}"]'
        ).first

    def text(self, title: str) -> str:
        """Return the text of a panel, without its title."""
        text: str = self.panel(title).inner_text()
        return text.removeprefix(title).strip()

    def wait_for(self, title: str, text: str, seconds: float = 150.0) -> None:
        """Wait until a panel shows a text."""
        until(
            lambda: text in self.text(title),
            lambda: f"{text!r} in panel {title!r}: {self.text(title)!r}",
            seconds,
            every=0.5,
        )

    def rows(self, title: str) -> list[list[str]]:
        """Return the texts of a table's cells that are shown, without its header."""
        rows = self.panel(title).get_by_role("row")
        cells = "[role=cell], [role=gridcell]"  # of Grafana 12: the second
        return [row.locator(cells).all_inner_texts() for row in rows.all()[1:]]

    def link(self, title: str, text: str) -> str:
        """Return where the link of a table's cell leads to."""
        cell = self.panel(title).get_by_role("link", name=text, exact=True).first
        target: str = cell.get_attribute("href")
        return target

    def background(self, title: str, text: str) -> str:
        """Return the colour behind a text of a panel, as "rgb(1, 2, 3)"."""
        found = self.panel(title).get_by_text(text, exact=True).first
        colour: str = found.evaluate(
            """element => {
                for (let each = element; each; each = each.parentElement) {
                    const { backgroundColor, backgroundImage } = getComputedStyle(each);
                    if (backgroundImage !== "none") return backgroundImage;
                    if (backgroundColor !== "rgba(0, 0, 0, 0)") return backgroundColor;
                }
            }"""
        )
        return colour

    def pixels(self, title: str) -> dict[tuple[int, int, int], int]:
        """Return how many pixels of a graph have which colour; few are left out."""
        found: dict[str, int] = (
            self.panel(title)
            .locator("canvas")
            .first.evaluate(
                """canvas => {
                const { data } = canvas.getContext("2d")
                    .getImageData(0, 0, canvas.width, canvas.height);
                const counts = {};
                for (let at = 0; at < data.length; at += 4) {
                    if (data[at + 3] < 128) continue;
                    const colour = data.slice(at, at + 3).join(" ");
                    counts[colour] = (counts[colour] ?? 0) + 1;
                }
                return Object.fromEntries(
                    Object.entries(counts).filter(([_, count]) => count > 100));
            }"""
            )
        )
        return {
            (red, green, blue): count
            for colour, count in found.items()
            for red, green, blue in [map(int, colour.split())]
        }


@contextmanager
def windows() -> Iterator[Any]:
    """Start Chromium; yields it."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        path = os.environ.get("CHROMIUM", chromium())
        browser = playwright.chromium.launch(executable_path=path, args=CHROMIUM_OPTIONS)
        try:
            yield browser
        finally:
            browser.close()
