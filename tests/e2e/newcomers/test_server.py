"""The files of docs/server.md are where the servers look, and an upgrade replaces ours."""

from pathlib import Path

import pytest

from support.newcomer import Newcomer, blocks, newcomer
from testbed.configuration import CHECKOUT

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]

PACKAGED = "/usr/share/ros-diagnostics-exporter"
FOUND = f"{len(list((CHECKOUT / 'prometheus' / 'rules').glob('*.yml')))} rule files found"


def commands(person: Newcomer, heading: str) -> str:
    """The page's commands below a heading; the package's folder is that of the checkout."""
    (text,) = blocks("docs/server.md", heading)
    return text.replace(PACKAGED, str(person.checkout))


def lines(text: str, *programs: str) -> str:
    """The commands of these programs."""
    return "\n".join(line for line in text.splitlines() if line.split()[0] in programs)


def test_the_servers_find_their_files_and_an_upgrade_replaces_the_rules(tmp_path: Path):
    with newcomer(tmp_path) as person:
        person.does("rm -rf /etc/prometheus /etc/alertmanager")
        person.does("mkdir -p /etc/prometheus /etc/default")
        person.does(commands(person, "### 2. Copy the configuration"))
        person.does(commands(person, "### 3. Give each service its flags"))
        checks = lines(commands(person, "### 5. Check and start"), "promtool", "amtool")
        assert FOUND in person.does(checks)
        # As systemd starts them: the words of ARGS.
        for name, argv in (
            ("prometheus", "--config.file=/etc/prometheus/prometheus.yml --storage.tsdb"),
            ("prometheus-alertmanager", "--storage"),
        ):
            script = f". /etc/default/{name}\nexec {name} {argv}.path={person.home}/{name} $ARGS"
            person.starts(name, script)
        person.until_output("curl -s localhost:9090/-/ready", "Ready")
        person.until_output("curl -s localhost:9093/-/ready", "OK")

        person.does("echo old >/etc/prometheus/rules/faults.yml")
        upgrade = commands(person, "## Upgrade")
        person.does(lines(upgrade, "cp"))
        assert FOUND in person.does(checks)
