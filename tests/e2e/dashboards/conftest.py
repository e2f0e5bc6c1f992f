"""The watched fleet, shared by the tests of a module."""

from collections.abc import Iterator

import pytest

from e2e.dashboards.watched_fleet import WatchedFleet, running


@pytest.fixture(scope="module")
def watched(tmp_path_factory: pytest.TempPathFactory) -> Iterator[WatchedFleet]:
    with running(tmp_path_factory.mktemp("site")) as found:
        yield found
