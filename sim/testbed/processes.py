"""A program as a child process that is stopped together with its own children."""

from __future__ import annotations

import os
import re
import signal
import subprocess
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from testbed.polling import until


class Process:
    """A program that writes to ``log_path`` and never outlives this process.

    The kernel kills it when the thread that started it ends, even by SIGKILL: so start it from
    the main thread. It has its own session: Ctrl-C in the terminal does not reach it.
    """

    def __init__(
        self, name: str, argv: Sequence[str | Path], env: Mapping[str, str] | None, log_path: Path
    ) -> None:
        self.name = name
        self.argv = [str(part) for part in argv]
        self.env = env
        self.log_path = log_path
        self._child: subprocess.Popen[bytes] | None = None

    def start(self) -> Process:
        """Start the program; its output is appended to that of an earlier start.

        Raises:
            FileNotFoundError: There is no such program.
            RuntimeError: It is running already.
        """
        if self.alive:
            raise RuntimeError(f"{self.name} is running already")
        with self.log_path.open("ab") as log:
            self._child = subprocess.Popen(
                ["setpriv", "--pdeathsig", "KILL", "--", *self.argv],
                env=self.env,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        return self

    def stop(self, grace: float = 10.0) -> int | None:
        """Stop it and its children: SIGTERM, after ``grace`` seconds SIGKILL; return its exit code.

        A program that was never started or has ended is no error.
        """
        if self._child is None:
            return None
        self.signal(signal.SIGTERM)
        with suppress(subprocess.TimeoutExpired):
            self._child.wait(grace)
        self.kill()
        return self._child.returncode

    def kill(self) -> None:
        """Send SIGKILL to it and its children."""
        self.signal(signal.SIGKILL)
        if self._child is not None:
            self._child.wait()

    def signal(self, number: signal.Signals) -> None:
        """Send a signal to the program and its children; to one that has ended, nothing."""
        if self._child is not None:
            with suppress(ProcessLookupError):
                os.killpg(self._child.pid, number)

    @property
    def pid(self) -> int:
        """The id of the program that was started last.

        Raises:
            RuntimeError: None was started.
        """
        if self._child is None:
            raise RuntimeError(f"{self.name} was not started")
        return self._child.pid

    @property
    def alive(self) -> bool:
        """Whether it runs now."""
        return self._child is not None and self._child.poll() is None

    @property
    def exit_code(self) -> int | None:
        """How it ended (negative: by that signal); None while it runs."""
        return None if self._child is None else self._child.poll()

    def output(self) -> str:
        """Return all that it has written, both streams."""
        return self.log_path.read_text(errors="replace") if self.log_path.exists() else ""

    def wait_for_output(self, pattern: str, seconds: float = 30.0) -> re.Match[str]:
        """Return the first match of ``pattern`` in the output; ends early if the program does.

        Raises:
            TimeoutError: It did not come in time.
            RuntimeError: The program ended without it.
        """

        def found_or_ended() -> re.Match[str] | bool | None:
            ended = not self.alive  # first, so that its last output is read
            return re.search(pattern, self.output()) or ended

        found = until(found_or_ended, lambda: f"{pattern!r} from {self.describe()}", seconds)
        if isinstance(found, re.Match):
            return found
        raise RuntimeError(f"{self.describe()}; it never wrote {pattern!r}")

    def describe(self, lines: int = 15) -> str:
        """Return its state and last output, for an error message."""
        code = self.exit_code
        state = f"{self.name} is running" if code is None else f"{self.name} ended with {code}"
        tail = "\n".join(self.output().splitlines()[-lines:])
        return f"{state}; its last output:\n{tail}"
