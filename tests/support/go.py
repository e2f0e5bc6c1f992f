"""Go, for tools that are published as its modules."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest


def go(*arguments: str, cwd: Path, **environment: str) -> str:
    """Run `go`, or skip the test where there is none; its output."""
    if shutil.which("go") is None:
        pytest.skip("needs Go")
    done = subprocess.run(
        ["go", *arguments],
        cwd=cwd,
        env=os.environ | environment,
        capture_output=True,
        text=True,
        timeout=800,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout
