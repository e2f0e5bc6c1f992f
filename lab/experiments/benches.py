"""The benches whose figures docs/performance.md shows, and what they printed.

Each runs as `./run bench NAME`; the ratios in their output hold on other machines too.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator

from experiments import results
from experiments.results import Results

NAME = "benches"
BENCHES = ("ingest", "scrape", "faults", "storage")
SECONDS = 450.0  # that one may take


def measure(bench: str) -> Iterator[dict[str, str]]:
    """Run one; yield what it printed.

    Raises:
        RuntimeError: It failed; the text has its errors.
    """
    argv = [sys.executable, "-m", f"bench.{bench}"]
    done = subprocess.run(argv, check=False, capture_output=True, text=True, timeout=SECONDS)
    if done.returncode != 0:
        raise RuntimeError(f"./run bench {bench} failed:\n{done.stderr}")
    yield {"bench": bench, "output": done.stdout}


def render(result: Results) -> str:
    """Write the outputs, the last of each bench."""
    last = {row["bench"]: row for row in result.rows()}
    parts = []
    for bench in BENCHES:
        if bench in last:
            row = last[bench]
            text = row["output"].rstrip().splitlines()
            parts.append(
                [f"`./run bench {bench}`, commit {row['commit']}:", "", "```", *text, "```"]
            )
    return result.write_markdown(*parts)


def main() -> None:
    """Run the benches; write the result."""
    parser = results.parser(NAME, __doc__ or "")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(BENCHES)}")
    options = parser.parse_args()
    if unknown := set(options.names) - set(BENCHES):
        parser.error(f"no such bench here: {', '.join(sorted(unknown))}")
    results.run(Results(options.out, NAME), options, options.names or BENCHES, measure, render)


if __name__ == "__main__":
    main()
