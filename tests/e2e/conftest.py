"""For each end-to-end test a running stack: virtual robots, exporter, servers and mail."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from testbed.polling import until
from testbed.site import Site
from testbed.stack import Plan, running


@pytest.fixture
def site(tmp_path: Path) -> Iterator[Site]:
    """A site in which nothing is started yet."""
    with Site(tmp_path) as site:
        yield site


@pytest.fixture
def stack(tmp_path: Path) -> Iterator[Site]:
    """Three virtual robots, the exporter, Prometheus, Alertmanager and a mail server, all ready."""
    with running(tmp_path, Plan(robots=3)) as stack:
        yield stack


@pytest.fixture
def wait_for_mails(stack: Site) -> Callable[..., list[str]]:
    """A function: waits until so many mails have come, returns all subjects."""

    def wait(number: int, within: float = 60) -> list[str]:
        subjects = stack.inbox.subjects
        until(lambda: len(subjects()) >= number, lambda: f"{number} mails: {subjects()}", within)
        return subjects()

    return wait


@pytest.fixture
def wait_for_scrapes(stack: Site) -> Callable[[int], None]:
    """A function: waits until Prometheus has scraped the exporter successfully so many times more.

    Rules are evaluated as often, and group_interval is as long: all mails about what was scraped
    before have been sent.
    """

    def wait(number: int) -> None:
        def scrapes() -> float:
            found = stack.query('sum_over_time(up{job="ros-diagnostics-faults"}[1h])')
            return found[0].value if found else 0

        before = scrapes()
        until(lambda: scrapes() >= before + number, f"{number} scrapes of the exporter", 120)

    return wait
