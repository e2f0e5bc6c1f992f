"""The files of docs/server.md are where both servers look for them, and an upgrade replaces ours."""

from __future__ import annotations

from pathlib import Path

import pytest

from support.newcomer import Newcomer, blocks, newcomer

pytestmark = [pytest.mark.e2e, pytest.mark.slow, pytest.mark.timeout(600)]

PACKAGED = "/usr/share/ros-diagnostics-exporter"


def commands(person: Newcomer, heading: str) -> str:
    """The page's commands below a heading; the package's folder is that of the checkout."""
    (text,) = blocks("docs/server.md", heading)
    return text.replace(PACKAGED, str(person.checkout))


def lines(text: str, *programs: str) -> str:
    """The commands of these programs."""
    return "\n".join(line for line in text.splitlines() if line.split()[0] in programs)


def test_the_servers_find_their_files_and_an_upgrade_replaces_the_rules(tmp_path: Path):
    with newcomer(tmp_path) as person:
        person.does("rm -rf /etc/prometheus /etc/alertmanager; mkdir -p /etc/prometheus /etc/default")
        person.does(commands(person, "### 2. Copy the configuration"))
        person.does(commands(person, "### 3. Give each service its flags"))
        checks = lines(commands(person, "### 5. Check and start"), "promtool", "amtool")
        assert "7 rule files found" in person.does(checks)
        for name, own in (("prometheus", "--config.file=/etc/prometheus/prometheus.yml"), ("alertmanager", "")):
            service = "prometheus" if own else "prometheus-alertmanager"
            folder = f"--storage.{'tsdb.' if own else ''}path={person.home}/{name}"
            # As systemd does: the words of ARGS.
            person.starts(name, f". /etc/default/{service}\nexec {service} {own} {folder} $ARGS")
        person.until_output("curl -s localhost:9090/-/ready", "Ready")
        person.until_output("curl -s localhost:9093/-/ready", "OK")
        runbook = "localhost:9090/user/alerts/RosDiagnosticsRobotSilent.md"
        assert "RosDiagnosticsRobotSilent" in person.does(f"curl --fail --silent {runbook}")

        person.does("echo old >/etc/prometheus/rules/faults.yml")
        upgrade = commands(person, "## Upgrade")
        person.does(lines(upgrade, "cp"))
        assert "7 rule files found" in person.does(checks)
