"""The simulation finds mistakes: each that is planted in the judgement of faults breaks a seed."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

CHECKOUT = Path(__file__).parents[3]
FAULTS = Path("ros_diagnostics_exporter") / "faults"
SEEDS = 20  # at most; one of them has to fail
OPTIONS = ("--robots", "10", "--days", "8")
_LISTED = yaml.safe_load((CHECKOUT / "tests/data/planted_mistakes.yml").read_text())
MISTAKES = {each["what"]: (each["file"], each["right"], each["wrong"]) for each in _LISTED}


def planted(mistake: str, folder: Path) -> Path:
    """A copy of the exporter with the mistake; the folder to import it from."""
    file, right, wrong = MISTAKES[mistake]
    shutil.copytree(CHECKOUT / "exporter" / FAULTS.parent, folder / FAULTS.parent)
    path = folder / FAULTS / file
    text = path.read_text()
    assert text.count(right) == 1, f"{file} has changed: plant the mistake anew"
    path.write_text(text.replace(right, wrong))
    return folder


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_planted_mistake_is_found(mistake, tmp_path):
    folder = planted(mistake, tmp_path)
    paths = (folder, CHECKOUT / "tests", CHECKOUT / "sim")
    argv = [sys.executable, "-m", "simulation", "--no-shrink", "--seeds", str(SEEDS), *OPTIONS]

    done = subprocess.run(
        argv,
        env={**os.environ, "PYTHONPATH": ":".join(map(str, paths))},
        capture_output=True,
        text=True,
        check=False,
    )

    assert done.returncode == 1, done.stdout[-500:]
    # Some mistakes end in an exception of faults/ itself.
    assert " fails: " in done.stdout or "/faults/" in done.stderr, done.stderr[-2000:]


def test_every_mistake_can_be_planted(tmp_path):
    """So that a change of faults/ that moves one is noticed at once."""
    for number, mistake in enumerate(MISTAKES):
        planted(mistake, tmp_path / str(number))
