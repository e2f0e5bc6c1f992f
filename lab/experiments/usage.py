"""What a process uses: memory, open files, threads, CPU time."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from bench.sim import cpu_seconds, resident_megabytes


class Usage(NamedTuple):
    """Of one process, at one moment; memory is resident, in MB, CPU user and system time in s."""

    memory: float
    files: int
    threads: int
    cpu: float


def usage(pid: int) -> Usage:
    """Read it from /proc.

    Raises:
        OSError: There is no such process any more.
    """
    return Usage(
        memory=resident_megabytes(pid),
        files=sum(1 for _ in Path(f"/proc/{pid}/fd").iterdir()),
        threads=sum(1 for _ in Path(f"/proc/{pid}/task").iterdir()),
        cpu=cpu_seconds(pid),
    )


def megabytes(paths: list[Path]) -> float:
    """Return the size of files together; one that is not there counts nothing."""
    return sum(path.stat().st_size for path in paths if path.exists()) / 1e6
