"""Real node_exporter and blackbox_exporter as the distribution packages them; jobs for them."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml

from testbed.configuration import CHECKOUT
from testbed.http import answers, get
from testbed.polling import until
from testbed.ports import free_port
from testbed.processes import Process
from testbed.programs import distributed

NODE = ("prometheus-node-exporter", "node_exporter")  # Debian's name first
BLACKBOX = ("prometheus-blackbox-exporter", "blackbox_exporter")
DEGREES = 48
# A virtual machine has no sensor; node_exporter serves this one from a file.
SENSOR = f'node_hwmon_temp_celsius{{chip="soc",sensor="temp1"}} {DEGREES}\n'
# Of Debian's blackbox.yml, those that the jobs use.
MODULES = """
modules:
  icmp: {prober: icmp}
  tcp_connect: {prober: tcp}
  http_2xx: {prober: http}
  ssh_banner: {prober: tcp, tcp: {query_response: [{expect: "^SSH-2.0-"}]}}
"""


def ping_error(blackbox: str) -> str:
    """The error of a blackbox exporter that may not send pings, from its log; empty if it may."""
    path = "/probe?module=icmp&target=127.0.0.1&debug=true"
    text = get(blackbox, path, seconds=30).decode()
    if "\nprobe_success 1\n" in text:
        return ""
    return next(line for line in text.splitlines() if "Error listening to socket" in line)


def jobs(replaced: Mapping[str, str], removed: Sequence[str] = ()) -> list[dict[str, Any]]:
    """The jobs in the comments at the end of prometheus.yml, scraped as often as all others.

    Args:
        replaced: Texts of them and what is put there, such as addresses of this machine.
        removed: Names of jobs that are left out.
    """
    text = (CHECKOUT / "prometheus" / "prometheus.yml").read_text()
    _rest, mark, end = text.partition("  # --- Hosts:")
    assert mark
    shown = "\n".join(re.sub(r"^  # (?!---)", "  ", line) for line in end.splitlines()[1:])
    for old, new in replaced.items():
        assert old in shown
        shown = shown.replace(old, new)
    found: list[dict[str, Any]] = yaml.safe_load(shown)
    for job in found:
        for sd in job.get("http_sd_configs", ()):
            sd["refresh_interval"] = "1s"
        job.pop("scrape_interval", None)
    return [job for job in found if job["job_name"] not in removed]


@contextmanager
def running(folder: Path, *options: str) -> Iterator[tuple[str, str]]:
    """Start both exporters; yields the addresses of node_exporter and blackbox_exporter.

    ``options`` are further ones of node_exporter.

    Raises:
        testbed.programs.MissingProgram: One is not installed.
    """
    (folder / "sensors").mkdir()
    (folder / "sensors" / "temperature.prom").write_text(SENSOR)
    (folder / "blackbox.yml").write_text(MODULES)
    node, blackbox = (f"127.0.0.1:{free_port()}" for _ in range(2))
    commands = {
        node: [
            distributed(*NODE),
            f"--web.listen-address={node}",
            f"--collector.textfile.directory={folder / 'sensors'}",
            "--no-collector.hwmon",
            "--no-collector.thermal_zone",
            *options,
        ],
        blackbox: [
            distributed(*BLACKBOX),
            f"--web.listen-address={blackbox}",
            f"--config.file={folder / 'blackbox.yml'}",
        ],
    }
    processes = [
        Process(Path(argv[0]).name, argv, None, folder / f"{Path(argv[0]).name}.log")
        for argv in commands.values()
    ]
    try:
        for address, process in zip(commands, processes, strict=True):
            process.start()
            until(lambda at=address: answers(at, "/metrics"), process.describe, 30)
        yield node, blackbox
    finally:
        for process in processes:
            process.stop()
