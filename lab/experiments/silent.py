"""Silent faults of real nodes across a network that loses and delays: which are notified, when.

Eight robots with two nodes each, on a host of their own; the exporter, Prometheus with the shipped
rules, Alertmanager and a mail server on another. To each robot something else is done, all at once:
its node is killed, stopped, hung, started twice, renamed, started with another QoS, started again.
After it all is mended, and for some minutes nothing may be a fault. What is learned in a day is
learned in ten seconds. Each case has another share of lost packets, both ways, and another delay.
`./run soak --loss 5` is one case for a night.

"after" are seconds until the fault is confirmed; "mails" of a PROBLEM and a RECOVERY that one
receiver got; "wrong" the faults that nobody injected.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from collections.abc import Iterable
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import NamedTuple

from experiments import results
from experiments.results import Results, Row
from experiments.silent_report import NAME, render
from support import subnets
from testbed.configuration import CHECKOUT
from testbed.polling import until

HOSTS = ("robot", "office")
PYTHONPATH = ":".join(str(CHECKOUT / each) for each in ("lab", "tests"))  # as ./run sets it
LONGEST = 1200.0  # seconds of a case, without its quiet time


class Case(NamedTuple):
    """The share of frames that are lost, and by how many seconds the others are late."""

    loss: float
    delay: float


CASES = (Case(0.0, 0.0), Case(0.05, 0.0), Case(0.2, 0.0), Case(0.05, 0.2))


def measure(case: Case, quiet: float) -> Iterable[Row]:
    """The rows of one case."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="silent-")))
        hosts = subnets.Subnets(stack, folder, HOSTS, subnets.RELAYED)
        hosts.disturb(*case)
        argv: list[str | Path] = [
            sys.executable,
            "-m",
            "experiments.silent_site",
            folder,
            "on",
            str(quiet),
        ]
        site = hosts.start("office", argv, {**os.environ, "PYTHONPATH": PYTHONPATH})
        until(lambda: not site.alive, site.describe, LONGEST + quiet, 1.0)
        if site.exit_code:
            raise RuntimeError(site.describe(40))
        for row in json.loads((folder / "rows.json").read_text()):
            yield {"loss": case.loss, "delay": case.delay, **row}


def main() -> None:
    """Measure all cases, or one."""
    parser = results.parser(NAME, str(__doc__))
    parser.add_argument(
        "--quiet", type=float, default=5.0, help="minutes of each case in which nothing happens"
    )
    parser.add_argument("--hours", type=float, help="the same in hours")
    parser.add_argument("--loss", type=_percent, help="only this case, in percent")
    parser.add_argument("--delay", type=float, default=0.0, help="of this case, in milliseconds")
    options = parser.parse_args()
    if why := subnets.missing():
        sys.exit(why)
    cases = CASES if options.loss is None else (Case(options.loss, options.delay / 1000),)
    quiet = 60 * options.quiet if options.hours is None else 3600 * options.hours
    made = Results(options.out, NAME)
    results.run(made, options, cases, partial(measure, quiet=quiet), render)


def _percent(text: str) -> float:
    share = float(text) / 100
    if not 0 <= share < 1:
        raise argparse.ArgumentTypeError(f"{text} is no share in percent")
    return share


if __name__ == "__main__":
    main()
