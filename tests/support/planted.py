"""A copy of the exporter with a mistake in its judgement of faults."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

CHECKOUT = Path(__file__).parents[2]
FAULTS = Path("ros_diagnostics_exporter") / "faults"


def planted(folder: Path, file: str, right: str, wrong: str) -> dict[str, str]:
    """Copy the exporter to ``folder``, with ``wrong`` in place of ``right`` in a file of faults/.

    Returns the environment of a program that imports the copy.

    Raises:
        LookupError: ``right`` is not in the file exactly once.
    """
    shutil.copytree(CHECKOUT / "exporter" / FAULTS.parent, folder / FAULTS.parent)
    path = folder / FAULTS / file
    text = path.read_text()
    if text.count(right) != 1:
        raise LookupError(f"{file} has changed: plant the mistake anew")
    path.write_text(text.replace(right, wrong))
    paths = (folder, *(CHECKOUT / each for each in ("lab", "tests", "sim")))
    return {**os.environ, "PYTHONPATH": ":".join(map(str, paths))}
