"""The command `virtual-robots`: flags, wiring, signals, exit codes.

The only file that knows all others. Exit codes: 0 done or interrupted, 1 something failed,
2 wrong usage or a file that cannot be used.
"""

from __future__ import annotations

import argparse
import signal
import sys
import threading
from collections.abc import Callable, Sequence
from types import FrameType

from virtual_robots import ros
from virtual_robots.aggregator import VERSIONS, AnalyzerConfigError
from virtual_robots.documents import DocumentError
from virtual_robots.fleet import Fleet, RobotSpec
from virtual_robots.kinds import kind_path, known_kinds
from virtual_robots.player import Player

COMMANDS = """commands:
  virtual-robots [run] [options]   publish a fleet of virtual robots until interrupted
  virtual-robots fault ROBOT COMPONENT LEVEL
                                   break or repair a component while they run
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit code."""
    words = list(sys.argv[1:] if argv is None else argv)
    name = words.pop(0) if words and words[0] in PARSERS else "run"
    parser = PARSERS[name]()
    options = parser.parse_args(words)
    try:
        options.command(options)
    except (DocumentError, AnalyzerConfigError, ros.DomainError) as error:
        print(error, file=sys.stderr)  # noqa: T201 - a command's answer
        return 2
    except ros.RosError as error:
        print(f"virtual-robots: {error}", file=sys.stderr)  # noqa: T201 - a command's answer
        return 1
    return 0


def _run_parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        "virtual-robots",
        epilog=COMMANDS,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description="Virtual robots that publish real ROS 2 diagnostics.",
    )
    parser.add_argument("--robots", type=_count, default=10, help="how many (default 10)")
    parser.add_argument(
        "--kind",
        default="thesis",
        help=f"{', '.join(known_kinds())}, or the path of a kind file (default thesis)",
    )
    parser.add_argument("--seed", type=int, default=0, help="decides all that is random")
    parser.add_argument(
        "--aggregator",
        choices=[*VERSIONS, "none"],
        default=VERSIONS[0],
        help=f"which diagnostic_aggregator each robot runs (default {VERSIONS[0]})",
    )
    _add_domain(parser)
    parser.set_defaults(command=run)
    return parser


def _fault_parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        "virtual-robots fault",
        description="Break or repair a component of a running virtual robot."
        " The same as: ros2 param set /virtual_robots 'ROBOT.COMPONENT' 'LEVEL: MESSAGE'",
    )
    parser.add_argument("robot", help="such as robot_3")
    parser.add_argument("component", help="such as 'Motor 2'")
    parser.add_argument(
        "level", help="ok, warn, error, stale, silent, flap, or a fault of the robot's kind"
    )
    parser.add_argument("--message", default="", help="the status message; default: the kind's")
    _add_domain(parser)
    parser.set_defaults(command=fault)
    return parser


PARSERS: dict[str, Callable[[], argparse.ArgumentParser]] = {
    "run": _run_parser,
    "fault": _fault_parser,
}


def _add_domain(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--domain-id", type=int, default=None, help="DDS domain (default: ROS_DOMAIN_ID, else 0)"
    )


def _count(text: str) -> int:
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError("must be at least 1")
    return number


def run(options: argparse.Namespace) -> None:
    """Publish a fleet until SIGINT or SIGTERM."""
    version = None if options.aggregator == "none" else options.aggregator
    kind = kind_path(options.kind)
    specs = [RobotSpec(f"robot_{n}", kind) for n in range(1, options.robots + 1)]
    fleet = Fleet(specs, options.seed, version)
    domain_id = ros.chosen_domain_id(options.domain_id)
    stop = stop_on_signals()
    with ros.ros_context(domain_id) as context:
        publishers = ros.Publishers(context, [spec.name for spec in specs])
        player = Player(fleet, publishers.publish)
        control = ros.Control(context, player.inject)
        say(f"ready: {len(specs)} virtual robots in domain {domain_id}")
        player.play(stop)
        control.close()
        publishers.close()


def fault(options: argparse.Namespace) -> None:
    """Set the parameter that stands for a component."""
    order = f"{options.level}: {options.message}" if options.message else options.level
    domain_id = ros.chosen_domain_id(options.domain_id)
    ros.set_parameter(domain_id, f"{options.robot}.{options.component}", order)


def stop_on_signals() -> threading.Event:
    """An event that SIGINT and SIGTERM set."""
    stop = threading.Event()

    def on_signal(_number: int, _frame: FrameType | None) -> None:
        stop.set()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, on_signal)
    return stop


def say(text: str) -> None:
    """A line on stdout, at once: others wait for it."""
    print(text, flush=True)  # noqa: T201 - a command's answer


if __name__ == "__main__":
    sys.exit(main())
