"""What the commands print: on a terminal, or into a pipe; as tables, or as JSON."""

from __future__ import annotations

import getpass
import json
import sys
from collections.abc import Callable, Container, Iterable
from typing import Any

import click
from rich.console import Console
from rich.table import Column, Table
from rich.text import Text

from ros_diagnostics_exporter.severity import COLOURS
from ros_diagnostics_exporter.texts import one_line


def make_console() -> Console:
    """In a pipe nothing is cut off; in a terminal the columns of a table share its width."""
    return Console(width=None if sys.stdout.isatty() else 200)


def make_table(*titles: str, right: Container[str] = ()) -> Table:
    """A table that wraps long texts instead of cutting them off; some columns are at the right."""
    columns = (
        Column(title, overflow="fold", justify="right" if title in right else "left")
        for title in titles
    )
    return Table(*columns, box=None, pad_edge=False)


def plain(*lines: str) -> Text:
    """What robots publish, each in one line, without markup and terminal control characters."""
    return Text("\n".join(map(one_line, lines)))


def chip(state: str, words: str = "") -> Text:
    """A state in its colour, in other words where there are some."""
    colour, text = COLOURS[state]
    return Text(f" {words or state} ", style=f"bold {text} on {colour}")


def cells(texts: Iterable[str | None]) -> tuple[Text, ...]:
    """A row of a table, each text in one line."""
    return tuple(plain(text or "") for text in texts)


def with_output(*more: str) -> Callable[..., Any]:
    """Add --output, as ``output``; ``more`` are forms beside table and json."""
    return click.option(
        "--output",
        type=click.Choice(("table", "json", *more)),
        default="table",
        help="For people, or for other programs.",
    )


def print_json(content: Any) -> None:
    """Print JSON; control characters of robots' texts are escaped in it."""
    print(json.dumps(content, indent=2))  # noqa: T201


def with_author(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add --author; the function gets it as ``author``."""
    return click.option(
        "--author",
        default=current_user,
        show_default="the current user",
        help="Your name, for those who see it.",
    )(function)


def current_user() -> str:
    """The user's name; "" for a UID without an entry in passwd, as in many containers."""
    try:
        return getpass.getuser()
    except (KeyError, OSError):  # OSError since Python 3.13
        return ""


def check_comment(author: str, comment: str | None, purpose: str) -> str:
    """The comment of what others will see; a usage error without one, or without an author."""
    if not (comment or "").strip():
        raise click.UsageError(f"say with --comment {purpose}")
    if not author:
        raise click.UsageError("give your name with --author: this user has no entry in passwd")
    return comment or ""
