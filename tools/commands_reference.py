"""docs/reference/commands.md: the help of `ros-diagnostics` and of each of its subcommands."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import click

from ros_diagnostics_tools.main import PROGRAM, command

PAGE = Path(__file__).resolve().parents[1] / "docs" / "reference" / "commands.md"
WIDTH = 100
_HEAD = """# Help of ros-diagnostics

What `--help` prints. Where to begin: [the command ros-diagnostics](../commands.md).
`./run generate` writes this page.
"""


def files() -> dict[Path, str]:
    """The page."""
    return {PAGE: "\n".join([_HEAD, *_sections(command, _context(command, PROGRAM))])}


def _sections(shown: click.Command, context: click.Context) -> Iterator[str]:
    """The help of a command, and of those below it."""
    yield f"## {context.command_path}\n\n```text\n{shown.get_help(context)}\n```\n"
    if isinstance(shown, click.Group):
        for name in shown.list_commands(context):
            if below := shown.get_command(context, name):
                yield from _sections(below, _context(below, name, context))


def _context(shown: click.Command, name: str, parent: click.Context | None = None) -> click.Context:
    settings = {**shown.context_settings, "terminal_width": WIDTH, "max_content_width": WIDTH}
    return click.Context(shown, parent, name, **settings)
