"""An oncall.yml and an alertmanager.yml from texts."""

import shutil
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from textwrap import dedent

import pytest

from ros_diagnostics_tools.commands import oncall
from ros_diagnostics_tools.main import main
from support.oncall import with_marker
from support.shipped_rules import ALERTMANAGER


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The current folder: the shipped one of Alertmanager, with a route to `on-call`."""
    shutil.copytree(ALERTMANAGER, tmp_path / "alertmanager")
    with_marker(tmp_path / "alertmanager" / "alertmanager.yml")
    monkeypatch.chdir(tmp_path / "alertmanager")
    return tmp_path / "alertmanager"


@pytest.fixture
def run(folder, capfd, monkeypatch) -> Callable[..., tuple[str, str]]:
    """A function (text, words, now, code=0): what the command prints of a text, `out` and `err`."""

    def run(text: str, *words: str, now: datetime | None = None, code: int = 0) -> tuple[str, str]:
        (folder / "oncall.yml").write_text(dedent(text), encoding="utf-8")
        if now is not None:
            monkeypatch.setattr(oncall, "_now", lambda: now)
        assert main(["oncall", *words]) == code
        return capfd.readouterr()

    return run
