"""A robot that sends too much, and robots that send nothing.

Each against the real exporter, over real DDS and HTTP.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager

import pytest
from prometheus_client.samples import Sample

from ros_diagnostics_exporter.model import Status
from support.exposition import samples
from support.ros_publisher import Publisher, publisher, repeating
from testbed.polling import until

pytestmark = pytest.mark.integration

SMALL = [f"small_{n}" for n in range(20)]
LIMITS = "limits: {robot_series: 5000}\n"


def topic(robot: str) -> str:
    return f"/{robot}/diagnostics_agg"


def scrape(site) -> list[Sample]:
    return samples(site.address)


def values(site, name: str, label: str, **labels: str) -> dict[str, float]:
    """A label -> the value of every sample of ros_diagnostics_``name`` with ``labels``."""
    return {each.labels[label]: each.value for each in samples(site.address, name, **labels)}


@contextmanager
def running(site, *flags: str) -> Iterator[None]:
    process = site.serve(*flags)
    try:
        yield
    finally:
        process.stop()


def small(turn: int) -> list[Status]:
    return [Status(0, "Motor", values=(("Turn", str(turn)),))]


def repeated(turn: int) -> list[Status]:
    """200 equal keys in each of 500 components, every value another one than before."""
    pairs = tuple(("Error", str(n + turn)) for n in range(200))
    return [Status(0, f"Part {n}", values=pairs) for n in range(500)]


def sending(
    robots: Publisher,
    *names: str,
    period: float = 0.2,
    array: Callable[[int], list[Status]] = small,
) -> AbstractContextManager[None]:
    """The robots send an array each, again and again."""

    def send(turn: int) -> None:
        for name in names:
            robots.send(topic(name), *array(turn))

    return repeating(send, period)


def test_a_robot_with_too_many_series_harms_no_other(site):
    site.fleet_file.write_text(site.fleet_file.read_text() + LIMITS)
    with publisher(site.domain_id) as robots, publisher(site.domain_id) as bad:
        for name in SMALL:
            robots.offer(topic(name))
        bad.offer(topic("hostile"))
        with running(site), sending(robots, *SMALL):
            robots.wait_for_listeners()
            bad.wait_for_listeners()
            until(lambda: sum(values(site, "robot_up", "robot").values()) == 20, "all are up")
            with sending(bad, "hostile", period=1.0, array=repeated):
                until(lambda: _hostile_arrays(site) >= 5, "some arrays are received", 120)
            rejected = values(site, "robot_rejected_total", "reason", robot="hostile")
            assert rejected["robot_series_limit"] > 0
            assert sum(each.labels.get("robot") == "hostile" for each in scrape(site)) < 12_000
            assert len(values(site, "component_level", "component", robot="hostile")) == 500
            assert {
                each.labels["robot"]
                for each in scrape(site)
                if each.name == "ros_diagnostics_robot_rejected_total" and each.value
            } == {"hostile"}


def _hostile_arrays(site) -> float:
    """How many were received; all others are up meanwhile."""
    up = values(site, "robot_up", "robot")
    assert [name for name in SMALL if up[name] != 1] == []
    return values(site, "robot_messages_total", "robot")["hostile"]


def test_robots_that_never_publish_are_forgotten_and_not_persisted(site):
    text = site.fleet_file.read_text().replace("{stale_after", "{forget_after: 3s, stale_after")
    site.fleet_file.write_text(text + "limits: {robots: 3}\n")
    storage = ("--storage.path", str(site.folder / "state"))
    with publisher(site.domain_id) as robots:
        robots.offer(topic("real"))
        with publisher(site.domain_id) as mute, sending(robots, "real"):
            mute.offer(topic("mute_1"))
            mute.offer(topic("mute_2"))
            with running(site, *storage):
                until(
                    lambda: (
                        values(site, "robot_up", "robot") == {"real": 1, "mute_1": 0, "mute_2": 0}
                    ),
                    "all are known",
                )
                robots.offer(topic("newcomer"))
                until(
                    lambda: (
                        values(site, "robot_silent_reason", "robot", reason="limit")
                        == {"newcomer": 1}
                    ),
                    "the newcomer is rejected, and named",
                )
                assert values(site, "exporter_rejected_total", "reason")["robot_limit"] == 1
        with running(site, *storage):  # the mute ones have gone meanwhile
            until(lambda: "newcomer" in values(site, "robot_up", "robot"), "the newcomer is known")
            assert values(site, "robot_up", "robot").keys() == {"real", "newcomer"}
            robots.withdraw(topic("newcomer"))
            until(
                lambda: values(site, "robot_up", "robot").keys() == {"real"},
                "the newcomer never published and is forgotten",
            )
