"""The exit codes of ``ros-diagnostics``, the same for every subcommand."""

from __future__ import annotations

from collections.abc import Iterable

from ros_diagnostics_exporter.texts import nearest

NO = 1  # not done, or the answer is no: not known, not the same, out of date
USAGE = 2  # wrong arguments, or a file that is not right
UNREACHABLE = 3  # a server does not answer
INTERRUPTED = 130  # Ctrl-C, as shells have it


class NotDoneError(Exception):
    """What was asked for is not done; the text says why, and what to do."""


class UnusableError(Exception):
    """A file that is not what it should be; the text names it."""


def no_robot(name: str, names: Iterable[str]) -> NotDoneError:
    """There is no such robot; one with a similar name is named."""
    return NotDoneError(f"no robot {name!r}{hint(name, names)}")


def hint(name: str, names: Iterable[str]) -> str:
    """The name that was meant, perhaps; "" if none is similar."""
    near = nearest(name, names)
    return f"; the nearest is {near!r}" if near else ""
