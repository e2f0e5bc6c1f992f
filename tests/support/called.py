"""Programs that end by themselves."""

import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any


def called(
    argv: Sequence[str | Path], *, code: int | None = 0, **more: Any
) -> subprocess.CompletedProcess[str]:
    """What a program writes to its two outputs; it must end with this exit code (None: any)."""
    done = subprocess.run(argv, capture_output=True, text=True, check=False, **more)
    assert code in (None, done.returncode), f"{done.args}: {done.stdout}{done.stderr}"
    return done
