"""The command `python -m demo` behind `./run demo`: options, signals, exit codes.

Exit codes: 0 when exactly the expected emails arrived within --seconds, or when the reader ended
the demo; 1 when something went wrong; 2 wrong usage; 130 interrupted before --seconds were over.
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

from demo.liveness import GoneForGoodError
from demo.performance import Performance
from demo.screen import Screen
from testbed import grafana
from testbed.mail import Inbox
from testbed.programs import MissingProgram
from testbed.stack import Plan, Stack, running

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
        wrong = _demo(seconds, options.scenario, console)
    except KeyboardInterrupt:
        console.print("ended")
        return 0 if seconds is None else 130
    except (MissingProgram, GoneForGoodError, RuntimeError, LookupError, OSError) as error:
        wrong = [str(error)]
    for sentence in wrong:
        print(f"demo: {sentence}", file=sys.stderr)
    return 1 if wrong else 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("./run demo", description="The whole road on this machine.")
    parser.add_argument(
        "--seconds",
        type=_positive,
        help="end by itself after so many seconds, counted from when all servers are ready;"
        " exit 0 only if exactly the expected emails arrived (the story takes about 70)",
    )
    parser.add_argument(
        "--scenario",
        type=_file,
        metavar="FILE",
        help="play this scenario of virtual robots (docs/virtual-robots.md) instead of the story of"
        " the motor; then no email is expected, and none is wrong. When its duration is over the"
        " robots go on as it left them",
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
    """End in order; a second signal must not disturb the first one's tidying up."""
    for number in ENDING:
        signal.signal(number, signal.SIG_IGN)
    raise KeyboardInterrupt


def _demo(seconds: float | None, scenario: Path | None, console: Console) -> list[str]:
    """Start everything, play, end everything; return what went wrong."""
    plan = Plan(scenario=scenario)
    robots = f"{plan.robots} virtual robots" if scenario is None else f"the robots of {scenario}"
    console.print(f"starting {robots}, the exporter, Prometheus and Alertmanager ...")
    with (
        tempfile.TemporaryDirectory(prefix="fleet-demo-") as folder,
        running(Path(folder), plan, Inbox()) as stack,
        Screen(console) as screen,
    ):
        for line in _addresses(stack):
            console.print(line, highlight=False, soft_wrap=True)
        screen.open("Ctrl-C ends the demo")
        return Performance(stack, screen, with_story=scenario is None).play(seconds)


def _addresses(stack: Stack) -> list[str]:
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
