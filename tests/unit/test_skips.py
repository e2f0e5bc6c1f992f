"""`--no-skips`: a skipped test fails the run, unless tests/allowed_skips.yml has its reason."""

import sys
from pathlib import Path

from support import skips
from support.called import called
from testbed.configuration import CHECKOUT

TEST = """
import pytest
@pytest.mark.parametrize("reason", {reasons!r})
def test_it(reason):
    pytest.skip(reason)
"""


def test_a_skip_fails_the_run_that_allows_none_but_for_what_is_listed(tmp_path):
    assert 1 <= len(skips.allowed()) <= skips.MOST
    test = tmp_path / "test_it.py"
    test.write_text(TEST.format(reasons=["no browser here", *skips.allowed()]))
    argv = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-c", "pyproject.toml"]
    argv += ["--confcutdir", "tests", "-p", "conftest", "--no-skips", "-n", "1", str(test)]
    environment = {"PYTHONPATH": "tests:tools:lab", "PATH": str(Path(sys.executable).parent)}

    done = called(argv, code=1, cwd=CHECKOUT, env=environment)

    refused = [line for line in done.stdout.splitlines() if "which is a failure here: " in line]
    assert [line.rpartition(": ")[2] for line in refused] == ["no browser here"]
    number = 1 + len(skips.allowed())
    assert f"tests not run: {number}\n     1  no browser here\n" in done.stdout


def test_what_was_not_run_is_counted_by_its_reason_the_most_first():
    slow = [("a.py", line, "Skipped: slow") for line in (1, 2)]
    assert skips.table([("b.py", 3, "Skipped: no browser"), *slow]) == [
        "tests not run: 3",
        "     2  slow",
        "     1  no browser",
    ]
    assert skips.table([]) == []
