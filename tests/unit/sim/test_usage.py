"""Wrong usage of the command: a sentence and an exit code, before anything is published."""

import sys

import pytest

from support.called import called
from virtual_robots.cli import main


def test_without_ros_a_sentence_says_how_to_get_it():
    code = (
        "import sys; sys.modules['rclpy'] = None\n"
        "from virtual_robots.cli import main; sys.exit(main(['--robots', '1']))"
    )
    done = called([sys.executable, "-c", code], code=1, timeout=60)
    assert "ROS 2 cannot be imported" in done.stderr
    assert f"{sys.executable} -m pip install " in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("words", "what"),
    [
        (["--robots", "0"], "must be a whole number of at least 1"),
        (["--robots", "2", "--scenario", "s.yaml"], "not allowed with"),
        (["--aggregator", "4.0.0"], "invalid choice: '4.0.0'"),
        (["--duration", "long"], "'long' must be a number above 0"),
        (["fault", "robot_1"], "the following arguments are required: level"),
        (["replay", "f.mcap", "--namespace", "my robot"], "must be a ROS namespace"),
        (["replay"], "the following arguments are required: FILE"),
    ],
)
def test_wrong_usage_is_an_error(words, what, capsys):
    with pytest.raises(SystemExit) as ended:
        main(words)
    assert ended.value.code == 2
    assert what in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "what"),
    [
        (["--domain-id", "233"], "domain id 233 must be between 0 and 232"),
        (["--kind", "tank"], "kind 'tank' is not known; it is one of amr, arm, create3, ko"),
        (["--kind", "kobuki", "--settings", "s.yaml"], "--settings is for --kind thesis only"),
        (["--kind", "thesis", "--scenario", "s.yaml"], "--kind and --settings go with --robots"),
        (["--scenario", "gone.yaml"], "gone.yaml: cannot be read: No such file"),
        (["replay", "gone.mcap"], "gone.mcap: cannot be read as a bag"),
        (["fault", "robot_1", "Motor 1", "ok", "--domain-id", "300"], "domain id 300 must be"),
    ],
)
def test_what_cannot_be_used_is_an_error(words, what, capsys, tmp_path, monkeypatch):
    pytest.importorskip("rclpy", reason="needs ROS 2")
    monkeypatch.chdir(tmp_path)
    assert main(words) == 2
    assert what in capsys.readouterr().err


def test_an_environment_with_a_domain_that_is_no_number_is_an_error(capsys, monkeypatch):
    pytest.importorskip("rclpy", reason="needs ROS 2")
    monkeypatch.setenv("ROS_DOMAIN_ID", "seven")
    assert main(["fault", "robot_1", "Motor 1", "ok"]) == 2
    assert "ROS_DOMAIN_ID is 'seven', must be a number" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("robots", "participants", "discovery", "warned"),
    [
        (60, "robot", "LOCALHOST", True),
        (60, "robot", "SUBNET", False),
        (60, "fleet", "LOCALHOST", False),
        (20, "robot", "LOCALHOST", False),
    ],
)
def test_robots_that_will_not_be_discovered_are_warned_of(robots, participants, discovery, warned):
    transport = pytest.importorskip("virtual_robots.ros.transport", reason="needs ROS 2")
    environment = {"ROS_AUTOMATIC_DISCOVERY_RANGE": discovery}
    sentence = transport.too_many_for_localhost(
        robots, transport.Participants(participants), environment
    )
    assert ("not all of 60 robots will be discovered" in sentence) == warned
