"""Reads regular files only: a FIFO or a device is an error and does not block."""

from __future__ import annotations

import errno
import os
import stat
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
