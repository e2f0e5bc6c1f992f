"""docs/install-ansible.md: the role on a Debian 12 that has booted with systemd, and its style."""

import json
import os
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

from support import debian
from support.debian import Machine
from support.newcomer import blocks
from testbed.configuration import CHECKOUT

# ./run test --all installs it there.
PATH = f"{Path(sys.prefix) / 'deployment' / 'bin'}:{os.environ['PATH']}"
PAGE = "docs/install-ansible.md"
MISSING = [
    each for each in ("ansible-playbook", "ansible-lint") if not shutil.which(each, path=PATH)
]
ABSENT = debian.why_not() or (f"not installed: {', '.join(MISSING)}" if MISSING else None)
FLEET = 'fleet: hall\ndiscovery: [{topic: "/{robot}/diagnostics_agg"}]\n'

pytestmark = debian.marks(ABSENT)


@pytest.fixture
def machine(tmp_path: Path, debian_base: Path) -> Iterator[Machine]:
    """A Debian with Prometheus, whose prometheus.yml is that of the page."""
    # procps: Debian's prometheus.service reloads with /bin/kill.
    needed = "systemd-sysv procps sudo adduser libstdc++6 python3-apt prometheus"
    with debian.copied(debian_base, tmp_path / "debian") as root:
        debian.does(root, f"apt-get install --quiet=2 --yes --no-install-recommends {needed}")
        (prometheus,) = blocks(PAGE, "## Prometheus")
        (root / "etc" / "prometheus" / "prometheus.yml").write_text(prometheus)
        with debian.booted(root, tmp_path / "debian.log") as booted:
            yield booted


class Control:
    """The machine on which Ansible runs: a checkout, the package, fleet.yml, and the inventory."""

    def __init__(self, folder: Path, package: Path, machine: Machine) -> None:
        play, self.command = blocks(PAGE, "## Play")
        self.folder = folder
        self.site = folder / "site.yml"
        self.fleet = folder / "fleet.yml"
        for name in ("packaging", "prometheus"):
            (folder / name).symlink_to(CHECKOUT / name)
        (folder / "dist").mkdir()
        self.fleet.write_text(FLEET)
        (folder / "dist" / package.name).symlink_to(package)
        self.site.write_text(play)
        # Instead of chroot: into the machine that has booted there.
        enter = folder / "enter"
        enter.write_text(f'#!/bin/sh\nshift\nexec {" ".join(machine.enter)} "$@"\n')
        enter.chmod(0o755)
        host = {
            "ansible_connection": "community.general.chroot",
            "ansible_host": str(machine.root),
            "ansible_chroot_exe": str(enter),
            "ansible_python_interpreter": "/usr/bin/python3",
        }
        group = {"hosts": {"hall": host}}
        inventory = {"exporters": group, "prometheus": group}
        (folder / "hosts.yml").write_text(yaml.safe_dump(inventory))

    def plays(self) -> dict[str, int]:
        """Run the page's command; the counts of its recap."""
        env = os.environ | {"PATH": PATH, "ANSIBLE_STDOUT_CALLBACK": "ansible.posix.json"}
        script = ["bash", "-euc", f"cd {self.folder}\n{self.command}"]
        report = debian.output(script, 900, env)
        result, _ = json.JSONDecoder().raw_decode(report, report.index("{\n"))  # without warnings
        counts: dict[str, int] = result["stats"]["hall"]
        return counts


def test_the_second_run_changes_nothing(tmp_path: Path, machine: Machine, debian_package: Path):
    (tmp_path / "control").mkdir()
    control = Control(tmp_path / "control", debian_package, machine)
    first = control.plays()
    assert (first["changed"] > 5, first["failures"]) == (True, 0)
    status = machine.does("systemctl status ros-diagnostics-exporter")
    assert "active (running)" in status
    assert "--alertmanager.url=http://localhost:9093" in status
    up = "promtool query instant http://localhost:9090 'up{job=\"ros-diagnostics\"}'"
    machine.until_output(up, "=> 1", 180)
    machine.until_output(info("hall"), "=> 1", 180)
    rules = "ls /etc/prometheus/ros-diagnostics"
    assert set(machine.does(rules).split()) == {
        path.name for path in (CHECKOUT / "prometheus" / "rules").glob("*.yml")
    } - {"servers.yml"}

    second = control.plays()
    assert (second["changed"], second["failures"]) == (0, 0)

    pid = machine.does("systemctl show --property MainPID --value ros-diagnostics-exporter")
    control.fleet.write_text(FLEET.replace("hall", "warehouse"))
    third = control.plays()
    assert (third["changed"], third["failures"]) == (2, 0)  # the file, and the reload
    machine.until_output(info("warehouse"), "=> 1", 180)
    assert pid == machine.does("systemctl show --property MainPID --value ros-diagnostics-exporter")

    control.fleet.write_text("fleet: [1\n")
    with pytest.raises(AssertionError, match=r"fleet\.yml"):
        control.plays()
    assert "warehouse" in machine.does("cat /etc/ros-diagnostics-exporter/fleet.yml")


def info(fleet: str) -> str:
    """The query of the exporters of the fleet that Prometheus scrapes: one."""
    query = f'count(ros_diagnostics_exporter_settled{{fleet="{fleet}"}})'
    return f"promtool query instant http://localhost:9090 '{query}'"


def test_ansible_lint_has_nothing_to_say(tmp_path: Path):
    (tmp_path / "site.yml").write_text("---\n" + blocks(PAGE, "## Play")[0])
    shutil.copytree(CHECKOUT / "packaging" / "ansible" / "roles", tmp_path / "roles")
    command = ["ansible-lint", "--offline", "--strict", "--profile", "production", "--nocolor"]
    script = f"cd {tmp_path} && exec {' '.join(command)}"
    report = debian.output(["bash", "-c", script], 300, os.environ | {"PATH": PATH})
    assert "0 failure(s), 0 warning(s)" in report
