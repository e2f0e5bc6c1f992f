"""A file for each fault of a robot: what was received around its begin, and what judged it.

Written once fleet.yml's ``after`` has passed since the begin; limited in number, size and age.
"""

from __future__ import annotations

import errno
import json
import math
import re
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from ros_diagnostics_exporter.config.fleet import Fleet, RecordingSettings
from ros_diagnostics_exporter.config.load import FOLDERS, files_of
from ros_diagnostics_exporter.config.yaml_file import read
from ros_diagnostics_exporter.decode.messages import UnknownTypeError
from ros_diagnostics_exporter.events import Event, filled
from ros_diagnostics_exporter.files import write_new
from ros_diagnostics_exporter.model import Instant, Stream, Topic
from ros_diagnostics_exporter.recordings.mcap import Attachment, Channel, Chunk, write
from ros_diagnostics_exporter.recordings.rings import Rings
from ros_diagnostics_exporter.recordings.schemas import SCHEMAS


def config_lines(config_file: Path, robot: str) -> str:
    """All but the entries of other robots; a comment where it cannot be read."""
    try:
        document, _problems = read(config_file)
        if document is None or not isinstance(document.data, dict):
            return f"# {config_file.name} cannot be read\n"
        found = dict(document.data)
        for section, default in FOLDERS.items():
            folder = config_file.parent / (found.pop(f"{section}_folder", None) or default)
            entries = [*_listed(found.pop(section, None)), *_of_folder(folder)]
            if section == "robots":
                entries = [each for each in entries if _name(each) == robot]
            if entries:
                found[section] = entries
    except (OSError, TypeError) as error:
        return f"# {config_file.name} cannot be read: {type(error).__name__}\n"
    return str(yaml.safe_dump(found, allow_unicode=True, sort_keys=False))


def _of_folder(folder: Path) -> Iterator[Any]:
    for file in files_of(folder):
        document, _problems = read(file)
        if document is not None:
            yield from _listed(document.data)


def _listed(entries: Any) -> list[Any]:
    """Entries as a list: a file of a folder may have one alone."""
    if entries is None:
        return []
    return list(entries) if isinstance(entries, list) else [entries]


def _name(entry: Any) -> Any:
    return entry.get("name") if isinstance(entry, dict) else None


ID = re.compile(r"[0-9a-f]{12}")
# Of a storm: in so many seconds so many faults have a recording, beyond that only critical ones.
STORM, FIRST, MOST = 600.0, 50, 100
_NOT_IN_FOXGLOVE = re.compile(r"[^A-Za-z0-9_.-]")


class Kept(NamedTuple):
    """How many files are kept, and for how long."""

    number: int = 1_000
    size: int = 100 << 20
    age: float = 90 * 86_400.0


@dataclass(frozen=True)
class Waiting:
    """A fault whose recording is not complete yet."""

    fault: str
    event: Event
    settings: RecordingSettings
    topics: tuple[Topic, ...]
    due: float  # monotonic


