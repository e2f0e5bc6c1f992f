"""The fleet.yml of the Debian package."""

from pathlib import Path

from ros_diagnostics_exporter.config.load import load
from ros_diagnostics_exporter.config.missions import rule_for
from testbed.configuration import CHECKOUT

SHIPPED = CHECKOUT / "packaging" / "debian" / "fleet.yml"


def test_the_entries_for_nav2_load_once_they_are_uncommented(tmp_path: Path):
    lines = SHIPPED.read_text().splitlines(keepends=True)
    ours = [each for each in lines if each.startswith(("    # actions:", "    #   - {"))]
    assert len(ours) == 5
    text = "".join(each.replace("    # ", "    ", 1) if each in ours else each for each in lines)
    (tmp_path / "fleet.yml").write_text(text)
    rules = load(tmp_path / "fleet.yml").profiles["default"].actions

    assert [each for each in ("spin", "wait", "dock_robot") if rule_for(rules, "/r", each)] == [
        "spin",
        "wait",
        "dock_robot",
    ]


def test_the_entry_in_its_comment_takes_a_robot_without_a_namespace(tmp_path: Path):
    text = SHIPPED.read_text()
    for line in ("robots:", "  - {name: robot"):
        assert text.count(f"\n# {line}") == 1
        text = text.replace(f"\n# {line}", f"\n{line}")
    (tmp_path / "fleet.yml").write_text(text)
    (robot,) = load(tmp_path / "fleet.yml").robots

    assert (robot.name, robot.domain_id, robot.namespace) == ("robot", 0, "")
