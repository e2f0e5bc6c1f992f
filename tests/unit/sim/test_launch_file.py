"""The launch file asks ROS for the right processes; ros2 launch itself is not among the wheels."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from support import launching
from virtual_robots.aggregator import Aggregator, load_parameters

LAUNCH_FILE = Path(__file__).parents[3] / "sim" / "ros_launch" / "real_aggregator.launch.py"


@pytest.fixture
def launch_file(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    return launching.run(LAUNCH_FILE, monkeypatch)


def test_each_robot_gets_a_real_aggregator_and_one_is_shown(launch_file: SimpleNamespace) -> None:
    fleet, *aggregators, monitor = launch_file.robots(
        {"robots": "2", "kind": "kobuki", "monitor": "robot_2"}
    )
    assert fleet.options["cmd"] == [
        "virtual-robots", "--robots", "2", "--kind", "kobuki", "--aggregator", "none",
    ]  # fmt: skip
    assert [a.options["namespace"] for a in aggregators] == ["robot_1", "robot_2"]
    assert monitor.options["package"] == "rqt_robot_monitor"
    assert ("/diagnostics_agg", "/robot_2/diagnostics_agg") in monitor.options["remappings"]


def test_the_aggregators_parameters_apply_in_a_namespace(launch_file: SimpleNamespace) -> None:
    """A file headed `analyzers:` is overlooked by a node that has a namespace."""
    _, aggregator, _ = launch_file.robots({"robots": "1", "kind": "thesis", "monitor": "robot_1"})
    path = Path(aggregator.options["parameters"][0])
    assert path.read_text().splitlines()[0] == "/**:"
    assert Aggregator(load_parameters(path), 0.0).warnings == ()


def test_the_launch_arguments_have_defaults(launch_file: SimpleNamespace) -> None:
    *arguments, _ = launch_file.generate_launch_description().arguments[0]
    defaults = {a.arguments[0]: a.options["default_value"] for a in arguments}
    assert defaults == {"robots": "3", "kind": "thesis", "monitor": "robot_1"}
