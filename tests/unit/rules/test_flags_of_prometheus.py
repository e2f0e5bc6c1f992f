"""Every Prometheus that is started here, or described, repeats its alerts soon enough.

And after a restart it fires what is due soon enough.
"""

import re
from pathlib import Path

import pytest

from support.shipped_rules import ROOT
from testbed import programs

FLAGS = ("--rules.alert.resend-delay=30s", "--rules.alert.for-grace-period=1m")
# Without it Debian's Prometheus opens the folder of the system's service, and panics.
FOLDER = "--storage.tsdb.path=data"
PAGES = [ROOT / "README.md", *(ROOT / "docs").glob("*.md"), *(ROOT / "prometheus").rglob("*.yml")]
# Lines of a shell, those that are continued included.
COMMAND = re.compile(r"^(?:#\s+)?prometheus --config\.file=(?:.*\\\n)*.*", re.MULTILINE)
COMMANDS = [
    pytest.param(command, id=str(page.relative_to(ROOT)))
    for page in PAGES
    for command in COMMAND.findall(page.read_text("utf-8"))
]


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_of_the_documentation_has_the_flags(command: str):
    for flag in (*FLAGS, FOLDER):
        assert flag in command


def test_the_demo_and_the_tests_start_it_with_the_flags():
    command = programs.prometheus(Path("prometheus.yml"), "localhost:9090", Path("data"))

    assert set(FLAGS) <= set(command)


def test_compose_starts_it_with_the_flags():
    text = (ROOT / "compose.yaml").read_text("utf-8")

    for flag in FLAGS:
        assert f"- {flag}\n" in text


def test_the_pages_name_them_for_servers_that_are_there_already():
    for flag in FLAGS:
        assert flag in (ROOT / "docs" / "existing-servers.md").read_text("utf-8")
    kubernetes = (ROOT / "docs" / "kubernetes.md").read_text("utf-8")
    assert "resendDelay: 30s" in kubernetes
    assert "forGracePeriod: 1m" in kubernetes
