"""Real node_exporter and blackbox_exporter, as the distribution packages them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

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
MODULES = "modules: {icmp: {prober: icmp}, tcp_connect: {prober: tcp}}\n"


def ping_error(blackbox: str) -> str:
    """The error of a blackbox exporter that may not send pings, from its log; empty if it may."""
    path = "/probe?module=icmp&target=127.0.0.1&debug=true"
    text = get(blackbox, path, seconds=30).decode()
    if "\nprobe_success 1\n" in text:
        return ""
    return next(line for line in text.splitlines() if "Error listening to socket" in line)


@contextmanager
def running(folder: Path) -> Iterator[tuple[str, str]]:
    """Start both exporters; yields the addresses of node_exporter and blackbox_exporter.

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
