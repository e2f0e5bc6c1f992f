"""The fleet that is in every state at once, once for all tests of a module."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from e2e.dashboards.watched_fleet import Watched, watching


@pytest.fixture(scope="module")
def watched(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Watched]:
    with watching(tmp_path_factory.mktemp("site")) as found:
        yield found
