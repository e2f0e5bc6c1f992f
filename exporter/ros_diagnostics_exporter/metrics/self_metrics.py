"""The exporter's own metrics (exporter_*, process_*), rendered by prometheus_client.

A new one is a row of ``TABLE``: the exposition, docs/reference/metrics.md and the tests read it.
"""

from __future__ import annotations

import platform
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple, Protocol, TypeVar

from prometheus_client import CollectorRegistry, GCCollector, ProcessCollector
from prometheus_client.exposition import generate_latest
from prometheus_client.metrics_core import (
    CounterMetricFamily,
    GaugeMetricFamily,
    HistogramMetricFamily,
    Metric,
)
from prometheus_client.openmetrics import exposition as openmetrics_exposition
from prometheus_client.registry import Collector

from ros_diagnostics_exporter import __version__
from ros_diagnostics_exporter.alertmanager import Alertmanager
from ros_diagnostics_exporter.canary import BUCKETS, Canary
from ros_diagnostics_exporter.config.reloader import Reloader
from ros_diagnostics_exporter.fleet.state import FleetState
from ros_diagnostics_exporter.loops import Loop, read_clocks
from ros_diagnostics_exporter.metrics.exposition import Exposition
from ros_diagnostics_exporter.metrics.families import (
    EXPORTER,
    FAULT_FAMILIES,
    FLEET_FAMILIES,
    PREFIX,
    Family,
)
from ros_diagnostics_exporter.metrics.week import ROWS, Samples, Week
from ros_diagnostics_exporter.model import ALL_PARTS, Domain, Part
from ros_diagnostics_exporter.other_exporters import OtherExporters
from ros_diagnostics_exporter.rejected_logins import RejectedLogins
from ros_diagnostics_exporter.sources.listener import Listener
from ros_diagnostics_exporter.sources.prometheus import Outcome
from ros_diagnostics_exporter.storage.storage import Storage

EOF = b"# EOF\n"  # of OpenMetrics
Label = TypeVar("Label", bound=Domain | str)


class Histogram(NamedTuple):
    """Upper bound -> how many were at most that, the last of all; and the sum of the values."""

    buckets: Sequence[tuple[str, float]]
    sum: float


class Exporter(Protocol):
    """What the exporter's own metrics, and its check of itself, are read from: the service.

    ``ros`` is (distribution, middleware); ``scrapes`` and ``scrape_seconds`` are those before the
    current scrape; ``week`` is None while it is not counted, ``others`` if it has the whole fleet.
    """

    state: FleetState
    exposition: Exposition
    listener: Listener
    reloader: Reloader
    storage: Storage | None
    alertmanager: Alertmanager | None
    canary: Canary
    ros: tuple[str, str]
    scrapes: int
    scrape_seconds: float
    week: Week | None
    others: OtherExporters | None
    rejected_logins: RejectedLogins

    @property
    def recording_dropped(self) -> int:
        """How many messages no recording has."""

    def loops(self) -> Sequence[Loop]:
        """All loops that there are now."""

    def outcomes(self) -> Sequence[Outcome]:
        """What the queries of fleet.yml have brought."""


def _family(
    name: str, kind: str, help_: str, labels: tuple[str, ...], part: Part = Part.EXPORTER
) -> Family:
    return Family(PREFIX + name, kind, help_, labels, part=part)


def _one(value: float) -> Samples:
    return [((), float(value))]


def _by_label(values: Mapping[Label, float]) -> Samples:
    return [((str(label),), float(value)) for label, value in values.items()]


def _canary_times(exporter: Exporter) -> Histogram | None:
    times = exporter.canary.times
    if times is None:
        return None
    within = [(str(bucket), float(n)) for bucket, n in zip(BUCKETS, times.within, strict=True)]
    return Histogram([*within, ("+Inf", float(times.total))], times.seconds)


def _of_week(read: Callable[[Week], Samples], exporter: Exporter) -> Samples | None:
    return None if exporter.week is None else read(exporter.week)


