"""What all tests share: a ROS domain and ports of their own, programs that end with the test."""

import logging
import os
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import hypothesis
import pytest

from support import progress, skips, time_budget
from support.state_driver import OPENED
from testbed import domains, ports
from testbed.processes import Process

# For rclpy in the test process itself; programs get the same from `dds_environment`. Each process
# that uses ROS writes a log file: they go where the system tidies up.
_environment = domains.environment(0)
_environment["ROS_LOG_DIR"] = str(Path(tempfile.gettempdir()) / f"ros-log-of-tests-{os.getuid()}")
os.environ.clear()
os.environ.update(_environment)


# The machine may be busy: how long an example takes proves nothing. Every day the same examples, so
# that a red run can be repeated; `--all` draws new ones.
hypothesis.settings.register_profile("daily", deadline=None, derandomize=True)
hypothesis.settings.register_profile("all", deadline=None)
hypothesis.settings.load_profile("daily")


def pytest_configure(config: pytest.Config) -> None:
    if config.getoption("--all", default=False):
        hypothesis.settings.load_profile("all")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--all", action="store_true", help="also run the tests marked slow")
    parser.addoption("--no-skips", action="store_true", help="a skip is a failure: ./run nightly")
    parser.addoption("--update", action="store_true", help="rewrite the expected texts")


def pytest_sessionstart(session: pytest.Session) -> None:
    if not hasattr(session.config, "workerinput"):  # which a process of pytest-xdist has
        session.config.pluginmanager.register(progress.Lines(session))


def pytest_sessionfinish(session: pytest.Session) -> None:
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    if reporter is None or not session.config.getoption("--no-skips"):
        return
    refused = skips.refused(_skipped(reporter))
    for line in refused:
        reporter.write_line(line, red=True)
    if refused:
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def _skipped(reporter: pytest.TerminalReporter) -> list[tuple[str, int, str]]:
    return [each.longrepr for each in reporter.stats.get("skipped", ())]


@pytest.hookimpl(trylast=True)  # below the durations
def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    for line in skips.table(_skipped(terminalreporter)):
        terminalreporter.write_line(line)
    if terminalreporter.config.getoption("--all"):  # the budgets are of the run without
        return
    reports = [each for found in terminalreporter.stats.values() for each in found]
    durations = [
        (each.nodeid, each.duration) for each in reports if isinstance(each, pytest.TestReport)
    ]
    for line in time_budget.exceeded(durations, time_budget.budgets()):
        terminalreporter.write_line(line, yellow=True)


# They take a minute each: begun last, they would be all that the end of a run waits for.
LONGEST = ("tests/e2e/test_demo.py", "tests/e2e/notifications/")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    items.sort(key=lambda item: not item.nodeid.startswith(LONGEST))
    if config.getoption("--all"):
        return
    reason = pytest.mark.skip(reason="slow: ./run test --all runs it")
    for item in items:
        if item.get_closest_marker("slow"):
            item.add_marker(reason)


@pytest.fixture(autouse=True)
def _root_logger() -> Iterator[None]:
    """A test that sets up logging leaves no handler behind, whose stream is closed by then."""
    root = logging.getLogger()
    before, level = list(root.handlers), root.level
    yield
    root.handlers[:] = before
    root.setLevel(level)


@pytest.fixture(autouse=True)
def _databases() -> Iterator[None]:
    """What a test opened is closed; Python 3.13 warns of what is not."""
    yield
    while OPENED:
        OPENED.pop().close()


@pytest.fixture
def expect_text(request: pytest.FixtureRequest) -> Callable[[str, Path], None]:
    """A function (text, path): the text is what the file has; --update rewrites the file."""

    def compare(text: str, path: Path) -> None:
        if request.config.getoption("--update"):
            path.write_text(text, encoding="utf-8")
        assert text == path.read_text(encoding="utf-8")

    return compare


@pytest.fixture
def ros_domain() -> Iterator[int]:
    """A ROS domain id that nobody else on this machine uses during the test."""
    with domains.lease() as domain_id:
        yield domain_id


@pytest.fixture
def dds_environment(ros_domain: int) -> dict[str, str]:
    """The environment of a program that talks ROS in this test's domain, on this machine only."""
    return domains.environment(ros_domain)


@pytest.fixture
def free_port() -> Callable[[], int]:
    """A function: each call returns another free TCP port of 127.0.0.1."""
    return ports.free_port


@pytest.fixture
def start_process(tmp_path: Path) -> Iterator[Callable[..., Process]]:
    """A function (name, argv, env): starts a program that ends with the test."""
    started: list[Process] = []

    def start(name: str, argv: list[str | Path], env: dict[str, str] | None = None) -> Process:
        process = Process(name, argv, env, tmp_path / f"{name}-{len(started)}.log")
        started.append(process)
        return process.start()

    yield start
    for process in reversed(started):
        process.stop()
