"""Robots that do not exist: ever more of them, or many with a few large arrays."""

from __future__ import annotations

from bench.actors.pace import ticks
from bench.actors.publishing import big, robots_at, serialize
from ros_diagnostics_exporter.model import Status

NEW = 7  # robots that appear each second
LIVES = 3  # seconds for which each is there; it publishes each second
COMPONENTS = 20  # of each array, with names of its own
LARGE = 7_000  # components of 4 MB
LARGE_RATE = 20  # arrays a second


def invent(where: str, seconds: float) -> None:
    """Be robots with new names that publish a few arrays, and go."""
    with robots_at(where) as hostile:
        alive: list[list[str]] = []
        for second, _late in ticks(1, seconds):
            alive.append([f"/hostile_{second}_{n}/diagnostics_agg" for n in range(NEW)])
            for topic in alive[-1]:
                hostile.offer(topic, depth=10)
            for number, topic in enumerate(topic for each in alive for topic in each):
                hostile.send_bytes(topic, _new_components(f"{second}_{number}"))
            for topic in alive.pop(0) if len(alive) > LIVES else ():
                hostile.withdraw(topic)
            print(f"{NEW * (second + 1)} robots invented", flush=True)


def _new_components(name: str) -> bytes:
    components = [f"Part {name} {number}" for number in range(COMPONENTS)]
    header = Status(0, "/Hostile", "OK", "", tuple((each, "OK") for each in components))
    values = (("Voltage (V)", "24.1"), ("Current (A)", "1.5"))
    return serialize(
        [header, *(Status(0, f"/Hostile/{each}", "OK", "", values) for each in components)]
    )


def publish_large(where: str, topics: int, arrays: int, seconds: float) -> None:
    """Publish so many arrays of 4 MB on each of so many topics, and then nothing."""
    data = serialize(big(LARGE, 0))
    names = [f"/hostile_{number}/diagnostics_agg" for number in range(topics)]
    with robots_at(where) as hostile:
        for topic in names:
            hostile.offer(topic, depth=arrays)
        hostile.wait_for_listeners()
        for tick, _late in ticks(LARGE_RATE, topics * arrays / LARGE_RATE):
            hostile.send_bytes(names[tick // arrays], data)
            print(f"{tick + 1} arrays of {len(data) / 1e6:.1f} MB sent", flush=True)
        for _ in ticks(1, seconds):
            pass