# The function returns None where the metric does not apply: no database, no Alertmanager.
TABLE: tuple[tuple[Family, Callable[[Exporter], Samples | Histogram | None]], ...] = (
    (
        _family(
            "exporter_build_info",
            "gauge",
            "1 with the versions of the exporter, Python and the ROS middleware.",
            (*EXPORTER, "version", "python_version", "ros_distro", "rmw"),
        ),
        lambda exporter: [((__version__, platform.python_version(), *exporter.ros), 1)],
    ),
    (
        _family(
            "exporter_config_last_reload_successful",
            "gauge",
            "1 if the last attempt to read the config succeeded and none hangs.",
            EXPORTER,
        ),
        lambda exporter: _one(exporter.reloader.successful),
    ),
    (
        _family(
            "exporter_config_last_reload_success_timestamp_seconds",
            "gauge",
            "When the config was last read successfully (Unix time).",
            EXPORTER,
        ),
        lambda exporter: _one(exporter.reloader.time),
    ),
    (
        _family(
            "exporter_config_unmatched",
            "gauge",
            "Entries of the config that have matched nothing for five minutes, by kind.",
            (*EXPORTER, "what"),
        ),
        lambda exporter: _by_label(exporter.state.unmatched.counts),
    ),
    (
        _family("exporter_robots", "gauge", "Robots known.", EXPORTER),
        lambda exporter: _one(len(exporter.state.robots)),
    ),
    (
        _family(
            "exporter_series",
            "gauge",
            "Series served at the last scrape of the family.",
            (*EXPORTER, "family"),
        ),
        lambda exporter: _by_label(exporter.exposition.series),
    ),
    (
        _family("exporter_series_limit", "gauge", "The config's limit of all series.", EXPORTER),
        lambda exporter: _one(exporter.state.fleet.limits.series),
    ),
    (
        _family(
            "exporter_rejected_total",
            "counter",
            "Messages of no known robot that were rejected, by reason; every reason from 0 on.",
            (*EXPORTER, "reason"),
        ),
        lambda exporter: _by_label(exporter.state.rejected),
    ),
    (
        _family(
            "exporter_settled",
            "gauge",
            "1 once restart_grace is over, and faults that a lost state had are judged again.",
            EXPORTER,
            Part.FAULTS,
        ),
        lambda exporter: _one(exporter.state.settled(read_clocks())),
    ),
    (
        _family(
            "exporter_decode_seconds_total",
            "counter",
            "CPU time spent on decoding messages.",
            EXPORTER,
        ),
        lambda exporter: _one(exporter.listener.decode_seconds),
    ),
    (
        _family(
            "exporter_ingest_seconds_total",
            "counter",
            "CPU time spent on taking decoded messages into the state.",
            EXPORTER,
        ),
        lambda exporter: _one(exporter.listener.ingest_seconds),
    ),
    (
        _family("exporter_scrapes_total", "counter", "Scrapes answered.", EXPORTER),
        lambda exporter: _one(exporter.scrapes),
    ),
    (
        _family(
            "exporter_last_scrape_duration_seconds",
            "gauge",
            "Time that rendering the last scrape before this one took.",
            EXPORTER,
        ),
        lambda exporter: _one(exporter.scrape_seconds),
    ),
    (
        _family(
            "exporter_domain_up",
            "gauge",
            "1 where the DDS domain is joined; of domain_id zenoh, while a router answers.",
            (*EXPORTER, "domain_id"),
        ),
        lambda exporter: _by_label(
            {each: each in exporter.listener.domain_ids for each in exporter.state.fleet.domain_ids}
        ),
    ),
    (
        _family(
            "exporter_domain_error_info",
            "gauge",
            "1 with the reason why the domain could not be joined; it is tried again.",
            (*EXPORTER, "domain_id", "reason"),
        ),
        lambda exporter: [((str(each), why), 1) for each, why in exporter.listener.errors.items()],
    ),
    (
        _family(
            "exporter_discovery_last_run_timestamp_seconds",
            "gauge",
            "When the ROS graph of a joined domain was last looked at (Unix time); 0 = not yet.",
            (*EXPORTER, "domain_id"),
        ),
        lambda exporter: _by_label(exporter.listener.last_looks),
    ),
    (
        _family(
            "exporter_storage_last_write_successful",
            "gauge",
            "1 if the last write to the database succeeded, none hangs, and no unreadable file is "
            "in its place; absent with --storage.path=none.",
            EXPORTER,
        ),
        lambda exporter: None if exporter.storage is None else _one(exporter.storage.successful),
    ),
    (
        _family(
            "exporter_storage_last_write_success_timestamp_seconds",
            "gauge",
            "When the database was last written (Unix time); absent with --storage.path=none.",
            EXPORTER,
        ),
        lambda exporter: None if exporter.storage is None else _one(exporter.storage.written_at),
    ),
    (
        _family(
            "exporter_events_deleted_early_total",
            "counter",
            "Events that were deleted before --storage.retention.time because the database was "
            "full, by robot; absent with --storage.path=none.",
            (*EXPORTER, "robot"),
        ),
        lambda exporter: (
            None if exporter.storage is None else _by_label(exporter.storage.early.counts)
        ),
    ),
    (
        _family("exporter_logins_rejected_total", "counter", "Rejected logins.", EXPORTER),
        lambda exporter: _one(exporter.rejected_logins.total),
    ),
    (
        _family(
            "exporter_recording_messages_dropped_total",
            "counter",
            "Messages that no recording has: a topic sent more than its share of memory.",
            EXPORTER,
        ),
        lambda exporter: _one(exporter.recording_dropped),
    ),
    (
        _family(
            "exporter_loop_last_turn_timestamp_seconds",
            "gauge",
            "When the last turn of a loop that did not fail ended (Unix time); 0 = none yet.",
            (*EXPORTER, "loop"),
        ),
        lambda exporter: _by_label({each.name: each.last_turn for each in exporter.loops()}),
    ),
    (
        _family(
            "exporter_loop_errors_total",
            "counter",
            "Turns of a loop, or parts of a domain's turns, that failed. Each is a bug. At most "
            "one a minute is logged.",
            (*EXPORTER, "loop"),
        ),
        lambda exporter: _by_label({each.name: each.errors for each in exporter.loops()}),
    ),
    (
        _family(
            "exporter_alertmanager_up",
            "gauge",
            "1 while Alertmanager answers when asked for acknowledgements; "
            "only with --alertmanager.url.",
            EXPORTER,
        ),
        lambda exporter: (
            None
            if exporter.alertmanager is None
            else _one(exporter.alertmanager.answers(read_clocks()))
        ),
    ),
    (
        _family(
            "exporter_query_successful",
            "gauge",
            "1 if Prometheus' last answer to a query of fleet.yml could be used, 0 if there was "
            "none; absent before the first.",
            (*EXPORTER, "query"),
        ),
        lambda exporter: [
            ((each.query.name,), float(not each.error))
            for each in exporter.outcomes()
            if each.error is not None
        ],
    ),
    (
        _family(
            "exporter_query_rows",
            "gauge",
            "Elements of the last answer to a query of fleet.yml: used as components, or skipped "
            "because they name no robot of this fleet.",
            (*EXPORTER, "query", "what"),
        ),
        lambda exporter: [
            ((each.query.name, what), float(number))
            for each in exporter.outcomes()
            if each.error == ""
            for what, number in (("used", each.rows), ("skipped", each.skipped))
        ],
    ),
    (
        _family(
            "canary_start_timestamp_seconds",
            "gauge",
            "When the canary that is under way began (Unix time); only with `canary` in fleet.yml.",
            EXPORTER,
            Part.FAULTS,
        ),
        lambda exporter: (
            None if (start := exporter.canary.start) is None else _one(round(start, 3))
        ),
    ),
    (
        _family(
            "shard_robots",
            "gauge",
            "What exporters that share a fleet tell one another: of how many robots a larger fault "
            "is a share (present), how many it counts (counted), and how many of these are in "
            "trouble now (fresh). Only with --shard.",
            (*EXPORTER, "shards", "scope", "site", "component", "state"),
            Part.FAULTS,
        ),
        lambda exporter: (
            None if exporter.others is None else list(exporter.others.samples(read_clocks()))
        ),
    ),
    (
        _family(
            "canary_notification_seconds",
            "histogram",
            "Time from a canary's beginning to its notification; one that does not come back "
            "counts once for each interval, as longer than 60 s. Only with `canary` in fleet.yml.",
            EXPORTER,
        ),
        _canary_times,
    ),
    *((family, partial(_of_week, read)) for family, read in ROWS),
)
EXPORTER_FAMILIES = tuple(family for family, _samples in TABLE)
ALL_FAMILIES = FLEET_FAMILIES + FAULT_FAMILIES + EXPORTER_FAMILIES


