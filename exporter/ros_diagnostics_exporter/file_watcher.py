"""Detects changes of files and folders by polling their status.

Polling works on every file system and however a file is replaced (by an editor, by configuration
management, by Kubernetes' symbolic links); it costs a few system calls each time.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

MAX_UNSTABLE = 10  # polls after which a change counts although the files keep changing

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


class FileWatcher:
    """Reports each change of the watched paths once.

    A change counts when two polls in a row see the same, so that a file is not read while it is
    being written, or after ``MAX_UNSTABLE`` polls if a file never stops changing.
    """

    def __init__(self, paths: Iterable[Path]) -> None:
        self._unstable = 0  # polls since a change was seen
        self._mark: dict[Path, tuple[Path, int, int, int] | tuple[Path]] = {}
        self.watch(paths)

    def mark(self) -> None:
        """Note the state of the watched paths; call it before reading them again."""
        self._mark = {each[0]: each for each in signature(self._paths)}

    def watch(self, paths: Iterable[Path]) -> None:
        """Watch these paths, compared with their state at `mark`, else with the present one.

        So a change during the reading is reported.
        """
        self._paths = tuple(paths)
        self._last = signature(self._paths)
        self._known = tuple(self._mark.get(each[0], each) for each in self._last)
        self._mark = {}
        self._unstable = 0

    def changed(self) -> bool:
        """Poll the paths; whether they have changed since the last reported change."""
        before, self._last = self._last, signature(self._paths)
        self._unstable = 0 if self._last == self._known else self._unstable + 1
        if not self._unstable or (self._last != before and self._unstable < MAX_UNSTABLE):
            return False
        self._known, self._unstable = self._last, 0
        return True
