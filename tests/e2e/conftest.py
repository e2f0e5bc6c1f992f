"""For each end-to-end test a running stack: virtual robots, exporter, servers and mail."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from support.sns import SENT
from testbed import http
from testbed.mail import Inbox
from testbed.polling import until
from testbed.stack import Plan, Stack, running

HERE = Path(__file__).parent


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if HERE in item.path.parents:
            item.add_marker(pytest.mark.e2e)


@pytest.fixture
def stack(tmp_path: Path) -> Iterator[Stack]:
    """Three virtual robots, the exporter, Prometheus, Alertmanager and a mail server, all ready."""
    with running(tmp_path, Plan(robots=3), Inbox()) as stack:
        yield stack


@pytest.fixture
def wait_for_mails(stack: Stack) -> Callable[[int], list[str]]:
    """A function: waits until so many mails have come, returns all subjects."""

    def wait(number: int) -> list[str]:
        def subjects() -> list[str]:
            return [mail.subject for mail in stack.inbox.mails()]

        until(lambda: len(subjects()) >= number, lambda: f"{number} mails: {subjects()}", 60)
        return subjects()

    return wait


@pytest.fixture
def wait_for_scrapes(stack: Stack) -> Callable[[int], None]:
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


@pytest.fixture
def sns_server(free_port: Callable[[], int], start_process: Callable[..., Any]) -> str:
    """The address of moto's server, which receives text messages as Amazon SNS does."""
    port = free_port()
    argv = [sys.executable, "-m", "moto.server", "-H", "127.0.0.1", "-p", str(port)]
    start_process("moto", argv)
    address = f"127.0.0.1:{port}"
    until(lambda: http.answers(address, SENT), "moto's server answers", 60)
    return address
