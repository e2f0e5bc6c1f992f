"""The tables of what `experiments.silent` measured, and docs/reference/silent-faults.md."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from experiments.results import Results, table

CHECKOUT = Path(__file__).resolve().parents[2]
PAGE = CHECKOUT / "docs" / "reference" / "silent-faults.md"
_HEAD = """# Silent faults across bad networks

Seconds until the [fault](../silent-faults.md) is confirmed (`confirm_after` is 10 s), and the mails
of its PROBLEM and RECOVERY. Each network then passed an hour without a fault. The columns are what
`./run experiment silent` did to the frames between the robots' host and the exporter's
([all rows](../experiments/silent.md)). `./run generate` writes this page.

"""
NAME = "silent"
Row = dict[str, str]


def render(made: Results) -> str:
    """silent.md: a table of each case."""
    rows = made.rows()
    return made.write_markdown(
        *([f"{_case(key)}:", "", *_of_case(_with(rows, key))] for key in _cases(rows))
    )


def files() -> dict[Path, str]:
    """docs/reference/silent-faults.md, of what docs/experiments has."""
    rows = Results(CHECKOUT / "docs" / "experiments", NAME).rows()
    return {PAGE: _HEAD + "\n".join(summary(rows)) + "\n"}


def summary(rows: Sequence[Row]) -> list[str]:
    """One table of all cases: a row for each injection, with the seconds of each case."""
    cases = _cases(rows)
    injections = dict.fromkeys((each["injected"], each["expected"]) for each in rows)
    by_key = {(each["injected"], _key(each)): each for each in rows}
    lines = [
        "| a node, or its process | seen as | " + " | ".join(map(_case, cases)) + " |",
        "|---|---|" + "---|" * len(cases),
    ]
    for what, component in injections:
        seen = f"`{component}`" if component else "nothing"
        cells = (_seconds(by_key[what, key]) for key in cases)
        lines.append(f"| {what} | {seen} | " + " | ".join(cells) + " |")
    wrong = (str(sum(map(_wrong, _with(rows, key)))) for key in cases)
    lines.append("| faults that nobody injected | | " + " | ".join(wrong) + " |")
    return lines


def _seconds(row: Row) -> str:
    if not row["expected"]:
        return "-"
    mails = f", {row['problems']} + {row['recoveries']} mails"
    return f"{float(row['after']):.0f} s{mails}" if row["seen"] else "not seen"


def _wrong(row: Row) -> int:
    return len(row["wrong"].split(", ")) if row["wrong"] else 0


def _key(row: Row) -> tuple[str, str]:
    return row["loss"], row["delay"]


def _cases(rows: Sequence[Row]) -> list[tuple[str, str]]:
    return list(dict.fromkeys(map(_key, rows)))


def _with(rows: Sequence[Row], key: tuple[str, str]) -> list[Row]:
    return [each for each in rows if _key(each) == key]


def _case(key: tuple[str, str]) -> str:
    loss, delay = map(float, key)
    return f"{100 * loss:g} % lost" + (f", {1000 * delay:g} ms late" if delay else "")


def _of_case(rows: Sequence[Row]) -> list[str]:
    return table(
        rows,
        (
            ("injected", lambda row: row["injected"]),
            ("seen", lambda row: f"`{row['seen']}`" if row["seen"] else "nothing"),
            ("after, s", lambda row: row["after"]),
            ("mails", lambda row: f"{row['problems']} + {row['recoveries']}"),
            ("wrong", lambda row: row["wrong"] or "none"),
        ),
    )
