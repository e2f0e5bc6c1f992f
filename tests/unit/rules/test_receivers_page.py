"""The receivers of docs/receivers.md are accepted by amtool."""

from pathlib import Path
from typing import Any

import pytest
import yaml

from support.receivers_page import PAGE, documented, written
from support.shipped_rules import ALERTMANAGER, run_tool

RECEIVERS = documented()


@pytest.mark.parametrize("receiver", RECEIVERS, ids=lambda each: each["name"])
def test_amtool_accepts_each_receiver(receiver: dict[str, Any], tmp_path: Path):
    assert "SUCCESS" in run_tool("amtool", "check-config", written(tmp_path, [receiver]))


def test_the_route_is_to_a_receiver_of_the_page_which_gets_each_fault_once(tmp_path: Path):
    _, _, text = PAGE.partition("that are there\n")
    [route] = yaml.safe_load(text.partition("```")[0])
    [receiver] = [each for each in RECEIVERS if each["name"] == route["receiver"]]
    shipped = yaml.safe_load((ALERTMANAGER / "alertmanager.yml").read_text())
    shipped["route"]["routes"].insert(0, route)
    shipped["receivers"].append(receiver)
    file = tmp_path / "alertmanager.yml"
    file.write_text(yaml.safe_dump(shipped))

    def is_sent(name: str) -> bool:
        labels = [f"alertname={name}", "severity=critical", "step=1"]
        routes = "amtool", "config", "routes", "test", f"--config.file={file}"
        return receiver["name"] in run_tool(*routes, *labels).strip().split(",")

    assert is_sent("RosDiagnosticsComponentCritical")
    assert not is_sent("RosDiagnosticsUnacknowledged")
