"""The score of one package, in a copy of the checkout that is the working directory."""

from __future__ import annotations

import compileall
import itertools
import py_compile
import sys
from pathlib import Path

import yaml

from mutation.forks import Tests
from mutation.mutants import Change, Mutant, draw

PACKAGES = Path("exporter/ros_diagnostics_exporter").resolve()
ALLOWED = Path(__file__).with_name("survivors.yml")


def main(package: str, mutants: int, seed: int) -> None:
    """Print how many mutants of the package its unit tests find, and those that they do not."""
    # By its text, as a mutant may be as long and as old as what it is made from.
    by_text = py_compile.PycInvalidationMode.CHECKED_HASH
    compileall.compile_dir(PACKAGES, quiet=1, invalidation_mode=by_text)
    tests = Tests(Path("tests/unit") / package, PACKAGES / package)
    allowed = {Change(each["file"], each["was"], each["now"]) for each in survivors()}
    wanted = (each for each in draw(PACKAGES / package, seed) if each.change not in allowed)
    drawn = list(itertools.islice(wanted, mutants))
    survived = [each for each in drawn if not _killed(each, tests)]
    killed = len(drawn) - len(survived)
    print(f"{package}: {killed} of {len(drawn)} killed, {killed / len(drawn):.0%}")
    for mutant in sorted(survived, key=lambda each: each.change):
        file, was, now = mutant.change
        print(f"  {file}:{mutant.lines.start}\n    - {was}\n    + {now}")


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
    main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))
