"""The score of one package, in a copy of the checkout that is the working directory."""

from __future__ import annotations

import compileall
import itertools
import py_compile
import sys
from pathlib import Path

import yaml

from mutation.drawn import drawn
from mutation.forks import Tests
from mutation.mutants import Change, Mutant, draw

ALLOWED = Path(__file__).with_name("survivors.yml")
WANTED, OF_PACKAGES = 0.85, {"faults": 0.95}  # the part that is to be killed
TOO_FEW = 3  # exit status: fewer are killed


def main(package: str, mutants: int, seed: int) -> int:
    """Print how many mutants of the package its unit tests find, and those that they do not.

    Returns:
        The exit status: 0, or TOO_FEW.
    """
    # By its text, as a mutant may be as long and as old as what it is made from.
    by_text = py_compile.PycInvalidationMode.CHECKED_HASH
    source, paths, files = drawn(package)
    source = source.resolve()
    compileall.compile_dir(source, quiet=1, invalidation_mode=by_text)
    tests = Tests(paths, source)
    allowed = {Change(each["file"], each["was"], each["now"]) for each in survivors()}
    wanted = (each for each in draw(source, files, seed) if each.change not in allowed)
    chosen = list(itertools.islice(wanted, mutants))
    survived = [each for each in chosen if not _killed(each, tests)]
    killed = len(chosen) - len(survived)
    score, least = killed / len(chosen), OF_PACKAGES.get(package, WANTED)
    print(f"{package}: {killed} of {len(chosen)} killed, {score:.0%} ({least:.0%} wanted)")
    for mutant in sorted(survived, key=lambda each: each.change):
        file, was, now = mutant.change
        print(f"  {file}:{mutant.lines.start}\n    - {was}\n    + {now}")
    return 0 if score >= least else TOO_FEW


def survivors() -> list[dict[str, str]]:
    """The mutants that do not count: ``file``, ``was``, ``now`` and ``why``."""
    found: list[dict[str, str]] = yaml.safe_load(ALLOWED.read_text()) or []
    return found


def _killed(mutant: Mutant, tests: Tests) -> bool:
    right = mutant.path.read_text()
    mutant.path.write_text(mutant.text)
    try:
        return tests.kill(tests.reaching(mutant.path, mutant.lines))
    finally:
        mutant.path.write_text(right)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3])))
