"""A real Prometheus and Alertmanager with the shipped configuration and short durations.

PROMETHEUS=/path/to/prometheus runs another release than the distribution's.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import yaml

from support import short_clocks
from testbed import servers
from testbed.ports import free_port

ROOT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class Site:
    """The addresses of the servers, as HOST:PORT, and what ends the second before its time."""

    prometheus: str
    alertmanager: str
    stop_alertmanager: Callable[[], None] = lambda: None

    def query(self, expr: str, at: float | None = None) -> list[dict[str, Any]]:
        """The elements of an instant vector; a scalar as one without labels.

        Raises:
            ValueError: Prometheus rejects the expression; the text has its error.
        """
        found = self._get("query", query=expr, **({} if at is None else {"time": at}))
        if found["resultType"] == "scalar":
            return [{"metric": {}, "value": found["result"]}]
        result: list[dict[str, Any]] = found["result"]
        return result

    def query_range(self, expr: str, start: float, end: float, step: float) -> list[dict[str, Any]]:
        """The series of a range; raises as `query`."""
        result: list[dict[str, Any]] = self._get(
            "query_range", query=expr, start=start, end=end, step=step
        )["result"]
        return result

    def alerts(self) -> list[dict[str, Any]]:
        """All alerts that are pending or firing, with annotations."""
        result: list[dict[str, Any]] = self._get("alerts")["alerts"]
        return result

    def _get(self, what: str, **parameters: object) -> dict[str, Any]:
        body = urllib.parse.urlencode(parameters).encode() if parameters else None
        request = urllib.request.Request(f"http://{self.prometheus}/api/v1/{what}", body)
        try:
            with urllib.request.urlopen(request, timeout=60) as answer:
                data: dict[str, Any] = json.load(answer)["data"]
                return data
        except urllib.error.HTTPError as error:
            reason = json.load(error)["error"]
            raise ValueError(f"{reason}\n{parameters['query']}") from error


@contextmanager
def running(
    folder: Path,
    exporters: Mapping[str, str],
    *,
    probes: Sequence[dict[str, Any]] = (),
    interval: str = "1s",
    history: Path | None = None,
    prepare: Callable[[Path], None] = lambda _: None,
    receivers: Callable[[dict[str, Any]], None] | None = None,
    prometheus: str | None = None,
) -> Iterator[Site]:
    """Start both servers in ``folder``; yield when both are ready; stop them.

    Args:
        folder: For configuration, data and logs.
        exporters: Fleet -> HOST:PORT.
        probes: Scrape configurations to add, such as those of a blackbox_exporter.
        interval: Of scrapes and evaluations.
        history: OpenMetrics text, imported before Prometheus starts.
        prepare: Called with the folder of Prometheus' configuration before it is read.
        receivers: Edits Alertmanager's configuration, whose mails never arrive; else without
            webhooks.
        prometheus: HOST:PORT of Prometheus, where it has to be known before.
    """
    site = Site(prometheus or f"127.0.0.1:{free_port()}", f"127.0.0.1:{free_port()}")
    _configure(folder, site, exporters, receivers or _without_webhooks)
    short_clocks.set_interval(folder / "prometheus", int(interval.removesuffix("s")))
    short_clocks.edit(
        folder / "prometheus" / "prometheus.yml",
        lambda config: config["scrape_configs"].extend(probes),
    )
    prepare(folder / "prometheus")
    if history is not None:
        # As long as those of compaction: promtool reads the whole text for each block.
        argv = ["promtool", "tsdb", "create-blocks-from", "--max-block-duration=744h"]
        argv += ["openmetrics", str(history), str(folder / "tsdb")]
        subprocess.run(argv, check=True, capture_output=True, timeout=1800)
    server = servers.prometheus(
        folder,
        folder / "prometheus" / "prometheus.yml",
        site.prometheus,
        "--storage.tsdb.retention.time=90d",
    )
    alertmanager = servers.alertmanager(
        folder,
        folder / "alertmanager" / "alertmanager.yml",
        site.alertmanager,
        "--cluster.advertise-address=127.0.0.1:1",
        cluster=f"127.0.0.1:{free_port()}",
    )
    with servers.running(server, alertmanager):
        yield replace(site, stop_alertmanager=alertmanager.process.stop)


def _configure(
    folder: Path,
    site: Site,
    exporters: Mapping[str, str],
    receivers: Callable[[dict[str, Any]], None],
) -> None:
    for name in ("prometheus", "alertmanager"):
        shutil.copytree(ROOT / name, folder / name)
    prometheus = folder / "prometheus"
    _write_targets(prometheus / "targets", site, exporters)
    for edit in (_without_mails, receivers):
        short_clocks.edit(folder / "alertmanager" / "alertmanager.yml", edit)


def _without_mails(config: dict[str, Any]) -> None:
    config["global"]["smtp_smarthost"] = f"127.0.0.1:{free_port()}"  # nothing listens there


def _without_webhooks(config: dict[str, Any]) -> None:
    for receiver in config["receivers"]:
        receiver.pop("webhook_configs", None)


def _write_targets(folder: Path, site: Site, exporters: Mapping[str, str]) -> None:
    groups: dict[str, list[dict[str, Any]]] = {
        "prometheus": [{"targets": [site.prometheus]}],
        "alertmanager": [{"targets": [site.alertmanager]}],
        "ros-diagnostics": [{"targets": list(exporters.values())}],
    }
    for job, targets in groups.items():
        (folder / f"{job}.yml").write_text(yaml.safe_dump(targets))
