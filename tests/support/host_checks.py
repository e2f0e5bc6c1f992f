"""Real node_exporter and blackbox_exporter as the distribution packages them; jobs for them."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

import yaml

from testbed.configuration import CHECKOUT
from testbed.programs import distributed
from testbed.site import Site, free_address

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


def start(site: Site, *options: str) -> tuple[str, str]:
    """Start both; returns the addresses of node_exporter and blackbox_exporter.

    ``options`` are further ones of node_exporter.

    Raises:
        testbed.programs.MissingProgram: One is not installed.
    """
    sensors = site.write("sensors/temperature.prom", SENSOR).parent
    address = free_address()
    argv = [
        distributed(*NODE),
        f"--web.listen-address={address}",
        f"--collector.textfile.directory={sensors}",
        "--no-collector.hwmon",
        "--no-collector.thermal_zone",
        *options,
    ]
    site.start_program("node_exporter", argv, address, "/metrics")
    return address, start_blackbox(site)


def start_blackbox(site: Site) -> str:
    """Start blackbox_exporter alone; returns its address."""
    config, address = site.write("blackbox.yml", MODULES), free_address()
    argv = [
        distributed(*BLACKBOX),
        f"--web.listen-address={address}",
        f"--config.file={config}",
    ]
    site.start_program("blackbox_exporter", argv, address, "/metrics")
    return address
