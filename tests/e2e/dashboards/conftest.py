"""The watched fleet, shared by the tests of a module."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from e2e.dashboards.watched_fleet import WatchedFleet, running
from support import host_checks, prometheus_site


@pytest.fixture(scope="module")
def watched(tmp_path_factory: pytest.TempPathFactory) -> Iterator[WatchedFleet]:
    if missing := prometheus_site.missing_program() or host_checks.missing_program():
        pytest.skip(f"{missing} is not installed")
    with running(tmp_path_factory.mktemp("site")) as found:
        yield found
