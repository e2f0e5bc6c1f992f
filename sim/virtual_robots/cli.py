"""The command `virtual-robots`: options, errors, exit codes.

0: done, or ended by SIGINT or SIGTERM. 1: failed. 2: wrong usage, or an invalid file.
"""

from __future__ import annotations

import argparse
import importlib
import re
import shlex
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

from virtual_robots.aggregator import VERSIONS, AnalyzerConfigError
from virtual_robots.schema.documents import DocumentError
from virtual_robots.simulation.kinds import known_kinds
from virtual_robots.terminal import print_error

COMMANDS = """commands:
  virtual-robots [run] [options]   publish the diagnostics of a fleet until interrupted
  virtual-robots fault ROBOT [COMPONENT] LEVEL
                                   inject or clear a fault while the robots run
  virtual-robots replay FILE...    publish recorded diagnostics (rosbag2, JSON)
  virtual-robots record OUTPUT     record the diagnostics of a domain into a bag (rosbag2)
  virtual-robots COMMAND --help    options of a command
"""
EXTRAS = {
    "ros": (
        "ros-jazzy-common-interfaces>=5.3,<6",
        "ros-jazzy-rclpy[fastrtps]>=7.1.5,<7.2",
        "ros-jazzy-test-msgs>=2.0,<3",
    )
}
NO_ROS = """virtual-robots: ROS 2 cannot be imported ({error}).
Install it beside this package: {command}
or source a ROS 2 installation first: source /opt/ros/jazzy/setup.bash"""
ROS_PACKAGES = ("rclpy", "diagnostic_msgs.msg", "rcl_interfaces.srv")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit code."""
    words = list(sys.argv[1:] if argv is None else argv)
    command = words.pop(0) if words and words[0] in PARSERS else "run"
    options = PARSERS[command]().parse_args(words)
    recordings = command in {"replay", "record"}
    if missing := _missing_ros():
        return _fail(missing, 1)
    # Imported here, so that without ROS the errors above appear and --help works.
    module = "recording_commands" if recordings else "commands"
    commands = importlib.import_module(f"virtual_robots.{module}")
    ros = importlib.import_module("virtual_robots.ros.contexts")
    try:
        getattr(commands, command)(options)
    except (DocumentError, AnalyzerConfigError, ros.DomainError) as error:
        return _fail(str(error), 2)
    except ros.RosError as error:
        return _fail(f"virtual-robots: {error}", 1)
    return 0


def _missing_ros() -> str:
    """Return an error about the first package of ROS that cannot be imported; empty if all can."""
    try:
        for package in ROS_PACKAGES:
            importlib.import_module(package)
    except ImportError as error:
        command = shlex.join([sys.executable, "-m", "pip", "install", *EXTRAS["ros"]])
        return NO_ROS.format(error=error, command=command)
    return ""


def _fail(text: str, code: int) -> int:
    print_error(text)
    return code


def _run_parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        "virtual-robots",
        epilog=COMMANDS,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description="Virtual robots that publish real ROS 2 diagnostics.",
    )
    add_fleet(parser)
    parser.add_argument(
        "--participants",
        choices=["fleet", "robot", "domain"],
        default="fleet",
        help="DDS participants: one for the fleet (default), one per robot, or one domain per"
        " robot, numbered from --domain-id",
    )
    add_domain(parser)
    return parser


def _fault_parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        "virtual-robots fault",
        description="Inject or clear a fault of a running virtual robot, or trigger an event of the"
        " whole robot."
        " The same as: ros2 param set /virtual_robots 'ROBOT.COMPONENT' 'LEVEL: MESSAGE'",
    )
    parser.add_argument("robot", help="such as robot_3")
    parser.add_argument("component", nargs="?", help="such as 'Motor 2'; omitted: the whole robot")
    parser.add_argument(
        "level",
        help="ok, warn, error, stale, silent, flap, or a fault of the robot's kind;"
        " of a whole robot: hang, resume, crash, leave, join, 'clock_jump: 30', ...",
    )
    parser.add_argument(
        "--message", default="", help="the status message (default: the kind's own)"
    )
    add_domain(parser)
    return parser


def _replay_parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        "virtual-robots replay", description="Publish recorded diagnostics on their topics."
    )
    parser.add_argument(
        "files", nargs="+", type=Path, metavar="FILE", help="a bag's folder, .db3, .mcap or .json"
    )
    parser.add_argument("--rate", type=_positive, default=1.0, help="playback speed (default 1)")
    parser.add_argument("--loop", action="store_true", help="repeat until interrupted")
    parser.add_argument(
        "--namespace", type=_namespace, help="prefix of each topic, such as robot_1"
    )
    parser.add_argument(
        "--wait",
        type=_positive,
        default=5.0,
        help="seconds to wait for a subscriber of each topic (default 5)",
    )
    add_domain(parser)
    return parser


def _record_parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        "virtual-robots record", description="Write the diagnostics of a domain into a new bag."
    )
    parser.add_argument("output", type=Path, help="the bag's folder; must not exist")
    parser.add_argument(
        "--storage", choices=["sqlite3", "mcap"], default="mcap", help="(default mcap)"
    )
    parser.add_argument(
        "--topic",
        action="append",
        help="a pattern such as '/robot_1/*' (default: all; repeatable)",
    )
    parser.add_argument("--duration", type=_positive, help="seconds until it ends (default: never)")
    add_domain(parser)
    return parser


PARSERS: dict[str, Callable[[], argparse.ArgumentParser]] = {
    "run": _run_parser,
    "fault": _fault_parser,
    "replay": _replay_parser,
    "record": _record_parser,
}


def add_fleet(parser: argparse.ArgumentParser) -> None:
    """The options that describe a fleet."""
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--robots", type=_count, default=10, help="number of robots (default 10)")
    which.add_argument("--scenario", type=Path, help="a scenario file: robots and events")
    parser.add_argument(
        "--kind",
        help=f"{', '.join(known_kinds())}, or the path of a kind file (default thesis)",
    )
    parser.add_argument("--settings", type=Path, help="a settings file of the thesis robot")
    parser.add_argument("--seed", type=int, help="seed of all random numbers (default 0)")
    parser.add_argument(
        "--aggregator",
        choices=[*VERSIONS, "none"],
        default=VERSIONS[0],
        help=f"version of each robot's diagnostic_aggregator (default {VERSIONS[0]})",
    )
    parser.add_argument("--duration", type=_positive, help="seconds until it ends (default: never)")


def add_domain(parser: argparse.ArgumentParser) -> None:
    """The option for the DDS domain."""
    parser.add_argument(
        "--domain-id", type=int, help="DDS domain, 0 to 232 (default: ROS_DOMAIN_ID, else 0)"
    )


def _count(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} must be a whole number of at least 1")
    return int(text)


def _namespace(text: str) -> str:
    if not re.fullmatch(r"/?[A-Za-z]\w*(/[A-Za-z]\w*)*", text, re.ASCII):
        raise argparse.ArgumentTypeError("must be a ROS namespace, such as robot_1")
    return text.strip("/")


def _positive(text: str) -> float:
    with suppress(ValueError):
        if 0 < (number := float(text)) < float("inf"):
            return number
    raise argparse.ArgumentTypeError(f"{text!r} must be a number above 0")


if __name__ == "__main__":
    sys.exit(main())
