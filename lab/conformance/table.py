"""``./run conformance``: runs all histories on both sides, writes histories.csv and results.md."""

from __future__ import annotations

import argparse
import csv
import io
import re
import sys
import tempfile
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

from conformance.compare import Outcome, run, shrunk
from conformance.histories import SEED, WRITTEN, drawn
from conformance.history import HOURS_CHANGE, Acknowledgement

PAGE = Path(__file__).parent / "results.md"
ROWS = Path(__file__).parent / "histories.csv"
BEGIN, END = "<!-- histories -->", "<!-- end of histories -->"
_BLOCK = re.compile(f"{BEGIN}.*{END}", re.DOTALL)


def rows(outcomes: Sequence[Outcome]) -> str:
    """histories.csv: each history, and what both sides notify of it."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("history", "results", "Nagios", "here", "why they differ"))
    for each in outcomes:
        nagios, ours = _list(each.nagios), _list(each.ours)
        writer.writerow((each.history.name, _results(each), nagios, ours, each.reason))
    return text.getvalue()


def summary(outcomes: Sequence[Outcome]) -> str:
    """The part of results.md that is written: the differences, by why they are."""
    different = defaultdict(list)
    for each in outcomes:
        if not each.same:
            different[each.reason].append(each.history.name)
    same = f"{sum(each.same for each in outcomes)} of {len(outcomes)} histories"
    lines = [
        f"{same} are notified the same; the others differ on purpose.",
        "",
        "| difference | in these histories |",
        "|---|---|",
        *(f"| {reason} | {'; '.join(names)} |" for reason, names in different.items()),
    ]
    return "\n".join((BEGIN, *lines, END))


def _results(outcome: Outcome) -> str:
    history = outcome.history
    tracks = [
        f"{key} {track}" for key, track in (*history.hosts.items(), *history.services.items())
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
    parser.add_argument("--write", action="store_true", help="write histories.csv and results.md")
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
        ROWS.write_text(rows(outcomes))
        PAGE.write_text(_BLOCK.sub(lambda _: summary(outcomes), PAGE.read_text()))
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
