"""A running exporter in the test process, without its web server."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from ros_diagnostics_exporter.config.fleet import Fleet
from ros_diagnostics_exporter.model import ALL_PARTS
from ros_diagnostics_exporter.service import Service
from support.exposition import parsed
from support.ros_publisher import Publisher, publisher
from support.zenoh_robots import Bridge, Router
from testbed.polling import until


class Running:
    """An exporter that listens on real DDS and is asked for its texts."""

    def __init__(self, fleet: Fleet, tmp_path: Path) -> None:
        self.folder = tmp_path
        self.service = Service(fleet, tmp_path / "fleet.yml", None)
        self.service.start()

    def samples(self, name: str) -> dict[tuple[tuple[str, str], ...], float]:
        """Sorted labels -> value of every sample of ros_diagnostics_``name``."""
        pieces = self.service.render_metrics(openmetrics=False, parts=ALL_PARTS)
        found = parsed(b"".join(pieces).decode(), name)
        return {tuple(sorted(each.labels.items())): each.value for each in found}

    def sample(self, name: str, **labels: str) -> float | None:
        found = [
            value
            for have, value in self.samples(name).items()
            if labels.items() <= dict(have).items()
        ]
        assert len(found) <= 1
        return found[0] if found else None

    def wait_for(self, name: str, value: float | None, **labels: str) -> None:
        until(lambda: self.sample(name, **labels) == value, f"{name}{labels} is {value}", 30)

    def close(self) -> None:
        self.service.stop()


@pytest.fixture
def run_exporter(tmp_path: Path) -> Iterator[Callable[[Fleet], Running]]:
    """A function: Fleet -> an exporter that ends with the test."""
    with ExitStack() as stack:

        def run(fleet: Fleet) -> Running:
            running = Running(fleet, tmp_path)
            stack.callback(running.close)
            return running

        yield run


@pytest.fixture
def robots(ros_domain: int) -> Iterator[Publisher]:
    """A publisher in the test's domain."""
    with publisher(ros_domain) as made:
        yield made


@pytest.fixture
def router(free_port: Callable[[], int]) -> Iterator[Router]:
    """A zenoh router."""
    made = Router(f"tcp/127.0.0.1:{free_port()}")
    yield made
    made.stop()


@pytest.fixture
def bridge(router: Router) -> Iterator[Bridge]:
    """A zenoh bridge at the router."""
    made = Bridge(router.locator)
    yield made
    made.close()
