"""The command `python -m demo` behind `./run demo`: options, signals, exit codes.

Exit codes: 0 exactly the expected emails arrived within --seconds, or the user stopped a demo
without --seconds; 1 an error; 2 wrong usage; 130 interrupted before --seconds were over.
"""

from __future__ import annotations

import argparse
import signal
import sys
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from types import FrameType

from rich.console import Console

from demo.liveness import ProgramEndedError
from demo.run import DemoRun
from demo.screen import Screen
from demo.steps import LASER, MOTOR, Fault, announcement
from testbed import grafana
from testbed.programs import MissingProgram
from testbed.site import Site
from testbed.stack import Plan, running

ROBOTS = Path(__file__).parent / "robots.yaml"
WHOLE = Plan(14, scenario=ROBOTS)
ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the demo; returns the exit code."""
    options = _parser().parse_args(argv)
    seconds: float | None = options.seconds
    console = Console(width=None if sys.stdout.isatty() else 100)
    for number in ENDING:
        if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN:  # nohup's is kept
            signal.signal(number, _interrupt)
    try:
        errors = _demo(seconds, *_plan(options), console)
    except KeyboardInterrupt:
        console.print("stopped")
        return 0 if seconds is None else 130
    except (MissingProgram, ProgramEndedError, RuntimeError, LookupError, OSError) as error:
        errors = [str(error)]
    for line in errors:
        print(f"demo: {line}", file=sys.stderr)
    return 1 if errors else 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        "./run demo",
        description="Virtual robots, exporter,"
        " Prometheus, Alertmanager and mail on this machine; a motor and a laser fail and are"
        " repaired.",
    )
    parser.add_argument(
        "--seconds",
        type=_positive,
        help="stop this many seconds after all servers are ready; exit 0 only if exactly the"
        " expected emails arrived (about 90 seconds; default: run until Ctrl-C)",
    )
    parser.add_argument(
        "--scenario",
        type=_file,
        metavar="FILE",
        help="run this scenario of virtual robots (docs/virtual-robots.md) instead of these"
        " faults; emails are then not checked. The robots keep running after its duration",
    )
    parser.add_argument(
        "--zenoh",
        action="store_true",
        help="the robots are received through zenoh's bridge and router (docs/beyond-the-lan.md),"
        " which are built first; that needs cargo",
    )
    return parser


def _file(text: str) -> Path:
    path = Path(text)
    if not path.is_file():
        raise argparse.ArgumentTypeError(f"there is no file {text}")
    return path.resolve()


def _positive(text: str) -> float:
    with suppress(ValueError):
        if 0 < (number := float(text)) < float("inf"):
            return number
    raise argparse.ArgumentTypeError(f"{text!r} must be a number above 0")


def _interrupt(_number: int, _frame: FrameType | None) -> None:
    """Stop in order; a second signal must not interrupt the cleanup."""
    for number in ENDING:
        signal.signal(number, signal.SIG_IGN)
    raise KeyboardInterrupt


def _plan(options: argparse.Namespace) -> tuple[Plan, tuple[Fault, ...]]:
    """What to start, and what breaks then; nothing breaks in a scenario of the user's."""
    if options.scenario is not None:
        return Plan(1, scenario=options.scenario, zenoh=options.zenoh), ()
    if options.zenoh:  # its bridge brings neither other topics nor goals
        return Plan(zenoh=True), (MOTOR,)
    return WHOLE, (MOTOR, LASER)


def _demo(
    seconds: float | None, plan: Plan, faults: Sequence[Fault], console: Console
) -> list[str]:
    """Start everything, run the demo, stop everything; return the errors."""
    robots = f"{plan.robots} virtual robots" if faults else f"the robots of {plan.scenario}"
    links = "a zenoh bridge and router, " if plan.zenoh else ""
    console.print(f"starting {robots}, {links}the exporter, Prometheus and Alertmanager ...")
    with (
        tempfile.TemporaryDirectory(prefix="fleet-demo-") as folder,
        running(Path(folder), plan) as stack,
        Screen(console) as screen,
    ):
        for line in _addresses(stack):
            console.print(line, highlight=False, soft_wrap=True)
        if faults:
            console.print(announcement(faults), highlight=False, soft_wrap=True)
        screen.open("Ctrl-C stops the demo")
        return DemoRun(stack, screen, faults).run(seconds)


def _addresses(stack: Site) -> list[str]:
    where = stack.addresses
    return [
        f"  robots        ROS domain {stack.domain_id} (ROS_DOMAIN_ID={stack.domain_id})",
        f"  exporter      http://{where.exporter}/",
        f"  Prometheus    http://{where.prometheus}/alerts",
        f"  Alertmanager  http://{where.alertmanager}/",
        f"  Grafana       http://{where.grafana}/" if stack.grafana else f"  {grafana.ABSENT}",
        f"  mail          smtp://{where.smtp}",
    ]


if __name__ == "__main__":
    sys.exit(main())
