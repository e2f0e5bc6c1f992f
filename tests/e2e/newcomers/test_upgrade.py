"""A site of the version before upgrades as docs/CHANGELOG.md and docs/deployment.md say.

`tests/data/version_0_1` has files of such a site: state and events as that version wrote them while
a motor was broken, its fleet.yml, targets, rules/settings.yml, and a site.tmpl that was edited.
"""

from __future__ import annotations

import json
import re
import shutil
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from ros_diagnostics_exporter.config.fleet import FaultSettings
from ros_diagnostics_exporter.config.load import load
from support.newcomer import Newcomer, blocks, newcomer
from testbed.configuration import CHECKOUT

pytestmark = [pytest.mark.e2e, pytest.mark.slow, pytest.mark.timeout(600)]

OLD = CHECKOUT / "tests" / "data" / "version_0_1"
OLD_RULES = ("acknowledged", "alerts", "overview", "settings", "timeline", "values", "states")
BIN = Path(sys.executable).parent


def later(content: Any, seconds: float) -> Any:
    """The content with its times (Unix) so much later."""
    if isinstance(content, dict):
        return {key: later(value, seconds) for key, value in content.items()}
    if isinstance(content, list):
        return [later(each, seconds) for each in content]
    is_time = isinstance(content, float) and content > 1e9
    return content + seconds if is_time else content


def install_old(person: Newcomer) -> float:
    """The files of the site that is upgraded; since when the motor is broken."""
    etc = person.folder / "etc"
    state = json.loads((OLD / "state.json").read_text())
    shift = time.time() - 60 - state["written"]
    data = person.home / "state"
    data.mkdir()
    (data / "state").write_text(json.dumps(later(state, shift)))
    events = [json.loads(line) for line in (OLD / "events.jsonl").read_text().splitlines()]
    lines = [json.dumps(later(each, shift)) + "\n" for each in events]
    (data / "events.jsonl").write_text("".join(lines))
    (broken,) = (each["time"] for each in events if each.get("after") == "ERROR")

    (etc / "ros-diagnostics-exporter").mkdir()
    shutil.copy(OLD / "fleet.yml", etc / "ros-diagnostics-exporter")
    (etc / "default").mkdir(exist_ok=True)
    args = "ARGS=--alertmanager.url=http://localhost:9093\n"
    (etc / "default" / "ros-diagnostics-exporter").write_text(args)
    for name in ("prometheus", "alertmanager"):
        shutil.rmtree(etc / name, ignore_errors=True)
    (etc / "prometheus" / "rules").mkdir(parents=True)
    for name in OLD_RULES:
        (etc / "prometheus" / "rules" / f"{name}.yml").write_text("groups: []\n")
    shutil.copy(OLD / "settings.yml", etc / "prometheus" / "rules")
    (etc / "prometheus" / "rules" / "site.yml").write_text("groups: []\n")
    shutil.copytree(CHECKOUT / "prometheus" / "targets", etc / "prometheus" / "targets")
    shutil.copy(OLD / "targets.yml", etc / "prometheus" / "targets" / "ros-diagnostics.yml")
    (etc / "alertmanager" / "templates").mkdir(parents=True)
    shutil.copy(OLD / "site.tmpl", etc / "alertmanager" / "templates")
    return broken + shift


def upgrade(person: Newcomer) -> None:
    """What the two pages say, but for pip: the tests' own environment has the new version."""
    (commands,) = blocks("docs/deployment.md", "## Upgrade")
    pip, *copies = commands.splitlines()
    assert "pip install --upgrade" in pip
    person.does("mkdir -p /etc/systemd/system\n" + "\n".join(copies))
    changelog = (CHECKOUT / "docs" / "CHANGELOG.md").read_text()
    remove = re.search(r"```sh\n(.*?) *```", changelog, re.DOTALL)
    faults = re.search(r"```yaml\n( *faults:.*?) *```", changelog, re.DOTALL)
    assert remove
    assert faults
    person.does(remove[1])
    etc = person.folder / "etc"
    fleet = etc / "ros-diagnostics-exporter" / "fleet.yml"
    fleet.write_text(fleet.read_text() + re.sub(r"^ {4}", "", faults[1], flags=re.MULTILINE))
    for name in ("prometheus", "alertmanager"):
        shutil.copy(CHECKOUT / name / f"{name}.yml", etc / name)


def test_faults_mails_and_history_go_on_after_the_upgrade(tmp_path: Path):
    with newcomer(tmp_path) as person:
        since = install_old(person)
        upgrade(person)
        kept = {each.name for each in (tmp_path / "etc/prometheus/rules").iterdir()}
        assert kept == {each.name for each in (CHECKOUT / "prometheus/rules").iterdir()} | {
            "site.yml"
        }
        fleet = load(tmp_path / "etc/ros-diagnostics-exporter/fleet.yml")
        common = replace(FaultSettings().common, share=0.3)
        shipped = replace(FaultSettings(), common=common)
        assert fleet.faults == shipped, "CHANGELOG's values are not those that it says"
        person.does("promtool check config /etc/prometheus/prometheus.yml")
        person.does("amtool check-config /etc/alertmanager/alertmanager.yml")

        person.has_a_mail_server()
        robots = person.starts("robots", f"exec {BIN}/virtual-robots --robots 2 --domain-id 96")
        robots.wait_for_output("ready")
        person.does(f"{BIN}/virtual-robots fault robot_1 'Motor 1' error --domain-id 96")
        person.starts_unit(BIN, person.home / "state")
        person.starts(
            "prometheus",
            "cd ~ && exec prometheus --config.file=/etc/prometheus/prometheus.yml",
        )
        person.starts(
            "alertmanager",
            "cd ~ && exec alertmanager --config.file=/etc/alertmanager/alertmanager.yml"
            " --cluster.listen-address=",
        )
        person.until_mail("** PROBLEM ** hall/robot_1 Motor 1 is CRITICAL")

        (mail,) = person.mails()
        assert mail["To"] == "old-robots@example.org"
        api = "curl -s localhost:9877/api/v1/"
        (fault,) = json.loads(person.does(f"{api}faults"))["faults"]
        assert fault["since"] == pytest.approx(since, abs=1)
        events = json.loads(person.does(f"{api}'events?robot=robot_1&level=ERROR'"))["events"]
        assert events[-1]["time"] == pytest.approx(since, abs=1)
        names = {each.name for each in (person.home / "state").iterdir()}
        assert {"exporter.db", "state.migrated", "events.jsonl.migrated"} <= names
