"""Programs that end by themselves."""

import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any


def called(
    argv: Sequence[str | Path], *, check: bool = False, **more: Any
) -> subprocess.CompletedProcess[str]:
    """The exit code of a program, and what it has written to its two outputs."""
    return subprocess.run(argv, capture_output=True, text=True, check=check, **more)
