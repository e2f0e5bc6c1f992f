"""Counts how easily the pages read, and lets none get worse: ``./run docs --check``.

The table of tests/data/readability.csv has what each page had at its best. Rates move a little with
each sentence, so a page is worse only where a count is more than one beyond the table and the goal.
"""

from __future__ import annotations

import argparse
import csv
import re
import statistics
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parents[1]
TABLE = CHECKOUT / "tests" / "data" / "readability.csv"
RUNBOOKS = "docs/alerts"  # one row for all
BESIDE = ("README.md", "SECURITY.md", "CONTRIBUTING.md")
NO_PAGES = {"CHANGELOG.md"}
MAIN = (
    "README.md",
    "docs/first-robot.md",
    "docs/how-it-decides.md",
    "docs/configuration.md",
    "docs/alerts.md",
    "docs/notifications.md",
    "docs/metrics.md",
    "docs/silent-faults.md",
    "docs/dashboards.md",
    "docs/queries.md",
    "docs/deployment.md",
    "docs/architecture.md",
)
# What well-known projects' pages have; the last two are ours. A negative number is the least.
GOALS = {
    "exceptions %": 8,
    "exceptions in conditions %": 2,
    "what, whoever": 1,
    "you": -8,
    "examples": -4,
    "unexplained words": 3,
    "blocks and pictures": -1,
}
Counts = Mapping[str, float]

_EXCEPTION = re.compile(
    r"\b(unless|except|but|apart|otherwise|else|without|only|however|although|though|besides?|alone)\b"
)
_CONDITION = re.compile(
    r"\b(if|when|where|while|once|until|as long as|as soon as|whether|before|after)\b"
)
_NO_NOUN = re.compile(r"\b(what|whatever|whoever)\b")
_YOU = re.compile(r"\b(you|your)\b")
_EXAMPLE = re.compile(r"\b(for example|for instance|example|such as|imagine|suppose)\b")
_HIDDEN = re.compile(r"\A---\n.*?\n---\n|<!--.*?-->", re.DOTALL)
_BLOCK = re.compile(r"^ *```.*?^ *```", re.DOTALL | re.MULTILINE)
_PICTURE = re.compile(r"!\[[^\]]*\]\([^)]*\)")
_HEADING = re.compile(r"^#.*$", re.MULTILINE)
_NO_PROSE = re.compile(r"^ *(\||#).*$", re.MULTILINE)
_ITEM = re.compile(r"\n\s*\n|\n *(?=[-*] |\d+\. )")
_BULLET = re.compile(r"^(> )?([-*]|\d+\.) ")
_END = re.compile(r"(?<=[.!?])[*_\")]*\s+")
_LINK = re.compile(r"\[([^\]]*)\]\([^)]*\)")
_CODE = re.compile(r"`[^`]+`")
_WORD = re.compile(r"\S*[A-Za-z0-9]\S*")


def project_words() -> list[str]:
    """The words that docs/glossary.md explains."""
    text = (CHECKOUT / "docs" / "glossary.md").read_text(encoding="utf-8")
    table = text.partition("|---|---|\n")[2].partition("\n\n")[0]
    return [word for row in table.splitlines() for word in row.split("|")[1].strip().split(", ")]


def paragraphs(text: str) -> list[str]:
    """The prose of a page with its links and code: no comments, blocks, tables and headings."""
    for hidden in (_HIDDEN, _BLOCK, _PICTURE, _NO_PROSE):
        text = hidden.sub("", text)
    parts = [_BULLET.sub("", " ".join(part.split())) for part in _ITEM.split(text)]
    return [part for part in parts if part]


def sentences(prose: list[str]) -> list[str]:
    """Each in lower case, a link as its text and code as one word."""
    plain = [_CODE.sub("code", _LINK.sub(r"\1", part)).lower() for part in prose]
    return [sentence for part in plain for sentence in _END.split(part) if _WORD.search(sentence)]


def unexplained(text: str, words: list[str]) -> list[str]:
    """The project's words that are neither linked nor explained where a page has them first."""
    for hidden in (_HIDDEN, _BLOCK, _HEADING):
        text = hidden.sub("", text)
    return [word for word in words if _is_unexplained(word, text)]


def _is_unexplained(word: str, text: str) -> bool:
    pattern = rf"(\[[^\]]*|\*\*?)?\b{re.escape(word)}s?\b([^\[\]]*\])?"
    first = re.search(pattern, text, re.IGNORECASE)
    if first is None or first[1] is not None:
        return False
    return not re.match(r"\W{0,3}\s*(is|are|means|:|\(|\|)", text[first.end() :])


