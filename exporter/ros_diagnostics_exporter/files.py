"""Reads regular files only, where a FIFO would block; notices what of files and folders changes."""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Iterable
from pathlib import Path


def read_regular(path: Path, most: int, *, follow: bool = True) -> bytes:
    """The first ``most`` bytes of a regular file.

    Opening does not block, as it would with a FIFO that has no writer.

    Args:
        path: The file.
        most: How many bytes at most.
        follow: Whether the path may be a symbolic link.

    Raises:
        OSError: the file cannot be read, or is a FIFO, a device, a socket or a folder.
    """
    more = os.O_NONBLOCK | os.O_NOCTTY | (0 if follow else os.O_NOFOLLOW)
    with open(path, "rb", opener=lambda name, flags: os.open(name, flags | more)) as file:
        if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
            raise OSError(errno.EINVAL, "it is not a regular file")
        return file.read(most)


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


def write_new(path: Path, content: bytes) -> None:
    """Write a new file that only this user may read; what is at the path is removed, not followed.

    Raises:
        OSError: it cannot be written.
    """
    path.unlink(missing_ok=True)
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW
    with os.fdopen(os.open(path, flags, 0o600), "wb") as file:
        file.write(content)
