"""Reloads the config on request and when its files have changed, in a loop of its own.

There is one way from fleet.yml to its readers: each is a `ConfigReader`, and is configured in turn.
When a reload ends, all of them follow it. If the file system hangs, only this loop waits, and a
request for a reload gets an error.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from concurrent.futures import TimeoutError as FutureTimeoutError
from pathlib import Path
from typing import Protocol

from ros_diagnostics_exporter.config.errors import ConfigError, Finding
from ros_diagnostics_exporter.config.fleet import Fleet
from ros_diagnostics_exporter.config.load import load
from ros_diagnostics_exporter.events import Event
from ros_diagnostics_exporter.files import FileWatcher
from ros_diagnostics_exporter.loops import Loop
from ros_diagnostics_exporter.model import Instant

log = logging.getLogger(__name__)

INTERVAL = 1.0  # seconds between two checks of the files
TIMEOUT = 10.0  # seconds after which a read counts as hanging
LISTED = 3  # problems in an event
FILES_CHANGED = "its files changed"


class ConfigReader(Protocol):
    """A part of the exporter that keeps something of the config."""

    def configure(self, fleet: Fleet, now: Instant) -> None:
        """Follow another config, before this returns; what that leaves unchanged goes on."""


class Reloader:
    """Keeps the config in step with its files.

    Args:
        path: fleet.yml.
        fleet: The Fleet that was read at the start.
        readers: Each is configured with every Fleet that is read, in the reloader's loop.
        record: Called with an event for every attempt that changes something.
        clocks: Returns the time.
    """

    def __init__(
        self,
        path: Path,
        fleet: Fleet,
        *,
        readers: Sequence[ConfigReader],
        record: Callable[[Event], None],
        clocks: Callable[[], Instant],
    ) -> None:
        self._path = path
        self._fleet = fleet
        self._readers = readers
        self._record = record
        self._clocks = clocks
        self._watcher = FileWatcher(fleet.sources)
        self._lock = threading.Lock()  # of the two below
        self._next: Future[None] | None = None  # the attempt that was requested
        self._why = ""
        self._hang_logged = False
        self._error = ""  # of the last attempt
        self._successful = True
        self.time = clocks().wall  # when the config was last read successfully, Unix time
        self.loop = Loop("config", INTERVAL, self._turn)

    def start(self) -> None:
        """Start to watch the files."""
        self.loop.start()

    def stop(self, seconds: float) -> None:
        """Apply nothing more; an attempt under way is waited for at most ``seconds``."""
        self.loop.stop(seconds)

    @property
    def successful(self) -> bool:
        """Whether the last attempt succeeded, and none hangs."""
        return self._successful and not self.loop.hangs(TIMEOUT)

    def request(self, why: str) -> Future[None]:
        """Request a reload, logged with the reason ``why``; returns the attempt."""
        with self._lock:
            if self._next is None:
                self._next, self._why = Future(), why
            self.loop.wake()
            return self._next

    def reload(self, why: str) -> None:
        """Reload the config and wait for it.

        Raises:
            ConfigError: the config cannot be used, or it takes too long to read.
        """
        attempt = self.request(why)
        try:
            attempt.result(0 if self.loop.hangs(TIMEOUT) else TIMEOUT)
        except FutureTimeoutError:  # in Python 3.10 not the built-in one
            what = f"has not been read after {TIMEOUT:.0f} s"
            remedy = "check whether its disk or network folder responds; the result is logged"
            raise ConfigError([Finding(self._path, None, "", what, remedy)]) from None

    def configure(self, fleet: Fleet) -> None:
        """Have all readers follow a config."""
        now = self._clocks()
        for reader in self._readers:
            reader.configure(fleet, now)

    def tick(self) -> None:
        """Log once if a read hangs."""
        hangs = self.loop.hangs(TIMEOUT)
        if hangs and not self._hang_logged:
            log.error(
                "%s or a file in its folders has not been read after %.0f s: "
                "no reload is possible until its disk or network folder responds",
                self._path,
                TIMEOUT,
            )
        self._hang_logged = hangs

    # -- in the loop -------------------------------------------------------------------------

    def _turn(self) -> None:
        with self._lock:
            attempt, self._next = self._next, None
            why = self._why if attempt is not None else FILES_CHANGED
        try:
            if attempt is not None or self._watcher.changed():
                self._read(why)
        except ConfigError as error:
            _fail(attempt, error)
        except Exception as error:
            # A bug. It must not go unnoticed.
            self._successful = False
            log.exception("reload failed; keeping the previous configuration")
            _fail(attempt, error)
        else:
            if attempt is not None:
                attempt.set_result(None)

    def _read(self, why: str) -> None:
        """Read everything and apply it; an event is recorded only if something changed."""
        requested = why != FILES_CHANGED
        self._watcher.mark()
        try:
            fleet = load(self._path, self._fleet.shard)
        except ConfigError as error:
            self._watcher.watch(error.sources)
            self._failed(error, why, again=str(error) == self._error and not requested)
            raise
        self._watcher.watch(fleet.sources)
        if self.loop.stopping:
            return
        same = fleet == self._fleet and self._successful
        self.time = self._clocks().wall
        if same and not requested:
            return
        self.configure(fleet)
        self._fleet, self._error, self._successful = fleet, "", True
        self._record(Event(self.time, "config", after="read"))
        log.info("reloaded the config: %s", why)
        for warning in fleet.warnings:
            log.warning("%s", warning)

    def _failed(self, error: ConfigError, why: str, *, again: bool) -> None:
        self._error, self._successful = str(error), False
        if again:
            return
        message = error.text(LISTED)
        self._record(Event(self._clocks().wall, "config", after="rejected", message=message))
        log.error("reload failed (%s); keeping the previous configuration:\n%s", why, error)


def _fail(attempt: Future[None] | None, error: Exception) -> None:
    if attempt is not None:
        attempt.set_exception(error)
