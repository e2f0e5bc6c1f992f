"""Which check of the simulation finds which known mistake, and after how many histories."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import NamedTuple

import yaml

from support.planted import CHECKOUT, planted

FAULTS = "exporter/ros_diagnostics_exporter/faults"
HISTORIES = 400  # of each mistake at most, unless the command says how many
FAILED = re.compile(r"^seed (\d+) fails: (\w+).*\n(in .*)", re.MULTILINE)


class Mistake(NamedTuple):
    """In ``file`` of faults/, ``right`` is replaced by ``wrong``."""

    what: str
    file: str
    right: str
    wrong: str


def main(histories: int, first: int) -> int:
    """Print a line for each mistake, and at the end how many were found.

    Returns 1 where a history fails without any: of what it fails with later, nothing is known.
    """
    histories = histories or HISTORIES
    after, check = _play(dict(os.environ), histories, first)
    if after:
        print(f"seed {first + after - 1} fails without a mistake, by {check}: mend that first")
        return 1
    print(f"Without a mistake, all {histories} histories pass.\n", flush=True)
    found, mistakes = 0, [*_mistakes()]
    print(f"| mistake | after, of {histories} histories | found by |\n|---|---|---|")
    for mistake in mistakes:
        with tempfile.TemporaryDirectory(prefix="planted-") as folder:
            environment = planted(Path(folder), mistake.file, mistake.right, mistake.wrong)
            after, check = _play(environment, histories, first)
        found += after > 0
        print(f"| {mistake.what} | {after or 'not found'} | {check} |", flush=True)
    print(f"\n{found} of {len(mistakes)} mistakes were found")
    return 0


def _mistakes() -> Iterator[Mistake]:
    """Those that the simulation has to find, and those of faults/ that a unit test has to."""
    data = CHECKOUT / "tests/data"
    for each in yaml.safe_load((data / "planted_mistakes.yml").read_text()):
        yield Mistake(each["what"], each["file"], each["right"], each["wrong"])
    for each in yaml.safe_load((data / "planted_in_packages.yml").read_text()):
        path = PurePosixPath(each["file"])
        if path.is_relative_to(FAULTS):
            yield Mistake(each["what"], path.name, each["right"], each["wrong"])


def _play(environment: dict[str, str], histories: int, first: int) -> tuple[int, str]:
    """After how many histories one fails, and by which check; (0, "") if all pass."""
    options = ["--features", str(histories), "--seed", str(first)]
    done = subprocess.run(
        [sys.executable, "-m", "simulation", *options],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    failed = FAILED.search(done.stdout)
    if failed is None and done.returncode:
        raise RuntimeError(done.stderr[-2000:])
    if failed is None:
        return 0, ""
    seed, kind, check = failed.groups()
    return int(seed) - first + 1, f"{kind} {check}".replace("|", "\\|")
