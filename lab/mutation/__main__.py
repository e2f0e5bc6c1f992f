"""`./run mutate`: plant mutants, a few drawn from all of each package, and run its unit tests.

cosmic-ray makes the mutants and runs the tests, each in a process of its own, in a copy of the
checkout.
"""

from __future__ import annotations

import argparse
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from cosmic_ray.work_db import WorkDB, use_db
from cosmic_ray.work_item import MutationSpec, TestOutcome, WorkerOutcome, WorkResult

from support.planted import copied_checkout

PACKAGES = ("config", "decode", "faults", "fleet", "metrics", "robots", "storage", "web")
CODE = "exporter/ros_diagnostics_exporter"
# "|" is nearly always in a type annotation, which nothing evaluates.
LEFT_OUT = "core/ReplaceBinaryOperator_BitOr_"
SLOWER = 3  # times the tests' own time, after which a mutant counts as killed: it may never end


class Survivor(NamedTuple):
    """A mutant that no test of its package finds."""

    place: str
    change: str


def main() -> None:
    """Print the score and the survivors of each package."""
    options = _arguments().parse_args()
    with tempfile.TemporaryDirectory(prefix="mutate-") as folder:
        copy = Path(folder) / "checkout"
        environment = {**copied_checkout(copy), "PYTHONDONTWRITEBYTECODE": "1"}
        for package in options.package or PACKAGES:
            tested, survivors = _Package(package, copy, environment).test(
                options.mutants, options.seed
            )
            killed = tested - len(survivors)
            lines = [f"{package}: {killed} of {tested} killed, {killed / tested:.0%}"]
            lines.extend(f"  {place}\n{change}" for place, change in survivors)
            print("\n".join(lines), flush=True)
            if options.report:
                with options.report.open("a") as report:
                    report.writelines(f"{line}\n" for line in lines)


def _arguments() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="./run mutate", description=main.__doc__)
    parser.add_argument(
        "package", nargs="*", metavar="PACKAGE", help=f"of {', '.join(PACKAGES)}; all if none"
    )
    parser.add_argument("--mutants", type=int, default=20, help="of each package (%(default)s)")
    parser.add_argument(
        "--report", type=Path, metavar="FILE", help="append scores and survivors to it, too"
    )
    parser.add_argument("--seed", type=int, default=1, help="which are drawn (%(default)s)")
    return parser


class _Package:
    """One package and its unit tests, in a copy of the checkout."""

    def __init__(self, name: str, copy: Path, environment: dict[str, str]) -> None:
        self._name = name
        self._copy = copy
        self._environment = environment
        self._tests = [sys.executable, "-m", "pytest", "-qx", "-p", "no:cacheprovider"]
        self._tests.append(f"tests/unit/{name}")
        self._config = copy / f"{name}.toml"
        self._session = copy / f"{name}.sqlite"

    def test(self, mutants: int, seed: int) -> tuple[int, list[Survivor]]:
        """How many mutants were tested, and which of them survived."""
        begin = time.monotonic()
        self._run(*self._tests)  # all pass, or a score would mean nothing
        self._configure(SLOWER * (time.monotonic() - begin))
        self._run("cosmic-ray", "init", self._config.name, self._session.name)
        with use_db(self._session, WorkDB.Mode.open) as session:
            _draw(session, mutants, seed)
        self._run("cosmic-ray", "exec", self._config.name, self._session.name)
        with use_db(self._session, WorkDB.Mode.open) as session:
            results = [
                (item.mutations[0], result)
                for item, result in session.completed_work_items
                if result.worker_outcome is WorkerOutcome.NORMAL
            ]
        return len(results), sorted(_survivors(results))

    def _run(self, *argv: str) -> None:
        path = f"{Path(sys.executable).parent}:{self._environment['PATH']}"
        environment = {**self._environment, "PATH": path}
        done = subprocess.run(
            argv, cwd=self._copy, env=environment, capture_output=True, text=True, check=False
        )
        if done.returncode:
            sys.exit(f"{' '.join(argv)} fails without a mutant:\n{done.stdout}{done.stderr}")

    def _configure(self, timeout: float) -> None:
        self._config.write_text(
            "[cosmic-ray]\n"
            f'module-path = "{CODE}/{self._name}"\n'
            f"timeout = {timeout}\n"
            "excluded-modules = []\n"
            f'test-command = "{" ".join(self._tests)}"\n'
            "[cosmic-ray.distributor]\n"
            'name = "local"\n'
        )


def _draw(session: WorkDB, mutants: int, seed: int) -> None:
    """Skip all mutants but so many; the same ones for the same seed and code."""
    items = {_key(item.mutations[0]): item.job_id for item in session.work_items}
    wanted = sorted(key for key in items if not key[1].startswith(LEFT_OUT))
    drawn = set(random.Random(seed).sample(wanted, min(mutants, len(wanted))))
    skipped = [job for key, job in items.items() if key not in drawn]
    session.set_multiple_results(skipped, WorkResult(WorkerOutcome.SKIPPED))


def _key(mutant: MutationSpec) -> tuple[str, str, int, str]:
    return (
        str(mutant.module_path),
        mutant.operator_name,
        mutant.occurrence,
        str(mutant.operator_args),
    )


def _survivors(results: list[tuple[MutationSpec, WorkResult]]) -> Iterator[Survivor]:
    for mutant, result in results:
        if result.test_outcome is TestOutcome.SURVIVED:
            changed = [line for line in (result.diff or "").splitlines() if _is_change(line)]
            place = f"{mutant.module_path}:{mutant.start_pos[0]}"
            yield Survivor(place, "\n".join(f"    {line}" for line in changed))


def _is_change(line: str) -> bool:
    return line[:1] in {"-", "+"} and line[:3] not in {"---", "+++"}


if __name__ == "__main__":
    main()
