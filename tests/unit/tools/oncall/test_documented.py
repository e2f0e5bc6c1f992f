"""The shipped oncall.yml is right, and docs/on-call.md shows it and what the command prints."""

import re
from datetime import datetime, timezone

import pytest

from support.oncall import MARKER
from support.shipped_rules import ALERTMANAGER, ROOT, run_tool

PAGE = (ROOT / "docs" / "on-call.md").read_text()
SHIPPED = (ALERTMANAGER / "oncall.yml").read_text()
NOW = datetime(2026, 11, 22, 2, tzinfo=timezone.utc)
# Each shown command with what it prints.
SHOWN = re.findall(
    r"^\$ ros-diagnostics oncall ([^\n#]*)(?:#[^\n]*)?\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL
)


def test_the_page_shows_the_shipped_file_and_the_route():
    comment, _, content = SHIPPED.partition("\n")

    assert comment.startswith("# ")
    assert f"```yaml\n{content}```" in PAGE
    assert f"```yaml\n{MARKER}```" in PAGE


def test_the_shipped_file_can_be_built(run, folder):
    assert run(SHIPPED, "build").err == ""  # today
    assert "SUCCESS" in run_tool("amtool", "check-config", folder / "alertmanager-oncall.yml")


@pytest.mark.parametrize(("command", "shown"), SHOWN, ids=lambda text: text[:20])
def test_the_page_shows_what_the_command_prints(run, command, shown):
    text = SHIPPED
    if command.strip() == "check":
        text = SHIPPED.replace("daily 08:00-20:00", "daily 08:00-19:00")
    code = 2 if command.strip() == "check" else 0  # there is a gap
    printed = "".join(run(text, *command.split(), now=NOW, code=code))
    assert printed.startswith(shown.removesuffix("...\n"))


def test_two_commands_are_shown():
    assert len(SHOWN) == 2
