"""Every test that docs/nagios.md names exists."""

from __future__ import annotations

import re
import subprocess
import sys

from support.shipped_rules import ROOT

# A row ends with one or more tests in backquotes.
ROW = re.compile(r"^\| .* \| ((?:(?:, )?`tests/[^`]+`)+) \|$", re.MULTILINE)


def test_every_row_names_tests_that_exist():
    text = (ROOT / "docs" / "nagios.md").read_text()
    rows = ROW.findall(text)
    named = [name for row in rows for name in re.findall("`([^`]+)`", row)]
    files = sorted({name.partition("::")[0] for name in named})

    command = [sys.executable, "-m", "pytest", "--collect-only", "-q", "-p", "no:xdist", *files]
    collected = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, timeout=120, check=False
    )

    table = text.partition("## Not here")[0]
    assert len(rows) == table.count("\n|") - 2  # the heading and its rule
    assert set(named) - set(collected.stdout.splitlines()) == set()
