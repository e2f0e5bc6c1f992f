"""Real node_exporter and blackbox_exporter, as the distribution packages them."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from testbed.http import answers, get
from testbed.polling import until
from testbed.ports import free_port
from testbed.processes import Process

NODE = ("prometheus-node-exporter", "node_exporter")  # Debian's name first
BLACKBOX = ("prometheus-blackbox-exporter", "blackbox_exporter")
DEGREES = 48
# A virtual machine has no sensor: this one stands in a file that node_exporter serves.
SENSOR = f'node_hwmon_temp_celsius{{chip="soc",sensor="temp1"}} {DEGREES}\n'
MODULES = "modules: {icmp: {prober: icmp}, tcp_connect: {prober: tcp}}\n"


def _program(names: tuple[str, ...]) -> str | None:
    return next(filter(None, map(shutil.which, names)), None)


def missing_program() -> str | None:
    """What is not installed; None if all is."""
    return next((names[0] for names in (NODE, BLACKBOX) if _program(names) is None), None)


def ping_trouble(blackbox: str) -> str:
    """What a blackbox exporter says of its own attempt to ping this machine; empty if it may."""
    path = "/probe?module=icmp&target=127.0.0.1&debug=true"
    text = get(blackbox, path, seconds=30).decode()
    if "\nprobe_success 1\n" in text:
        return ""
    return next(line for line in text.splitlines() if "Error listening to socket" in line)


@contextmanager
def running(folder: Path) -> Iterator[tuple[str, str]]:
    """Both exporters; yields where node_exporter and blackbox_exporter answer, as HOST:PORT."""
    (folder / "sensors").mkdir()
    (folder / "sensors" / "temperature.prom").write_text(SENSOR)
    (folder / "blackbox.yml").write_text(MODULES)
    node, blackbox = (f"127.0.0.1:{free_port()}" for _ in range(2))
    commands = {
        node: [
            _program(NODE),
            f"--web.listen-address={node}",
            f"--collector.textfile.directory={folder / 'sensors'}",
            "--no-collector.hwmon",
            "--no-collector.thermal_zone",
        ],
        blackbox: [
            _program(BLACKBOX),
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
