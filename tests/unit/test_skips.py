"""`--no-skips`: a skipped test fails the run, unless tests/allowed_skips.yml has its reason."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from support import skips
from testbed.configuration import CHECKOUT


def run(folder: Path, reason: str, *options: str) -> subprocess.CompletedProcess[str]:
    test = folder / "test_it.py"
    test.write_text(f"import pytest\n\ndef test_it():\n    pytest.skip({reason!r})\n")
    own = ["-p", "no:cacheprovider", "-c", "pyproject.toml", "--confcutdir", "tests"]
    argv = [sys.executable, "-m", "pytest", *own, "-p", "conftest", *options, str(test)]
    environment = {"PYTHONPATH": "tests:tools:lab", "PATH": str(Path(sys.executable).parent)}
    return subprocess.run(
        argv, cwd=CHECKOUT, env=environment, capture_output=True, text=True, check=False
    )


@pytest.mark.parametrize("options", [[], ["-n", "1"]])
def test_a_skip_fails_the_run_that_allows_none(tmp_path: Path, options: list[str]):
    done = run(tmp_path, "no browser here", "--no-skips", *options)

    assert done.returncode == 1, done.stdout + done.stderr
    assert "skipped, which is a failure here: " in done.stdout
    assert "no browser here" in done.stdout
    assert run(tmp_path, "no browser here", *options).returncode == 0


def test_a_skip_that_is_listed_is_no_failure(tmp_path: Path):
    assert 1 <= len(skips.allowed()) <= skips.MOST
    for reason in skips.allowed():
        done = run(tmp_path, reason, "--no-skips")
        assert done.returncode == 0, done.stdout + done.stderr
