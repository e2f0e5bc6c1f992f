"""The site of the documentation is built without a warning and takes nothing from elsewhere."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).parents[3]
pytest.importorskip("material", reason="./run docs installs it")


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)]
    done = subprocess.run(
        command, cwd=CHECKOUT, capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
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
