"""The exporter's own families (exporter_*, process_*), served by prometheus_client."""

from __future__ import annotations

import platform
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

from prometheus_client import CollectorRegistry, GCCollector, ProcessCollector
from prometheus_client.exposition import generate_latest
from prometheus_client.metrics_core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.openmetrics import exposition as openmetrics_exposition
from prometheus_client.registry import Collector

from ros_diagnostics_exporter import __version__
from ros_diagnostics_exporter.metrics import families as metrics
from ros_diagnostics_exporter.metrics.families import Family


@dataclass
class Facts:
    """What the exporter knows about itself at one moment; each family reads its field."""

    fleet: str
    ros_distro: str
    rmw: str
    config_successful: bool = True
    config_time: float = 0.0
    robots: int = 0
    series: Mapping[str, int] = field(default_factory=dict)
    series_limit: int = 0
    rejected: Mapping[str, int] = field(default_factory=dict)
    settled: bool = False
    decode_seconds: float = 0.0
    ingest_seconds: float = 0.0
    scrapes: int = 0
    scrape_seconds: float = 0.0
    domains: Mapping[int, bool] = field(default_factory=dict)
    discovery_times: Mapping[int, float] = field(default_factory=dict)
    storage_successful: bool | None = None  # None: no state file is kept
    storage_time: float = 0.0
    alertmanager_up: bool | None = None  # None: it is not asked


class SelfMetrics(Collector):
    """Asks for the facts at each scrape."""

    def __init__(self, facts: Callable[[], Facts]) -> None:
        self._facts = facts
        self._registry = CollectorRegistry()
        self._registry.register(self)
        ProcessCollector(registry=self._registry)
        GCCollector(registry=self._registry)

    def render(self, *, openmetrics: bool = False) -> bytes:
        """The families as text; OpenMetrics with its closing ``# EOF``."""
        if openmetrics:
            generate: Callable[[CollectorRegistry], bytes] = openmetrics_exposition.generate_latest
            return generate(self._registry)
        return generate_latest(self._registry)

    def describe(self) -> Iterable[Metric]:
        """No family: asking for the facts must wait until everything stands."""
        return []

    def collect(self) -> Iterable[Metric]:
        """One family for each row of the table."""
        facts = self._facts()
        for family, samples in _samples(facts):
            kind = CounterMetricFamily if family.type == "counter" else GaugeMetricFamily
            metric = kind(family.name, family.help, labels=family.labels)
            for labels, value in samples:
                metric.add_metric([facts.fleet, *labels], value)
            yield metric


def _samples(facts: Facts) -> Iterable[tuple[Family, list[tuple[list[str], float]]]]:
    """Family -> [(labels after ``fleet``, value)]."""
    versions = [__version__, platform.python_version(), facts.ros_distro, facts.rmw]
    yield metrics.EXPORTER_BUILD_INFO, [(versions, 1)]
    for family, value in (
        (metrics.EXPORTER_CONFIG_OK, float(facts.config_successful)),
        (metrics.EXPORTER_CONFIG_TIME, facts.config_time),
        (metrics.EXPORTER_ROBOTS, facts.robots),
        (metrics.EXPORTER_SERIES_LIMIT, facts.series_limit),
        (metrics.EXPORTER_SETTLED, float(facts.settled)),
        (metrics.EXPORTER_DECODE, facts.decode_seconds),
        (metrics.EXPORTER_INGEST, facts.ingest_seconds),
        (metrics.EXPORTER_SCRAPES, facts.scrapes),
        (metrics.EXPORTER_SCRAPE_DURATION, facts.scrape_seconds),
    ):
        yield family, [([], value)]
    for family, by_label in (
        (metrics.EXPORTER_SERIES, facts.series),
        (metrics.EXPORTER_REJECTED, facts.rejected),
        (metrics.EXPORTER_DOMAIN_UP, facts.domains),
        (metrics.EXPORTER_DISCOVERY_TIME, facts.discovery_times),
    ):
        yield family, [([str(label)], float(value)) for label, value in sorted(by_label.items())]
    if facts.storage_successful is not None:
        yield metrics.EXPORTER_STORAGE_OK, [([], float(facts.storage_successful))]
        yield metrics.EXPORTER_STORAGE_TIME, [([], facts.storage_time)]
    if facts.alertmanager_up is not None:
        yield metrics.EXPORTER_ALERTMANAGER_UP, [([], float(facts.alertmanager_up))]
