"""A path -> the recordings in it: one file, a folder, a zip archive, split or compressed bags."""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory

from ros_diagnostics_exporter import zstd
from ros_diagnostics_tools import limits
from ros_diagnostics_tools.backtest.formats import (
    Format,
    RecordingError,
    Wanted,
    nothing,
    shortened,
)
from ros_diagnostics_tools.backtest.mcap import McapFile
from ros_diagnostics_tools.backtest.ros1 import Ros1Bag
from ros_diagnostics_tools.backtest.sqlite_bag import SqliteBag
from ros_diagnostics_tools.backtest.text_file import TextFile, is_text

FORMATS: dict[str, Callable[[Path], Format]] = {
    ".mcap": McapFile,
    ".db3": SqliteBag,
    ".bag": Ros1Bag,
    **dict.fromkeys((".json", ".jsonl", ".yaml", ".yml"), TextFile),
}
WITH_TYPES: dict[str, Callable[[Path, Wanted], Format]] = {".mcap": McapFile, ".db3": SqliteBag}
BAGS = (".mcap", ".db3", ".bag")  # of a folder; texts beside them are something else


def open_files(path: Path, stack: ExitStack, wanted: Wanted = nothing) -> list[Format]:
    """Open all that a path has, until the stack is closed. Raises RecordingError."""
    opened = []
    for file in _files(path, stack):
        with_types = WITH_TYPES.get(file.suffix)
        if with_types is not None:
            found = with_types(file, wanted)
        else:
            found = FORMATS.get(file.suffix, TextFile)(file)
        stack.callback(found.close)
        opened.append(found)
    return opened


def _files(path: Path, stack: ExitStack) -> list[Path]:
    if path.is_dir():
        found = [each for each in sorted(path.iterdir()) if _suffix(each) in BAGS]
    elif path.suffix == ".zip" and path.exists():
        found = sorted(_unpacked(path, Path(stack.enter_context(TemporaryDirectory()))))
    elif not path.exists():
        raise RecordingError(f"{path}: there is no such file or folder")
    else:
        found = [path] if _suffix(path) in FORMATS or is_text(path) else []
    if not found:
        raise RecordingError(f"{path}: is no recording, and has none: {', '.join(FORMATS)}, .zip")
    return [_decompressed(each, stack) for each in found]


def _suffix(path: Path) -> str:
    return Path(path.stem).suffix if path.suffix == ".zstd" else path.suffix


def _decompressed(path: Path, stack: ExitStack) -> Path:
    if path.suffix != ".zstd":
        return path
    target = Path(stack.enter_context(TemporaryDirectory()), path.stem)
    try:
        with zstd.open_file(path, "rb") as source:
            limits.unpack(source, target, limits.UNPACKED)
    except (EOFError, zstd.ZstdError, limits.LimitError) as error:
        raise RecordingError(f"{path}: cannot be unpacked: {shortened(error)}") from error
    return target


def _unpacked(path: Path, folder: Path) -> Iterator[Path]:
    """Extract the recordings of an archive, numbered: names in it may be the same."""
    try:
        with zipfile.ZipFile(path) as archive:
            members = [each for each in archive.namelist() if _suffix(Path(each)) in FORMATS]
            bags = [each for each in members if _suffix(Path(each)) in BAGS]
            taken = bags or members
            limits.check(sum(archive.getinfo(each).file_size for each in taken), limits.UNPACKED)
            for number, member in enumerate(taken):
                target = folder / f"{number:04d}-{PurePosixPath(member).name}"
                with archive.open(member) as source:
                    limits.unpack(source, target, limits.UNPACKED)
                yield target
    except (zipfile.BadZipFile, EOFError, OSError, NotImplementedError, ValueError) as error:
        raise RecordingError(f"{path}: cannot be unpacked: {shortened(error)}") from error
