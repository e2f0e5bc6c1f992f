"""What a scrape of 1,000 robots costs, against prometheus_client rendering the same samples.

Both texts are parsed and compared first. "Held up" is the longest that an ingest had to wait while
scrapes went on in another thread.
"""

from __future__ import annotations

import argparse
import threading
import time
from collections.abc import Iterable

from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.metrics_core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.parser import text_string_to_metric_families
from prometheus_client.registry import Collector

from bench.robots import aggregated_array
from ros_diagnostics_exporter.config.fleet import Fleet, Robot, Source
from ros_diagnostics_exporter.fleet.state import FleetState
from ros_diagnostics_exporter.metrics.exposition import Exposition
from ros_diagnostics_exporter.model import ALL_PARTS, Instant, Topic
from ros_diagnostics_exporter.web.scrape import compress


class Samples(Collector):
    """The same samples from a custom collector for prometheus_client."""

    def __init__(self, text: str) -> None:
        self._families = [
            (family.name, family.documentation, family.type, family.samples)
            for family in text_string_to_metric_families(text)
        ]

    def collect(self) -> Iterable[Metric]:
        """Return the families, as prometheus_client asks for them."""
        for name, documentation, kind, samples in self._families:
            labels = list(samples[0].labels)
            make = CounterMetricFamily if kind == "counter" else GaugeMetricFamily
            family = make(name, documentation, labels=labels)
            for sample in samples:
                family.add_metric([sample.labels[label] for label in labels], sample.value)
            yield family


def _fill(robots: int) -> tuple[FleetState, list[Topic]]:
    topics = [Topic(0, f"/robot_{n}/diagnostics_agg") for n in range(robots)]
    fleet = Fleet(
        "bench",
        tuple(
            Robot(f"robot_{n}", topic_agg=topic.name, source=Source.AGG)
            for n, topic in enumerate(topics)
        ),
    )
    return FleetState(fleet, Instant(0.0, 0.0)), topics


def _receive_all(state: FleetState, topics: list[Topic], turn: int) -> None:
    array = aggregated_array(turn)
    for topic in topics:
        state.receive(topic, array, Instant(float(turn), 1.7e9 + turn))


def _cpu(work: object, rounds: int) -> float:
    best = float("inf")
    for _ in range(rounds):
        begin = time.process_time()
        work()  # type: ignore[operator]
        best = min(best, time.process_time() - begin)
    return best * 1e3


def _held_up(state: FleetState, topics: list[Topic], exposition: Exposition) -> float:
    """The longest wait of an ingest in ms while scrapes run; every value changes."""
    stop = threading.Event()

    def scrape() -> None:
        while not stop.is_set():
            exposition.render()

    thread = threading.Thread(target=scrape)
    thread.start()
    longest = 0.0
    for turn in range(2_000, 2_008):
        array = aggregated_array(turn)
        for topic in topics:
            begin = time.perf_counter()
            state.receive(topic, array, Instant(float(turn), 1.7e9 + turn))
            longest = max(longest, time.perf_counter() - begin)
    stop.set()
    thread.join()
    return longest * 1e3


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", type=int, default=1000)
    robots = parser.parse_args().robots
    state, topics = _fill(robots)
    exposition = Exposition(state)
    _receive_all(state, topics, 1)
    text = exposition.render()
    registry = CollectorRegistry()
    registry.register(Samples(text.decode()))
    theirs = generate_latest(registry)
    same = sorted(text_string_to_metric_families(text.decode()), key=lambda f: f.name) == sorted(
        text_string_to_metric_families(theirs.decode()), key=lambda f: f.name
    )
    if not same:
        raise SystemExit("the two texts differ: nothing to compare")
    yardstick = _cpu(lambda: generate_latest(registry), 3)
    unchanged = _cpu(exposition.render, 5)
    compressed = _cpu(lambda: compress(exposition.pieces(openmetrics=False, parts=ALL_PARTS)), 5)
    turns = iter(range(100, 10_000))

    def changed() -> float:
        _receive_all(state, topics, next(turns))
        return _cpu(exposition.render, 1)

    every = min(changed() for _ in range(5))
    size = f"{text.count(b'{')} samples, {len(text) / 1e6:.1f} MB"
    print(f"{robots} robots, {size}   ms CPU   times less")
    for what, cost in (
        ("prometheus_client.generate_latest", yardstick),
        ("ours, nothing changed (target 10 ms)", unchanged),
        ("ours, nothing changed, compressed", compressed),
        ("ours, every value changed (target 15 times)", every),
    ):
        print(f"{what:<46}{cost:>7.1f}   {yardstick / cost:>6.1f}")
    held = _held_up(state, topics, exposition)
    print(f"ingest held up at most {held:.1f} ms while scrapes go on (target 50 ms)")


if __name__ == "__main__":
    main()
