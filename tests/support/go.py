"""Go, for tools that are published as its modules."""

import os
import shutil
from pathlib import Path

import pytest

from support.called import called


def go(*arguments: str, cwd: Path, **environment: str) -> str:
    """Run `go`, or skip the test where there is none; its output."""
    if shutil.which("go") is None:
        pytest.skip("needs Go")
    argv = ["go", *arguments]
    return called(argv, cwd=cwd, env=os.environ | environment, timeout=800).stdout
