"""Runs a bench here and at another commit, in turns, and prints the ratio of each line.

`./run bench NAME --against COMMIT` does this for all benches except `rules`, which evaluates the
rules of both at once. The commit is unpacked into a temporary folder, and its own bench of that
name measures it with this checkout's Python packages. A line is compared by the text and the first
number that it begins with. Of several turns the least counts: what else runs only makes it slower.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

from testbed.configuration import CHECKOUT

FOLDERS = ("exporter", "sim", "lab", "tests")  # what a bench imports; older commits have no lab
LINE = re.compile(r"(?P<what>\S.*?)(?: +\(target[^)]*\))?\s{2,}(?P<number>[0-9.]+)[%\s]")


def unpack(commit: str, folder: Path) -> None:
    """Write the files of a commit into a folder."""
    archive = ["git", "-C", str(CHECKOUT), "archive", commit]
    packed = subprocess.run(archive, check=True, capture_output=True).stdout
    subprocess.run(["tar", "-x", "-C", str(folder)], input=packed, check=True)


def measure(bench: str, options: list[str], checkout: Path) -> dict[str, float]:
    """The first number of each line that a checkout's bench prints; prints the lines."""
    paths = os.pathsep.join(str(checkout / folder) for folder in FOLDERS)
    program = [sys.executable, "-m", f"bench.{bench}", *options]
    environment = {**os.environ, "PYTHONPATH": paths}
    found: dict[str, float] = {}
    with subprocess.Popen(
        program, cwd=checkout, env=environment, stdout=subprocess.PIPE, text=True
    ) as process:
        for line in process.stdout or ():
            print(line, end="", flush=True)
            if numbers := LINE.match(line):
                found[numbers["what"]] = float(numbers["number"])
    if process.returncode:
        raise SystemExit(process.returncode)
    return found


def main() -> None:
    """Print both benches, and then how they compare."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("bench")
    parser.add_argument("--against", metavar="COMMIT", required=True)
    parser.add_argument("--turns", type=int, default=2, help="of each of both")
    options, of_bench = parser.parse_known_args()
    least: tuple[dict[str, float], dict[str, float]] = {}, {}
    with tempfile.TemporaryDirectory() as folder:
        unpack(options.against, Path(folder))
        for _ in range(options.turns):
            for found, checkout in zip(least, (CHECKOUT, Path(folder)), strict=True):
                print(f"--- {'here' if checkout is CHECKOUT else options.against}")
                for what, number in measure(options.bench, of_bench, checkout).items():
                    found[what] = min(number, found.get(what, number))
    print(f"--- here, in multiples of {options.against}")
    here, there = least
    for what in here.keys() & there.keys():
        if there[what]:
            print(f"{what:<46}{here[what] / there[what]:>6.2f}")


main()
