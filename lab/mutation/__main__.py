"""`./run mutate`: plant small mistakes in packages: how many do their unit tests find?

cosmic-ray makes the mistakes, a few drawn from all of each package. Of the unit tests of the
package those are run that execute the changed statement, in a copy of the checkout.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

from support.planted import copied_checkout

PACKAGES = ("api", "config", "decode", "faults", "fleet", "metrics", "robots", "storage", "web")


def main() -> None:
    """Print the score and the survivors of each package."""
    options = _arguments().parse_args()
    with tempfile.TemporaryDirectory(prefix="mutate-") as folder:
        copy = Path(folder) / "checkout"
        environment = copied_checkout(copy)
        for package in options.package or PACKAGES:
            argv = [package, str(options.mutants), str(options.seed)]
            process = subprocess.Popen(
                [sys.executable, "-m", "mutation.score", *argv],
                cwd=copy,
                env=environment,
                stdout=subprocess.PIPE,
                text=True,
            )
            assert process.stdout is not None
            for line in process.stdout:
                print(line, end="", flush=True)
                if options.report:
                    with options.report.open("a") as report:
                        report.write(line)
            if process.wait():
                sys.exit(process.returncode)


def _arguments() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="./run mutate", description=main.__doc__)
    parser.add_argument(
        "package", nargs="*", metavar="PACKAGE", help=f"of {', '.join(PACKAGES)}; all if none"
    )
    parser.add_argument("--mutants", type=int, default=50, help="of each package (%(default)s)")
    parser.add_argument(
        "--report", type=Path, metavar="FILE", help="append scores and survivors to it, too"
    )
    parser.add_argument("--seed", type=int, default=1, help="which are drawn (%(default)s)")
    return parser


if __name__ == "__main__":
    main()
