"""Flags and subcommands of `ros-diagnostics` that the pages name exist."""

import re
from pathlib import Path

import click
import pytest

from ros_diagnostics_tools.main import command

CHECKOUT = Path(__file__).parents[3]
PAGES = sorted([*CHECKOUT.glob("*.md"), *(CHECKOUT / "docs").rglob("*.md")])
# Up to the end of the line or of the code; flags of what it is piped into are another's.
CALL = re.compile(r"(?<![/\w-])(?<!namespace )ros-diagnostics ((?:[a-z][a-z-]* ?)+)([^`|&\n]*)")


def calls() -> list[tuple[str, str, str]]:
    found = []
    for page in PAGES:
        text = page.read_text("utf-8")
        found += [(page.name, *match) for match in CALL.findall(text)]
    assert len(found) > 50
    return found


def resolved(words: list[str]) -> click.Command | None:
    """The subcommand that the words name; None where the first is none."""
    here: click.Command = command
    for word in words:
        if not isinstance(here, click.Group):
            break
        found = here.get_command(click.Context(here), word)
        if found is None:
            return None
        here = found
    return None if here is command else here


@pytest.mark.parametrize(("page", "words", "rest"), sorted(set(calls())))
def test_a_call_names_a_subcommand_and_flags_that_exist(page: str, words: str, rest: str):
    found = resolved(words.split())
    assert found is not None, words
    known = {name for option in found.params for name in option.opts}

    assert set(re.findall(r"(?<![\w-])--[a-z-]+", rest)) - known - {"--help"} == set()