class FaultRecordings:
    """Those of one exporter, in a folder that need not be there.

    Args:
        folder: Where they are written.
        config_file: fleet.yml, of which the lines for the robot are attached.
        topics: The topics of a robot by its name.
        limits: How many are kept.
        settings: How much of the past they have.
        definition: That of a type of messages that drivers have.
    """

    def __init__(
        self,
        folder: Path,
        config_file: Path,
        topics: Callable[[str], tuple[Topic, ...]],
        limits: Kept | None = None,
        *,
        settings: RecordingSettings | None = None,
        definition: Callable[[str], str] = SCHEMAS.__getitem__,
    ) -> None:
        self.rings = Rings()
        self.skipped = 0  # faults in storms
        self._folder, self._config_file = folder, config_file
        self._topics, self._definition = topics, definition
        self._limits = limits or Kept()
        self._waiting: deque[Waiting] = deque()
        self._begun: deque[float] = deque()  # of late, monotonic
        self._keep(settings or RecordingSettings())
        self._newest: dict[str, float] | None = None  # when its fault began, by id; None: not known
        self._so_far: dict[str, bytes] = {}  # of those that are not complete, by id

    def configure(self, fleet: Fleet, _now: Instant) -> None:
        """Follow the config; a recording that is under way ends as it began."""
        self._keep(fleet.recordings)

    def _keep(self, settings: RecordingSettings) -> None:
        self._settings = settings
        self.rings.keep = settings.before + settings.after

    def note(self, fault: str, event: Event, now: Instant) -> None:
        """Note that a fault of a robot began; beyond the limits of a storm it has no recording."""
        while self._begun and self._begun[0] < now.mono - STORM:
            self._begun.popleft()
        if len(self._begun) >= (MOST if event.severity == "critical" else FIRST):
            self.skipped += 1
            return
        self._begun.append(now.mono)
        topics = self._topics(event.robot)
        due = now.mono + self._settings.after
        self._waiting.append(Waiting(fault, event, self._settings, topics, due))

    def keep_only(self, topics: set[Topic], robots: set[str]) -> None:
        """Forget what was received that is neither of these topics nor of these robots.

        A recording that is under way has what it began with.
        """
        waiting = list(self._waiting)
        topics = topics | {topic for each in waiting for topic in each.topics}
        self.rings.keep_only(topics, robots | {each.event.robot for each in waiting})

    def turn(self, now: Instant) -> None:
        """Compress what was received, and write the recordings that are complete.

        Raises:
            OSError: at least one could not be written; all others are.
        """
        self.rings.compress()
        due = [each for each in list(self._waiting) if each.due <= now.mono]
        errors = [error for each in due if (error := self._finish(each, now)) is not None]
        for each in list(self._waiting):
            if each.fault not in self._so_far and (content := self._content(each, now)):
                self._so_far[each.fault] = content
        if self._newest is None:  # the first time
            self._remove_unfinished()
        if due:
            self._prune(now)
        if due or self._newest is None:
            self._newest = self._find()
        if errors:
            raise errors[0]

    def read(self, fault: str, now: Instant) -> bytes:
        """The newest recording of a fault.

        Raises:
            LookupError: there is none; the text says why.
        """
        found = sorted(self._folder.glob(f"{fault}-*.mcap")) if ID.fullmatch(fault) else []
        if found:
            return found[-1].read_bytes()
        for each in list(self._waiting):  # others append to it
            if each.fault == fault:
                left = max(1, round(each.due - now.mono))
                raise LookupError(f"the recording of fault {fault} is complete in {left} s")
        raise LookupError(
            f"no recording of fault {fault!r}: there is no such fault of a robot, or it began in a "
            "storm of faults, before the exporter was started or too long ago"
        )

    def read_so_far(self, fault: str, since: float | None, now: Instant) -> bytes:
        """The recording of a fault whose trouble began then (None: it is over), complete or not.

        One that is not has what was received up to the begin.

        Raises:
            LookupError: there is none; the text says why.
        """
        content = self._so_far.get(fault)
        if content is not None:
            return content
        if since is None or not self.has(fault, since):
            raise LookupError(f"no recording of fault {fault!r} as it lasts now")
        return self.read(fault, now)

    def has(self, fault: str, since: float) -> bool:
        """Whether a fault whose trouble began then (Unix time) has one; the disk is not asked."""
        return (self._newest or {}).get(fault, -math.inf) >= int(since)

    # -- files ---------------------------------------------------------------------------------

    def _finish(self, waiting: Waiting, now: Instant) -> OSError | None:
        """Write one that is complete; the error if it cannot be, which is not tried again."""
        try:
            self._write(waiting, now)
        except OSError as error:
            return error
        finally:
            self._waiting.remove(waiting)
            self._so_far.pop(waiting.fault, None)
        return None

    def _remove_unfinished(self) -> None:
        """Remove what an exporter that was killed has left."""
        if self._folder.is_symlink():
            return  # another's files
        for path in self._folder.glob("*.part"):
            path.unlink(missing_ok=True)

    def _find(self) -> dict[str, float]:
        """When the fault of the newest recording began, by id."""
        found: dict[str, float] = {}
        for path in self._folder.glob("*.mcap"):
            fault, _, began = path.stem.partition("-")
            if ID.fullmatch(fault) and began.isdecimal():
                found[fault] = max(found.get(fault, 0.0), float(began))
        return found

    def _write(self, waiting: Waiting, now: Instant) -> None:
        content = self._content(waiting, now)
        if content is None:
            return
        self._folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if self._folder.is_symlink():
            raise OSError(errno.ELOOP, f"{self._folder} is a link")
        path = self._folder / f"{waiting.fault}-{waiting.event.time:.0f}.mcap"
        unfinished = path.with_suffix(".part")
        try:
            write_new(unfinished, content)
            unfinished.replace(path)
        except OSError:  # the disk is full, for example
            unfinished.unlink(missing_ok=True)
            raise

    def _content(self, waiting: Waiting, now: Instant) -> bytes | None:
        """What was received until now; None of a robot of which nothing was."""
        event, settings = waiting.event, waiting.settings
        begin, end = _ns(event.time - settings.before), _ns(event.time + settings.after)
        recorded: list[tuple[Channel, list[Chunk]]] = []
        for topic in waiting.topics:
            if (ring := self.rings.get(Stream(topic))) is not None:
                chunks = ring.chunks(begin, end, _ns(settings.before))
                recorded.append((self._channel(topic, Stream(topic).kind), chunks))
        last = max((chunk.end for _channel, chunks in recorded for chunk in chunks), default=None)
        if last is not None:  # of a robot that is silent what it said last
            begin = min(begin, last - _ns(settings.before))
        for (topic, kind, _robot), ring in self.rings.beside(event.robot).items():
            recorded.append((self._channel(topic, kind), ring.chunks(begin, end)))
        recorded = [(channel, chunks) for channel, chunks in recorded if chunks]
        if not recorded:
            return None
        return write(recorded, _metadata(waiting), self._attached(waiting), _ns(now.wall))

    def _channel(self, topic: Topic, kind: str) -> Channel:
        try:
            definition = SCHEMAS.get(kind) or self._definition(kind)
        except UnknownTypeError:
            definition = ""  # somebody removed it since the message was received
        return Channel(topic.name, kind, definition)

    def _attached(self, waiting: Waiting) -> Iterable[Attachment]:
        described = {
            "fault": waiting.fault,
            **filled(waiting.event),
            "evidence": waiting.event.message.splitlines(),
            "before": waiting.settings.before,
            "after": waiting.settings.after,
            "missing_messages": self._missing(waiting),
            "domain_ids": sorted({each.domain_id for each in waiting.topics}),
        }
        text = json.dumps(described, ensure_ascii=False, indent=2)
        yield Attachment("fault.json", "application/json", text.encode(errors="replace"))
        lines = config_lines(self._config_file, waiting.event.robot)
        yield Attachment("fleet.yml", "application/yaml", lines.encode(errors="replace"))

    def _missing(self, waiting: Waiting) -> dict[str, int]:
        """How many messages were too many, or too large, to be recorded, by topic."""
        event, settings = waiting.event, waiting.settings
        begin, end = _ns(event.time - settings.before), _ns(event.time + settings.after)
        rings = {each.name: self.rings.get(Stream(each)) for each in waiting.topics}
        rings |= {each.topic.name: ring for each, ring in self.rings.beside(event.robot).items()}
        lost = {
            topic: sum(begin <= time <= end for time in ring.lost)
            for topic, ring in rings.items()
            if ring is not None
        }
        return {topic: number for topic, number in lost.items() if number}

    def _prune(self, now: Instant) -> None:
        """Remove the oldest files beyond the limits."""
        if self._folder.is_symlink():
            return  # another's files
        found = [(path.lstat(), path) for path in self._folder.glob("*.mcap")]
        found.sort(key=lambda each: each[0].st_mtime, reverse=True)
        size = 0
        for number, (status, path) in enumerate(found):
            size += status.st_size
            is_old = status.st_mtime < now.wall - self._limits.age
            if number >= self._limits.number or size > self._limits.size or is_old:
                path.unlink(missing_ok=True)


def _ns(wall: float) -> int:
    return int(wall * 1e9)


def _metadata(waiting: Waiting) -> dict[str, dict[str, str]]:
    device = _NOT_IN_FOXGLOVE.sub("_", waiting.event.robot)[:100]
    return {"foxglove": {"deviceName": device}}
