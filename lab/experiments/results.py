"""A result on disk: NAME.csv, a row for each measured case, and NAME.json, the machine.

A row is on disk as soon as it is measured, so an interrupted run keeps what it has; with --append a
later run adds to an earlier one. Tables (NAME.md) and plots (NAME.png) are made from these files.
"""

from __future__ import annotations

import argparse
import csv
import json
import signal
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TypeVar

from experiments import machine

DEFAULT_FOLDER = Path("build/experiments")
Row = Mapping[str, "float | int | str"]
Case = TypeVar("Case")


class Results:
    """The rows of one experiment; each also has the commit and the time that it is from."""

    def __init__(self, folder: Path, name: str) -> None:
        self.folder = folder
        self.name = name

    def path(self, suffix: str) -> Path:
        """Return the path of one of its files."""
        return self.folder / f"{self.name}{suffix}"

    def begin(self, *, append: bool, settings: Row) -> None:
        """Write what it is measured on; without ``append`` rows of earlier runs are deleted."""
        self.folder.mkdir(parents=True, exist_ok=True)
        if not append:
            self.path(".csv").unlink(missing_ok=True)
        about = machine.describe() | {name: str(value) for name, value in settings.items()}
        del about["commit"], about["date"]  # in each row
        self.path(".json").write_text(json.dumps(about, indent=2) + "\n")

    def add(self, row: Row) -> None:
        """Append a row; columns that it is the first to have are added."""
        date = time.strftime("%Y-%m-%d %H:%M", time.gmtime())
        rows: list[Row] = [*self.rows(), {**row, "commit": machine.commit(), "date": date}]
        columns = list(dict.fromkeys(name for each in rows for name in each))
        with self.path(".csv").open("w", newline="") as file:
            writer = csv.DictWriter(file, columns)
            writer.writeheader()
            writer.writerows(rows)

    def rows(self) -> list[dict[str, str]]:
        """Return all rows as they are in the file; none if there is no file."""
        if not self.path(".csv").exists():
            return []
        with self.path(".csv").open(newline="") as file:
            return list(csv.DictReader(file))

    def write_markdown(self, *tables: Iterable[str]) -> str:
        """Write NAME.md: the tables, then what they were measured on; return its text."""
        rows = self.rows()
        about = json.loads(self.path(".json").read_text())
        commits = ", ".join(dict.fromkeys(row["commit"] for row in rows))
        dates = sorted(row["date"] for row in rows)
        about |= {"commit": commits, "measured": f"{dates[0]} to {dates[-1]} UTC"}
        lines = [line for table in tables for line in (*table, "")]
        lines.append("Measured on: " + "; ".join(f"{name} {about[name]}" for name in about) + ".")
        text = "\n".join(lines) + "\n"
        self.path(".md").write_text(text)
        return text


def numbers(rows: Sequence[Mapping[str, str]], column: str) -> list[float]:
    """Return a column as numbers; NaN where a row has none."""
    return [float(row.get(column) or "nan") for row in rows]


def table(
    rows: Sequence[Mapping[str, str]],
    columns: Sequence[tuple[str, Callable[[Mapping[str, str]], str]]],
) -> list[str]:
    """Return the lines of a Markdown table; each column is its title and what it says of a row."""
    return [
        "| " + " | ".join(title for title, _ in columns) + " |",
        "|" + "---|" * len(columns),
        *("| " + " | ".join(say(row) for _, say in columns) + " |" for row in rows),
    ]


def parser(name: str, description: str) -> argparse.ArgumentParser:
    """Return a parser with the options that every experiment has."""
    made = argparse.ArgumentParser(
        f"./run experiment {name}",
        description=description,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    made.add_argument("--out", type=Path, default=DEFAULT_FOLDER, help="folder of the result")
    made.add_argument("--append", action="store_true", help="add to the rows of an earlier run")
    made.add_argument(
        "--report", action="store_true", help="measure nothing: tables and plots anew"
    )
    made.add_argument("--seed", type=int, default=1)
    return made


def run(
    results: Results,
    options: argparse.Namespace,
    cases: Sequence[Case],
    measure: Callable[[Case], Iterable[Row]],
    render: Callable[[Results], str],
) -> None:
    """Measure case after case unless only a report is wanted; then write and print the report.

    Ctrl-C (or SIGTERM) ends the measuring; the report then has the cases that are complete. A case
    that fails is named at the end, and the exit code is 1.
    """
    failed: list[str] = []
    if not options.report:
        for number in (signal.SIGINT, signal.SIGTERM):  # SIGINT is ignored in a background job
            signal.signal(number, signal.default_int_handler)
        results.begin(append=options.append, settings={"seed": options.seed})
        try:
            failed = list(_measure(results, cases, measure))
        except KeyboardInterrupt:
            print("interrupted; what was measured is kept", file=sys.stderr)
    if results.rows():
        print(render(results))
    else:
        failed.append(f"{results.path('.csv')}: nothing measured yet")
    if failed:
        sys.exit("\n".join(failed))


def _measure(
    results: Results, cases: Sequence[Case], measure: Callable[[Case], Iterable[Row]]
) -> Iterator[str]:
    """Measure all cases; yield the errors of those that fail."""
    began = time.monotonic()
    for number, case in enumerate(cases):
        spent = time.monotonic() - began
        left = (
            f", about {spent / number * (len(cases) - number) / 60:.0f} min left" if number else ""
        )
        print(f"{number + 1} of {len(cases)}{left}: {case}", flush=True)
        try:
            for row in measure(case):
                results.add(row)
                print(f"   {' '.join(f'{name}={x}' for name, x in row.items())}", flush=True)
        except (TimeoutError, RuntimeError) as error:
            print(f"   failed: {error}", file=sys.stderr, flush=True)
            yield f"{case} failed: {error}"
