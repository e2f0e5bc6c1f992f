"""Notices that files or folders changed, by looking at them now and then.

Looking works on every file system and with every way of replacing a file (editors, configuration
management, Kubernetes' symbolic links); it costs a few system calls every few seconds.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

RESTLESS = 10  # looks after which a change counts although the files go on changing

Signature = tuple[tuple[Path, int, int, int] | tuple[Path], ...]


def signature(paths: Iterable[Path]) -> Signature:
    """Something that differs whenever one of the files or folders has changed."""
    return tuple(_one(path) for path in paths)


def _one(path: Path) -> tuple[Path, int, int, int] | tuple[Path]:
    try:
        found = path.stat()
    except OSError:
        return (path,)
    return path, found.st_ino, found.st_size, found.st_mtime_ns


class Watch:
    """Tells once of each change of the watched paths, when it has come to rest.

    A change counts when two looks in a row see the same: a file that is just being written is not
    read halfway. One that changes without end keeps the others waiting for ``RESTLESS`` looks.
    """

    def __init__(self, paths: Iterable[Path]) -> None:
        self._waited = 0  # looks since there is a change
        self._marked: dict[Path, tuple[Path, int, int, int] | tuple[Path]] = {}
        self.watch(paths)

    def mark(self) -> None:
        """Note what the watched paths look like; to be called before they are read anew."""
        self._marked = {each[0]: each for each in signature(self._paths)}

    def watch(self, paths: Iterable[Path]) -> None:
        """Watch these paths from now on, as they were marked, or else as they are now.

        So what changed while it was read is told of as a change.
        """
        self._paths = tuple(paths)
        self._last = signature(self._paths)
        self._known = tuple(self._marked.get(each[0], each) for each in self._last)
        self._marked = {}
        self._waited = 0

    def look(self) -> bool:
        """Whether there was a change since the last time that this told of one."""
        before, self._last = self._last, signature(self._paths)
        self._waited = 0 if self._last == self._known else self._waited + 1
        if not self._waited or (self._last != before and self._waited < RESTLESS):
            return False
        self._known, self._waited = self._last, 0
        return True
