"""Runs a bench here and with the exporter of another commit, in turns; prints each line's ratio.

`./run bench NAME --against COMMIT` does this. The commit is unpacked into a temporary folder, and
its exporter is measured by this checkout's bench, so that both are asked for the same. With
`--own-bench` the commit's own bench measures it: for a bench that uses parts of the exporter which
that commit has in another form. Lines that begin with the same text are compared number by number,
up to the first word after them. Of several turns the least counts: what else runs only makes it
slower.
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

FOLDERS = ("sim", "lab", "tests")  # what a bench imports; older commits have no lab
LINE = re.compile(r"(?P<what>\S.*?)(?: +\(target[^)]*\))?(?P<numbers>(?:\s{2,}[0-9.]+%?(?!\S))+)")


def unpack(commit: str, folder: Path) -> None:
    """Write the files of a commit into a folder."""
    archive = ["git", "-C", str(CHECKOUT), "archive", commit]
    packed = subprocess.run(archive, check=True, capture_output=True).stdout
    subprocess.run(["tar", "-x", "-C", str(folder)], input=packed, check=True)


def measure(
    bench: str, options: list[str], measured: Path, checkout: Path
) -> dict[str, list[float]]:
    """The numbers of each line that a checkout's bench prints of an exporter; prints the lines."""
    folders = (measured / "exporter", *(checkout / folder for folder in FOLDERS))
    paths = os.pathsep.join(map(str, folders))
    program = [sys.executable, "-m", f"bench.{bench}", *options]
    environment = {**os.environ, "PYTHONPATH": paths}
    found: dict[str, list[float]] = {}
    with subprocess.Popen(
        program, cwd=checkout, env=environment, stdout=subprocess.PIPE, text=True
    ) as process:
        for line in process.stdout or ():
            print(line, end="", flush=True)
            if line_of := LINE.match(line):
                numbers = line_of["numbers"].replace("%", "").split()
                found[line_of["what"]] = [float(each) for each in numbers]
    if process.returncode:
        raise SystemExit(process.returncode)
    return found


def main() -> None:
    """Print both benches, and then how they compare."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("bench")
    parser.add_argument("--against", metavar="COMMIT", required=True)
    parser.add_argument("--own-bench", action="store_true", help="that of the commit measures it")
    parser.add_argument("--turns", type=int, default=2, help="of each of both")
    options, of_bench = parser.parse_known_args()
    least: tuple[dict[str, list[float]], dict[str, list[float]]] = {}, {}
    with tempfile.TemporaryDirectory() as folder:
        unpack(options.against, Path(folder))
        for _ in range(options.turns):
            for found, measured in zip(least, (CHECKOUT, Path(folder)), strict=True):
                print(f"--- {'here' if measured is CHECKOUT else options.against}")
                checkout = measured if options.own_bench else CHECKOUT
                for what, numbers in measure(options.bench, of_bench, measured, checkout).items():
                    found[what] = [*map(min, numbers, found.get(what, numbers))]
    print(f"--- here, in multiples of {options.against}")
    here, there = least
    for what in [each for each in here if each in there]:
        both = zip(here[what], there[what], strict=False)  # there may be more by now
        ratios = [f"{mine / theirs:>7.2f}" if theirs else f"{'-':>7}" for mine, theirs in both]
        print(f"{what:<46}{''.join(ratios)}")


main()
