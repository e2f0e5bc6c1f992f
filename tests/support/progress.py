"""What a run of the tests is doing, in a line each half minute: a run that hangs names its test."""

import time
from dataclasses import dataclass, field

import pytest

INTERVAL = 30.0  # seconds between two lines
MOST = 4  # tests that a line names, those first that have been running longest


@dataclass
class Progress:
    """Which tests run, by their node id, and since when; all times in seconds of one clock.

    ``begin`` is when the first began.
    """

    begin: float
    done: int = 0
    running: dict[str, float] = field(default_factory=dict)
    next_line: float = field(init=False)

    def __post_init__(self) -> None:
        self.next_line = self.begin + INTERVAL

    def start(self, test: str, now: float) -> None:
        """Note that a test begins."""
        self.running[test] = now

    def finish(self, test: str) -> None:
        """Note that a test has ended."""
        if self.running.pop(test, None) is not None:
            self.done += 1

    def due_line(self, total: int, now: float) -> str | None:
        """The line that is due, for example "2:30, 1200 of 9000 done, running: a.py::b (75 s)"."""
        if now < self.next_line:
            return None
        self.next_line = now + INTERVAL
        minutes, seconds = divmod(int(now - self.begin), 60)
        oldest = sorted(self.running.items(), key=lambda each: each[1])[:MOST]
        running = ", ".join(f"{test} ({now - since:.0f} s)" for test, since in oldest)
        return f"{minutes}:{seconds:02}, {self.done} of {total} done, running: {running}"


class Lines:
    """A plugin that prints them; of pytest-xdist the process that hands the tests out has it."""

    def __init__(self, session: pytest.Session) -> None:
        self._session, self._progress = session, Progress(time.monotonic())

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        """A test begins."""
        self._progress.start(nodeid, time.monotonic())

    def pytest_runtest_logfinish(self, nodeid: str) -> None:
        """A test has ended."""
        self._progress.finish(nodeid)
        reporter = self._session.config.pluginmanager.get_plugin("terminalreporter")
        line = self._progress.due_line(self._session.testscollected, time.monotonic())
        if reporter is not None and line is not None:
            reporter.write_line(f"\n{line}")  # below the dots
