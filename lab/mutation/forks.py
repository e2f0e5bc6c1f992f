"""Runs unit tests in forks of a process that has imported what they need of other projects."""

from __future__ import annotations

import contextlib
import gc
import importlib
import json
import os
import resource
import signal
import sys
from collections.abc import Callable, Generator, Sequence
from functools import _lru_cache_wrapper
from pathlib import Path
from typing import Any

import coverage
import hypothesis
import pytest

OUTPUT = Path("output.txt")  # of the last run
LEFT_OUT = "tests/unit/storage/test_killed.py"  # programs that are killed, for half a minute
MEMORY = 4 << 30  # bytes: a mutant may ask for all there are
WAITING = 60  # seconds: a mutant may wait for ever; what only is slow ends by its processor time
SLOWER = 3  # times what its tests took without a mutant, after which a mutant counts as killed
REACHING = 25  # examples of a property that show which statements it reaches
OPTIONS = (
    *("-q", "-x", "-p", "no:cacheprovider"),
    f"--ignore={LEFT_OUT}",
    *("-p", "pytest_timeout", "-p", "_hypothesis_pytestplugin"),  # others cost a second each time
    *("-W", "ignore::pytest.PytestAssertRewriteWarning"),  # these two are imported already
)


class Tests:
    """The unit tests of one package, in the checkout at the working directory, all of which pass.

    Raises:
        SystemExit: they do not.
    """

    def __init__(self, paths: Sequence[str], source: Path) -> None:
        self._paths, self._source = paths, source
        # Without a mutant, tests may take as long as they do on this machine, however busy it is.
        self._limit, self._slower = resource.RLIM_INFINITY, 0
        measured = Path("measured.json")
        os.environ["PYTEST_DISABLE_PLUGIN_AUTOLOAD"] = "1"
        status, _ = self._fork(lambda: self._measure(measured))
        if status:
            sys.exit(f"the tests {' '.join(paths)} fail without a mutant:\n{OUTPUT.read_text()}")
        found = json.loads(measured.read_text())
        self._all: list[str] = found["tests"]
        self._seconds: dict[str, float] = found["seconds"]
        self._reached: dict[str, dict[str, list[str]]] = found["reached"]
        for name in found["imported"]:
            with contextlib.suppress(ImportError):
                importlib.import_module(name)
        status, used = self._run(self._all)
        if status:
            sys.exit(f"the tests {' '.join(paths)} fail in a fork:\n{OUTPUT.read_text()}")
        self._limit, self._slower = int(10 + SLOWER * used), SLOWER

    def reaching(self, path: Path, lines: range) -> list[str]:
        """The tests that execute one of these lines; all for those that an import executes.

        Where none does, those that name the file: they may start it as a program.
        """
        by_line = self._reached.get(str(path.resolve()), {})
        found = {test for line in lines for test in by_line.get(str(line), ())}
        if not found:
            return [each for each in self._all if path.stem in Path(_file(each)).read_text()]
        return self._all if "" in found else sorted(found)

    def kill(self, tests: list[str]) -> bool:
        """Whether one of these fails, ends the process or takes too long."""
        return bool(tests) and self._run(tests)[0] != 0

    def _run(self, tests: list[str]) -> tuple[int, float]:
        files = sorted({_file(test) for test in tests}, key=self._seconds.__getitem__)
        longest = self._slower * max(map(self._seconds.__getitem__, files))
        options = [*OPTIONS, f"--timeout={longest and WAITING + longest}", *files]
        return self._fork(lambda: pytest.main(options, [_Chosen(tests)]))

    def _measure(self, report: Path) -> int:
        measuring = coverage.Coverage(
            data_file=None, source=[str(self._source)], config_file=False, messages=False
        )
        watched = _Watched(measuring)
        measuring.start()
        status = pytest.main([*OPTIONS, "--timeout=0", *self._paths], [watched])
        measuring.stop()
        data = measuring.get_data()
        here = str(Path.cwd())
        imported = [
            name
            for name, module in list(sys.modules.items())
            if not str(getattr(module, "__file__", None) or here).startswith(here)
        ]
        reached = {path: data.contexts_by_lineno(path) for path in data.measured_files()}
        found = {"tests": watched.tests, "seconds": watched.seconds}
        report.write_text(json.dumps({**found, "reached": reached, "imported": imported}))
        return int(status)

    def _fork(self, run: Callable[[], int]) -> tuple[int, float]:
        """The exit status of a process that runs this, and the processor time that it used."""
        child = os.fork()
        if child == 0:
            status = 1
            try:
                os.setsid()
                output = os.open(OUTPUT, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
                os.dup2(output, 1)
                os.dup2(output, 2)
                resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
                resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, MEMORY))
                resource.setrlimit(resource.RLIMIT_CPU, (self._limit, self._limit))
                status = int(run())
            finally:
                os._exit(status)
        _, status, used = os.wait4(child, 0)
        with contextlib.suppress(ProcessLookupError):
            os.killpg(child, signal.SIGKILL)  # programs that a test has left
        return status, used.ru_utime + used.ru_stime


def _file(test: str) -> str:
    return test.partition("::")[0]


def _draw(**settings: Any) -> None:
    """Have the properties that are collected from now on draw their examples like this."""
    hypothesis.settings.register_profile("mutation", hypothesis.settings(), **settings)
    hypothesis.settings.load_profile("mutation")


class _Watched:
    """Notes by which test a line is executed, and the seconds that each file of tests takes."""

    def __init__(self, measuring: coverage.Coverage) -> None:
        self._measuring = measuring
        self.tests: list[str] = []
        self.seconds: dict[str, float] = {}
        self._caches: list[_lru_cache_wrapper[Any]] = []

    def pytest_collection(self) -> None:
        _draw(max_examples=REACHING)

    def pytest_collection_finish(self) -> None:
        self._caches = [each for each in gc.get_objects() if isinstance(each, _lru_cache_wrapper)]

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Generator[None, Any, Any]:
        self.tests.append(item.nodeid)
        for cache in self._caches:  # or only the first test of all reaches what is kept
            if cache.__module__.startswith("ros_diagnostics"):
                cache.cache_clear()
        self._measuring.switch_context(item.nodeid)
        try:
            return (yield)
        finally:
            self._measuring.switch_context("")

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        file = _file(report.nodeid)
        self.seconds[file] = self.seconds.get(file, 0.0) + report.duration


class _Chosen:
    """Runs these tests only."""

    def __init__(self, tests: list[str]) -> None:
        self._tests = frozenset(tests)

    def pytest_collection(self) -> None:
        _draw(phases=(hypothesis.Phase.explicit, hypothesis.Phase.generate))  # one is enough

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        items[:] = [item for item in items if item.nodeid in self._tests]
