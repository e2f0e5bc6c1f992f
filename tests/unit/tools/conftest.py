"""The fixtures of a web server on a fake backend, and of the command that asks it."""

import time
from collections.abc import Callable, Iterator

import pytest

from ros_diagnostics_exporter.web.server import Server
from ros_diagnostics_tools.main import main
from support.played_servers import played
from support.web_server import ca, plain, serve, tls_config, url_of

__all__ = ["ca", "plain", "played", "serve", "tls_config"]
Run = Callable[..., tuple[str, str]]


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Run:
    """A function (words, at=server, code=0): what the command prints, `out` and `err`.

    The command asks the server `at`, and its exit code is `code`.
    """

    def run(*words: str, at: Server | None = None, code: int = 0) -> tuple[str, str]:
        asked = [] if at is None else ["--url", url_of(at)]
        assert main([*words, *asked]) == code
        return capsys.readouterr()

    return run


@pytest.fixture
def in_utc() -> Iterator[None]:
    """Local times are in UTC."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TZ", "UTC")
        time.tzset()
        yield
    time.tzset()


@pytest.fixture
def wide(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tables have room for all their columns."""
    monkeypatch.setenv("COLUMNS", "200")
