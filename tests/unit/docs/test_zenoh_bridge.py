"""What the owner of a robot installs for zenoh: one config, by a unit or by a container."""

import re
import shutil

import pytest
import yaml

from support.called import called
from support.shipped_rules import ROOT

FOLDER = ROOT / "packaging" / "zenoh"
UNIT = FOLDER / "zenoh-bridge-ros2dds.service"
READ = "/etc/zenoh-bridge-ros2dds/conf.json5"


def test_the_page_shows_the_config():
    page = (ROOT / "docs" / "beyond-the-lan.md").read_text()
    _comment, _end, config = (FOLDER / "bridge.json5").read_text().partition("\n")
    assert f"```json5\n{config}```" in page


def test_unit_and_container_start_the_bridge_with_the_config():
    [bridge] = yaml.safe_load((FOLDER / "compose.yaml").read_text())["services"].values()
    assert bridge["command"] == ["-c", READ]
    assert f"./bridge.json5:{READ}:ro" in bridge["volumes"]
    assert re.search(
        rf"^ExecStart=\S+/zenoh-bridge-ros2dds -c {READ}$", UNIT.read_text(), re.MULTILINE
    )


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="no systemd here")
def test_systemd_accepts_the_unit(tmp_path):
    unit = tmp_path / UNIT.name
    unit.write_text(UNIT.read_text().replace("/usr/bin/zenoh-bridge-ros2dds", "/bin/true"))
    assert called(["systemd-analyze", "verify", unit]).stderr == ""
