"""Every Prometheus that is started here, or described, repeats its alerts soon enough."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from support.shipped_rules import ROOT
from testbed import programs

FLAG = "--rules.alert.resend-delay=30s"
PAGES = [ROOT / "README.md", *(ROOT / "docs").glob("*.md"), *(ROOT / "prometheus").rglob("*.yml")]
# Lines of a shell, those that are continued included.
COMMAND = re.compile(r"^(?:#\s+)?prometheus --config\.file=(?:.*\\\n)*.*", re.MULTILINE)
COMMANDS = [
    pytest.param(command, id=str(page.relative_to(ROOT)))
    for page in PAGES
    for command in COMMAND.findall(page.read_text("utf-8"))
]


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_of_the_documentation_has_the_flag(command: str):
    assert FLAG in command


def test_the_demo_and_the_tests_start_it_with_the_flag():
    assert FLAG in programs.prometheus(Path("prometheus.yml"), "localhost:9090", Path("data"))


def test_compose_starts_it_with_the_flag():
    assert f"- {FLAG}\n" in (ROOT / "compose.yaml").read_text("utf-8")


def test_the_pages_name_it_for_servers_that_are_there_already():
    assert FLAG in (ROOT / "docs" / "existing-servers.md").read_text("utf-8")
    assert "resendDelay: 30s" in (ROOT / "docs" / "kubernetes.md").read_text("utf-8")