class SelfMetrics:
    """The exporter's own families and those of its process; reads the table at each scrape."""

    def __init__(self, exporter: Exporter) -> None:
        self._registries = {part: CollectorRegistry() for part in (Part.FAULTS, Part.EXPORTER)}
        for part, registry in self._registries.items():
            registry.register(_Rows(exporter, part))
        ProcessCollector(registry=self._registries[Part.EXPORTER])
        GCCollector(registry=self._registries[Part.EXPORTER])

    def render(self, *, openmetrics: bool = False, parts: Collection[Part] = ALL_PARTS) -> bytes:
        """The families as text; without OpenMetrics' closing ``# EOF``."""
        generate: Callable[[CollectorRegistry], bytes] = (
            openmetrics_exposition.generate_latest if openmetrics else generate_latest
        )
        return b"".join(
            generate(registry).removesuffix(EOF)
            for part, registry in self._registries.items()
            if part in parts
        )


@dataclass(frozen=True, eq=False)  # registered by identity
class _Rows(Collector):
    """The table's rows of one part."""

    exporter: Exporter
    part: Part

    def describe(self) -> Iterable[Metric]:
        """No family, so that registering reads nothing yet."""
        return []

    def collect(self) -> Iterable[Metric]:
        """One family for each row of the table that applies."""
        fleet = self.exporter.state.fleet
        source = [fleet.name, fleet.exporter] if fleet.exporter else [fleet.name]
        for family, read in TABLE:
            samples = read(self.exporter) if family.part is self.part else None
            if samples is None:
                continue
            names = family.labels if fleet.exporter else ("fleet", *family.labels[len(EXPORTER) :])
            if isinstance(samples, Histogram):
                histogram = HistogramMetricFamily(family.name, family.help, labels=names)
                histogram.add_metric(source, samples.buckets, samples.sum)
                yield histogram
                continue
            kind = CounterMetricFamily if family.type == "counter" else GaugeMetricFamily
            metric = kind(family.name, family.help, labels=names)
            for labels, value in samples:
                metric.add_metric([*source, *labels], value)
            yield metric
