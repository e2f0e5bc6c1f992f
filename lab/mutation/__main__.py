"""`./run mutate`: plant small mistakes in packages: how many do their unit tests find?

cosmic-ray makes the mistakes, a few drawn from all of each package. Of the unit tests of the
package those are run that execute the changed statement, or else name its file, in a copy of the
checkout. As many packages at a time as there are cores.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from mutation.drawn import OTHERS, PACKAGES
from mutation.score import TOO_FEW
from support.planted import copied_checkout


def main() -> None:
    """Print the score and the survivors of each package; fail where too few mistakes are found."""
    options = _arguments().parse_args()
    arguments = [str(options.mutants), str(options.seed)]
    too_few = []
    if options.report:
        options.report.write_text("")
    with (
        tempfile.TemporaryDirectory(prefix="mutate-") as folder,
        ThreadPoolExecutor(os.cpu_count()) as pool,
    ):
        copies = (Path(folder) / package for package in options.package or PACKAGES)
        for done in pool.map(lambda copy: _score(copy, arguments), copies):
            print(done.stdout, end="", flush=True)
            if options.report:
                with options.report.open("a") as report:
                    report.write(done.stdout)
            if done.returncode:
                too_few.append(done.stdout.partition(":")[0])
    if too_few:
        sys.exit(f"run mutate: the unit tests find too few mistakes in {', '.join(too_few)}")


def _score(copy: Path, arguments: list[str]) -> subprocess.CompletedProcess[str]:
    """Run `mutation.score` for the package that the copy to be made has the name of."""
    environment = copied_checkout(copy)
    done = subprocess.run(
        [sys.executable, "-m", "mutation.score", copy.name, *arguments],
        cwd=copy,
        env=environment,
        stdout=subprocess.PIPE,
        text=True,
        check=False,
    )
    if done.returncode not in (0, TOO_FEW):
        raise SystemExit(done.returncode)
    return done


def _arguments() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="./run mutate", description=main.__doc__)
    parser.add_argument(
        "package",
        nargs="*",
        metavar="PACKAGE",
        help=f"of {', '.join(PACKAGES)}, which are all if none is named; {', '.join(OTHERS)}",
    )
    parser.add_argument("--mutants", type=int, default=50, help="of each package (%(default)s)")
    parser.add_argument(
        "--report", type=Path, metavar="FILE", help="scores and survivors are written to it, too"
    )
    parser.add_argument("--seed", type=int, default=1, help="which are drawn (%(default)s)")
    return parser


if __name__ == "__main__":
    main()