def counts(text: str, words: list[str]) -> dict[str, int]:
    """What a page has of each of GOALS: percent of sentences, or in 1,000 words."""
    prose = paragraphs(text)
    said = sentences(prose)
    exceptions = [len(_EXCEPTION.findall(each)) for each in said]
    nested = [
        found > 0 and found + len(_CONDITION.findall(each)) > 1
        for found, each in zip(exceptions, said, strict=True)
    ]
    return {
        "exceptions %": _rate(sum(map(bool, exceptions)), len(said), 100),
        "exceptions in conditions %": _rate(sum(nested), len(said), 100),
        **{
            name: _rate(sum(len(pattern.findall(each)) for each in said), _words(said), 1000)
            for name, pattern in (
                ("what, whoever", _NO_NOUN),
                ("you", _YOU),
                ("examples", _EXAMPLE),
            )
        },
        "unexplained words": len(unexplained(text, words)),
        "blocks and pictures": len(_BLOCK.findall(text)) + len(_PICTURE.findall(text)),
    }


def _words(said: list[str]) -> int:
    return sum(len(_WORD.findall(each)) for each in said)


def _rate(part: int, whole: int, scale: int) -> int:
    return round(scale * part / max(whole, 1))


def pages() -> dict[str, str]:
    """The text of each page by its path; all runbooks are one."""
    files = [CHECKOUT / name for name in BESIDE]
    files += [
        each for each in sorted((CHECKOUT / "docs").glob("*.md")) if each.name not in NO_PAGES
    ]
    texts = {str(each.relative_to(CHECKOUT)): each.read_text(encoding="utf-8") for each in files}
    runbooks = sorted((CHECKOUT / RUNBOOKS).glob("*.md"))
    return {**texts, RUNBOOKS: "\n\n".join(each.read_text(encoding="utf-8") for each in runbooks)}


def measured() -> dict[str, Counts]:
    """The counts of every page."""
    words = project_words()
    return {page: counts(text, words) for page, text in pages().items()}


def table() -> dict[str, Counts]:
    """The counts that no page may be worse than."""
    with TABLE.open(encoding="utf-8", newline="") as file:
        return {
            row["page"]: {name: int(row[name]) for name in GOALS} for row in csv.DictReader(file)
        }


def worse(now: Mapping[str, Counts], limits: Mapping[str, Counts]) -> Iterator[str]:
    """A sentence for each count of a page that got worse; a page that is new has the goals."""
    for page, found in now.items():
        for name in found:
            goal = GOALS[name]
            limit = _limit(limits[page][name], goal) if page in limits else abs(goal)
            if (found[name] - limit) * (-1 if goal < 0 else 1) > 0:
                bound = "at least" if goal < 0 else "at most"
                yield f"{page}: {name}: {found[name]}, {bound} {limit}"


def _limit(best: float, goal: float) -> float:
    return max(best + 1, goal) if goal > 0 else min(best - 1, -goal)


def better(now: Mapping[str, Counts], limits: Mapping[str, Counts]) -> dict[str, Counts]:
    """The table with each count that is better now, and with the pages that are new."""
    return {
        page: {
            name: (min if goal > 0 else max)(found[name], limits.get(page, found)[name])
            for name, goal in GOALS.items()
        }
        for page, found in now.items()
    }


def write(limits: Mapping[str, Counts]) -> None:
    """Make these the table."""
    with TABLE.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, ["page", *GOALS], lineterminator="\n")
        writer.writeheader()
        writer.writerows({"page": page, **found} for page, found in sorted(limits.items()))


def medians(now: Mapping[str, Counts]) -> dict[str, float]:
    """Of the main pages."""
    return {name: statistics.median(now[page][name] for page in MAIN) for name in GOALS}


def _print(now: Mapping[str, Counts]) -> None:
    rows = [*now.items(), ("median of the main pages", medians(now)), ("goal", GOALS)]
    print(*GOALS, "page", sep=" | ")  # noqa: T201
    for page, found in rows:
        print(*(f"{abs(found[name]):{len(name)}g}" for name in GOALS), page, sep=" | ")  # noqa: T201


def main(argv: list[str] | None = None) -> int:
    """Print the counts; fail where a page got worse."""
    parser = argparse.ArgumentParser(prog="./run docs --check", description=__doc__)
    parser.add_argument(
        "--write", action="store_true", help="let the table have the counts that are better"
    )
    options = parser.parse_args(argv)
    now = measured()
    _print(now)
    got_worse = list(worse(now, table()))
    print(*got_worse, sep="\n", file=sys.stderr)  # noqa: T201
    if options.write:
        write(better(now, table()))
    return bool(got_worse)


if __name__ == "__main__":
    sys.exit(main())
