"""``./run conformance``: runs all histories on both sides, writes the table of results.md."""

from __future__ import annotations

import argparse
import re
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from conformance.compare import Outcome, run, shrunk
from conformance.histories import SEED, WRITTEN, drawn
from conformance.history import HOURS_CHANGE, Acknowledgement

PAGE = Path(__file__).parent / "results.md"
BEGIN, END = "<!-- histories -->", "<!-- end of histories -->"
_BLOCK = re.compile(f"{BEGIN}.*{END}", re.DOTALL)


def table(outcomes: Sequence[Outcome]) -> str:
    """The rows of results.md: each history, and whether both sides notify the same."""
    same = sum(each.same for each in outcomes)
    rows = [
        f"{same} of {len(outcomes)} histories are notified the same; the others differ on purpose.",
        "",
        "| history | results | notifications of Nagios | here |",
        "|---|---|---|---|",
    ]
    rows += map(_row, outcomes)
    return "\n".join((BEGIN, *rows, END))


def _row(outcome: Outcome) -> str:
    here = "the same" if outcome.same else f"{_list(outcome.ours)}: {outcome.reason}"
    return f"| {outcome.history.name} | {_results(outcome)} | {_list(outcome.nagios)} | {here} |"


def _results(outcome: Outcome) -> str:
    history = outcome.history
    tracks = [
        f"{key} `{track}`" for key, track in (*history.hosts.items(), *history.services.items())
    ]
    tracks += [f"downtime from {each.start} to {each.end}" for each in history.downtimes]
    tracks += [f"restart at {each}" for each in history.restarts]
    tracks += [f"fresh for {history.freshness}"] if history.freshness else []
    tracks += [f"all behind {each}" for each in sorted(set(history.parents.values()))]
    tracks += ["UNREACHABLE is notified"] if history.unreachable else []
    tracks += [f"notified again after {history.repeat}"] if history.repeat else []
    tracks += map(_acknowledged, history.acknowledgements)
    tracks += [
        f"{each.who} from the {each.first}. notification on"
        + (f" to the {each.last}." if each.last else "")
        for each in history.escalations
    ]
    if history.hours is not None:
        change = "from" if history.hours.begin else "until"
        tracks.append(f"hours of the {history.hours.of} {change} {HOURS_CHANGE}")
    return ", ".join(tracks) + f"; {history.attempts} attempts"


def _acknowledged(made: Acknowledgement) -> str:
    how = "sticky" if made.sticky else "not sticky"
    return f"acknowledged at {made.tick}, {how}" + (", notified" if made.notify else "")


def _list(notifications: Sequence[object]) -> str:
    return "; ".join(map(str, notifications)) or "none"


def main() -> int:
    """Print what differs without a reason; exit code 1 if anything does."""
    parser = argparse.ArgumentParser(prog="./run conformance", description=__doc__)
    parser.add_argument(
        "--seed", type=int, default=SEED, help="of the drawn histories (default: %(default)s)"
    )
    parser.add_argument("--write", action="store_true", help="write the table to results.md")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        outcomes = run(Path(folder) / "all", [*WRITTEN, *drawn(options.seed)])
        wrong = [each for each in outcomes if not each.same and not each.reason]
        for number, each in enumerate(wrong):
            print(each)
            if each.history.of_people:
                continue  # in real time: to make it small takes too long
            print(f"smallest: {shrunk(Path(folder) / f'shrink-{number}', each.history)}")
    same = sum(each.same for each in outcomes)
    print(
        f"{len(outcomes)} histories: {same} the same, "
        f"{len(outcomes) - same - len(wrong)} different on purpose, {len(wrong)} wrong"
    )
    if options.write:
        PAGE.write_text(_BLOCK.sub(lambda _: table(outcomes), PAGE.read_text()))
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
