"""A real Prometheus and a real Alertmanager with the shipped configuration, clocks shortened.

With the environment variable PROMETHEUS naming a program, that one runs instead of the
distribution's: so the same tests try another release.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from testbed.polling import until
from testbed.ports import free_port
from testbed.processes import Process

ROOT = Path(__file__).resolve().parents[2]
ALERTMANAGERS = ("prometheus-alertmanager", "alertmanager")  # Debian's name first


@dataclass(frozen=True)
class Site:
    """Where the servers answer, as HOST:PORT."""

    prometheus: str
    alertmanager: str

    def query(self, expr: str, at: float | None = None) -> list[dict[str, Any]]:
        """The elements of an instant vector; a scalar as one without labels.

        Raises:
            ValueError: Prometheus refuses the expression; the text says why.
        """
        found = self._ask("query", query=expr, **({} if at is None else {"time": at}))
        if found["resultType"] == "scalar":
            return [{"metric": {}, "value": found["result"]}]
        result: list[dict[str, Any]] = found["result"]
        return result

    def query_range(self, expr: str, start: float, end: float, step: float) -> list[dict[str, Any]]:
        """The series of a range; raises as `query`."""
        result: list[dict[str, Any]] = self._ask(
            "query_range", query=expr, start=start, end=end, step=step
        )["result"]
        return result

    def alerts(self) -> list[dict[str, Any]]:
        """All alerts that are active now, pending ones too, with their texts."""
        result: list[dict[str, Any]] = self._ask("alerts")["alerts"]
        return result

    def _ask(self, what: str, **parameters: object) -> dict[str, Any]:
        body = urllib.parse.urlencode(parameters).encode() if parameters else None
        request = urllib.request.Request(f"http://{self.prometheus}/api/v1/{what}", body)
        try:
            with urllib.request.urlopen(request, timeout=60) as answer:
                data: dict[str, Any] = json.load(answer)["data"]
                return data
        except urllib.error.HTTPError as refused:
            said = json.load(refused)["error"]
            raise ValueError(f"{said}\n{parameters['query']}") from refused


def missing_program() -> str | None:
    """What is not installed, of what a site needs; None if all is."""
    if not any(map(shutil.which, ALERTMANAGERS)):
        return ALERTMANAGERS[0]
    return next((name for name in ("prometheus", "promtool") if not shutil.which(name)), None)


@contextmanager
def running(
    folder: Path,
    exporters: Mapping[str, str],
    settings: Mapping[str, int],
    *,
    probes: Sequence[dict[str, Any]] = (),
    interval: str = "1s",
    history: Path | None = None,
    prepare: Callable[[Path], None] = lambda _: None,
) -> Iterator[Site]:
    """Start both servers in ``folder``; yield when both are ready; end them.

    Args:
        folder: For configuration, data and logs.
        exporters: Fleet -> HOST:PORT.
        settings: Names in rules/settings.yml (`restart_grace`) -> seconds.
        probes: Scrape configurations to add, as a site adds those of its blackbox_exporter.
        interval: Of scrapes and evaluations.
        history: OpenMetrics text of the past, to begin with.
        prepare: Called with the folder of Prometheus' configuration before it is read.
    """
    site = Site(f"127.0.0.1:{free_port()}", f"127.0.0.1:{free_port()}")
    _configure(folder, site, exporters, settings)
    _keep_pace(folder / "prometheus" / "rules" / "timeline.yml", interval)
    _edit(folder / "prometheus" / "prometheus.yml", probes, interval)
    prepare(folder / "prometheus")
    if history is not None:
        # Blocks as long as compaction makes them; promtool reads all of the text for each.
        argv = ["promtool", "tsdb", "create-blocks-from", "--max-block-duration=744h"]
        argv += ["openmetrics", str(history), str(folder / "tsdb")]
        subprocess.run(argv, check=True, capture_output=True, timeout=1800)
    servers = [
        Process(
            "prometheus",
            [
                os.environ.get("PROMETHEUS", "prometheus"),
                f"--config.file={folder / 'prometheus' / 'prometheus.yml'}",
                f"--storage.tsdb.path={folder / 'tsdb'}",
                "--storage.tsdb.retention.time=90d",
                f"--web.listen-address={site.prometheus}",
                "--log.level=warn",
            ],
            None,
            folder / "prometheus.log",
        ),
        Process(
            "alertmanager",
            [
                next(filter(None, map(shutil.which, ALERTMANAGERS))),
                f"--config.file={folder / 'alertmanager' / 'alertmanager.yml'}",
                f"--storage.path={folder / 'nflog'}",
                f"--web.listen-address={site.alertmanager}",
                f"--cluster.listen-address=127.0.0.1:{free_port()}",
                "--cluster.advertise-address=127.0.0.1:1",
                "--log.level=warn",
            ],
            None,
            folder / "alertmanager.log",
        ),
    ]
    try:
        for server in servers:
            server.start()
        for server, address in zip(servers, (site.prometheus, site.alertmanager), strict=True):
            until(lambda at=address: _ready(at), server.describe, 60)
        yield site
    finally:
        for server in servers:
            server.stop()


def _ready(address: str) -> bool:
    try:
        with urllib.request.urlopen(f"http://{address}/-/ready", timeout=5) as answer:
            return bool(answer.status == 200)
    except OSError:
        return False


def _configure(
    folder: Path,
    site: Site,
    exporters: Mapping[str, str],
    settings: Mapping[str, int],
) -> None:
    for name in ("prometheus", "alertmanager"):
        shutil.copytree(ROOT / name, folder / name)
    prometheus = folder / "prometheus"
    _write_targets(prometheus / "targets", site, exporters)
    path = prometheus / "rules" / "settings.yml"
    document = yaml.safe_load(path.read_text())
    rules = {rule["record"]: rule for group in document["groups"] for rule in group["rules"]}
    for name, seconds in settings.items():
        rules[f"ros_diagnostics:{name}:seconds"]["expr"] = f"vector({seconds})"
    path.write_text(yaml.safe_dump(document))
    mail = folder / "alertmanager" / "alertmanager.yml"
    routes = yaml.safe_load(mail.read_text())
    routes["global"]["smtp_smarthost"] = f"127.0.0.1:{free_port()}"  # where nobody listens
    mail.write_text(yaml.safe_dump(routes))


def _keep_pace(path: Path, interval: str) -> None:
    """Thin out the past as much as where scrapes come every 5 s."""
    document = yaml.safe_load(path.read_text())
    document["groups"][0]["interval"] = f"{6 * int(interval.removesuffix('s'))}s"
    path.write_text(yaml.safe_dump(document))


def _edit(path: Path, probes: Sequence[dict[str, Any]], interval: str) -> None:
    config = yaml.safe_load(path.read_text())
    config["global"].update(scrape_interval=interval, evaluation_interval=interval)
    config["scrape_configs"].extend(probes)
    path.write_text(yaml.safe_dump(config))


def _write_targets(folder: Path, site: Site, exporters: Mapping[str, str]) -> None:
    groups: dict[str, list[dict[str, Any]]] = {
        "prometheus": [{"targets": [site.prometheus]}],
        "alertmanager": [{"targets": [site.alertmanager]}],
        "ros-diagnostics": [
            {"targets": [address], "labels": {"fleet": fleet}}
            for fleet, address in exporters.items()
        ],
    }
    for job, targets in groups.items():
        (folder / f"{job}.yml").write_text(yaml.safe_dump(targets))
