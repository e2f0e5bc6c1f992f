"""The simulation finds mistakes: each that is planted in the judgement of faults breaks a seed."""

import subprocess
import sys

import pytest
import yaml

from support.planted import CHECKOUT, planted

SEEDS = 20  # at most; one of them has to fail
OPTIONS = ("--robots", "10", "--days", "8")
_LISTED = yaml.safe_load((CHECKOUT / "tests/data/planted_mistakes.yml").read_text())
MISTAKES = {each["what"]: (each["file"], each["right"], each["wrong"]) for each in _LISTED}


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_planted_mistake_is_found(mistake, tmp_path):
    environment = planted(tmp_path, *MISTAKES[mistake])
    argv = [sys.executable, "-m", "simulation", "--no-shrink", "--seeds", str(SEEDS), *OPTIONS]

    done = subprocess.run(argv, env=environment, capture_output=True, text=True, check=False)

    assert done.returncode == 1, done.stdout[-500:]
    # Some mistakes end in an exception of faults/ itself.
    assert " fails: " in done.stdout or "/faults/" in done.stderr, done.stderr[-2000:]


def test_every_mistake_can_be_planted(tmp_path):
    """So that a change of faults/ that moves one is noticed at once."""
    for number, mistake in enumerate(MISTAKES):
        planted(tmp_path / str(number), *MISTAKES[mistake])


def test_a_seed_that_fails_already_finds_no_mistake(tmp_path):
    environment = planted(tmp_path, *MISTAKES["begins at once"])
    argv = [sys.executable, "-m", "simulation", "--planted", "--features", "1"]

    done = subprocess.run(argv, env=environment, capture_output=True, text=True, check=False)

    assert done.returncode == 1, done.stderr[-2000:]
    assert done.stdout.startswith("seed 1 fails without a mistake, by AssertionError in ")
