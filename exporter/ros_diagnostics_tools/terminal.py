"""What the commands print: on a terminal, or into a pipe."""

from __future__ import annotations

import sys
from collections.abc import Iterable

from rich.console import Console
from rich.text import Text

from ros_diagnostics_exporter.texts import one_line


def make_console() -> Console:
    """In a pipe nothing is cut off; in a terminal the columns of a table share its width."""
    return Console(width=None if sys.stdout.isatty() else 200)


def cells(texts: Iterable[str | None]) -> tuple[Text, ...]:
    """A row of a table, each text in one line; as Text: what robots publish is no markup."""
    return tuple(Text(one_line(text or "")) for text in texts)
