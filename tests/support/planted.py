"""A copy of the exporter, or of the checkout, with a mistake in it."""

import os
import shutil
from pathlib import Path

CHECKOUT = Path(__file__).parents[2]
FAULTS = Path("ros_diagnostics_exporter") / "faults"
# What is not copied: an environment, and caches.
_LEFT_OUT = (".*", "__pycache__")


def planted(folder: Path, file: str, right: str, wrong: str) -> dict[str, str]:
    """Copy the exporter to ``folder``, with ``wrong`` in place of ``right`` in a file of faults/.

    Returns the environment of a program that imports the copy.

    Raises:
        LookupError: ``right`` is not in the file exactly once.
    """
    shutil.copytree(CHECKOUT / "exporter" / FAULTS.parent, folder / FAULTS.parent)
    _plant(folder / FAULTS / file, right, wrong)
    return _importing(folder, *(CHECKOUT / each for each in ("lab", "tests", "sim")))


def planted_checkout(folder: Path, file: str, right: str, wrong: str) -> dict[str, str]:
    """Copy the checkout to ``folder``, with ``wrong`` in place of ``right`` in one of its files.

    Returns the environment of tests of the copy.

    Raises:
        LookupError: ``right`` is not in the file exactly once.
    """
    environment = copied_checkout(folder)
    _plant(folder / file, right, wrong)
    return environment


def copied_checkout(folder: Path) -> dict[str, str]:
    """Copy the checkout to ``folder``; returns the environment of tests of the copy."""
    shutil.copytree(CHECKOUT, folder, ignore=shutil.ignore_patterns(*_LEFT_OUT))
    return _importing(*(folder / name for name in ("exporter", "lab", "tests", "sim", "tools")))


def occurs_once(text: str, right: str) -> bool:
    """Whether a mistake can be planted in a file of this text."""
    return text.count(right) == 1


def _plant(path: Path, right: str, wrong: str) -> None:
    text = path.read_text()
    if not occurs_once(text, right):
        raise LookupError(f"{path.name} has changed: plant the mistake anew")
    path.write_text(text.replace(right, wrong))


def _importing(*paths: Path) -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": ":".join(map(str, paths))}
