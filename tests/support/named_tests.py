"""Tests that pages and lists name: whether they exist, with the names of their cases."""

import re
import sys
from collections.abc import Iterable
from pathlib import Path

import pytest

from support.called import called

CHECKOUT = Path(__file__).parents[2]


def find_missing(named: Iterable[str], session: pytest.Session) -> set[str]:
    """Those of the tests, as pytest names them, that do not exist.

    What ``session`` runs is known without collecting again.
    """
    named = set(named)
    files = sorted({test.partition("::")[0] for test in named})
    absent = [each for each in files if not (CHECKOUT / each).exists()]
    if absent:
        return {each for each in named if each.partition("::")[0] in absent}
    cases = {item.nodeid for item in session.items}
    if not set(files) <= {case.partition("::")[0] for case in cases}:  # only some are run
        cases = _collected(*files)
    tests = cases | {case.partition("[")[0] for case in cases}
    # A file that is skipped as a whole, such as without a browser, has no cases.
    for file in set(files) - {case.partition("::")[0] for case in cases}:
        functions = re.findall(
            r"^def (test_\w+)", (CHECKOUT / file).read_text("utf-8"), re.MULTILINE
        )
        tests |= {f"{file}::{name}" for name in functions}
    return named - tests


def _collected(*files: str) -> set[str]:
    """The tests in these files, with the names of their cases."""
    command = [sys.executable, "-m", "pytest", "--collect-only", "-q", "-p", "no:xdist", *files]
    return set(called(command, code=None, cwd=CHECKOUT, timeout=300).stdout.splitlines())
