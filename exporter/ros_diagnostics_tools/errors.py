"""The exit codes of ``ros-diagnostics``, the same for every subcommand."""

from __future__ import annotations

NO = 1  # not done, or the answer is no: not known, not the same, out of date
USAGE = 2  # wrong arguments, or a file that is not right
UNREACHABLE = 3  # a server does not answer
INTERRUPTED = 130  # Ctrl-C, as shells have it


class NotDoneError(Exception):
    """What was asked for is not done; the text says why, and what to do."""


class UnusableError(Exception):
    """A file that is not what it should be; the text names it."""
