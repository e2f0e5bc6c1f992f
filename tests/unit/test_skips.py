"""`--no-skips`: a skipped test fails the run, unless tests/allowed_skips.yml has its reason."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from support import skips
from testbed.configuration import CHECKOUT


def run(folder: Path, reasons: list[str], *options: str) -> subprocess.CompletedProcess[str]:
    """A run of a test for each reason, which is skipped for it."""
    test = folder / "test_it.py"
    table = f"@pytest.mark.parametrize('reason', {reasons!r})"
    test.write_text(f"import pytest\n\n{table}\ndef test_it(reason):\n    pytest.skip(reason)\n")
    own = ["-p", "no:cacheprovider", "-c", "pyproject.toml", "--confcutdir", "tests"]
    argv = [sys.executable, "-m", "pytest", *own, "-p", "conftest", *options, str(test)]
    environment = {"PYTHONPATH": "tests:tools:lab", "PATH": str(Path(sys.executable).parent)}
    return subprocess.run(
        argv, cwd=CHECKOUT, env=environment, capture_output=True, text=True, check=False
    )


@pytest.mark.parametrize("options", [[], ["-n", "1"]])
def test_a_skip_fails_the_run_that_allows_none_but_for_what_is_listed(tmp_path, options):
    assert 1 <= len(skips.allowed()) <= skips.MOST
    done = run(tmp_path, ["no browser here", *skips.allowed()], "--no-skips", *options)

    assert done.returncode == 1, done.stdout + done.stderr
    refused = [line for line in done.stdout.splitlines() if "which is a failure here: " in line]
    assert [line.rpartition(": ")[2] for line in refused] == ["no browser here"]


@pytest.mark.parametrize(
    ("reasons", "options"), [(["no browser here"], []), ([*skips.allowed()], ["--no-skips"])]
)
def test_otherwise_a_skip_is_no_failure(tmp_path, reasons, options):
    done = run(tmp_path, reasons, *options)
    assert done.returncode == 0, done.stdout + done.stderr
