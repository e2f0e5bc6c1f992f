"""A client that scrapes as Prometheus does, and what one scrape shows of a fleet."""

from __future__ import annotations

import gzip
import http.client
import re
import time
from base64 import b64encode
from collections import Counter
from dataclasses import dataclass, field

TIMEOUT = 10.0  # seconds for one whole scrape: Prometheus' default
HEADERS = {"Accept": "text/plain;version=0.0.4", "Accept-Encoding": "gzip"}
PIECE = 65536  # bytes
# Only what is needed, for prometheus_client's parser takes seconds for a hostile robot's series.
FAMILY = rb'^ros_diagnostics_%s\{[^\n]*%s="([^"\n]+)"[^\n]*\} (\S+)$'
UP = re.compile(FAMILY % (b"robot_up", b"robot"), re.MULTILINE)
LAST_MESSAGE = re.compile(
    FAMILY % (b"robot_last_message_timestamp_seconds", b"robot"), re.MULTILINE
)
REJECTED = re.compile(FAMILY % (b"(?:robot|exporter)_rejected_total", b"reason"), re.MULTILINE)
MESSAGES = re.compile(FAMILY % (b"robot_messages_total", b"robot"), re.MULTILINE)
MESSAGE_BYTES = re.compile(FAMILY % (b"robot_message_bytes_total", b"robot"), re.MULTILINE)
# The number of a message, which virtual robots put into its values so that lost ones are counted.
SEQUENCE = re.compile(
    rb'^ros_diagnostics_component_value\{[^\n]*?robot="([^"\n]+)"'
    rb'[^\n]*key="Sequence"[^\n]*\} (\S+)$',
    re.MULTILINE,
)
REJECTED_LOGINS = re.compile(
    rb"^ros_diagnostics_exporter_logins_rejected(_total)(?:\{[^\n]*\})? (\S+)$", re.MULTILINE
)
CHANGES = re.compile(FAMILY % (b"component_changes_total", b"robot"), re.MULTILINE)


def robots_up(text: bytes) -> int:
    """How many robots are received, by the text of a scrape."""
    return sum(float(value) == 1 for _robot, value in UP.findall(text))


def total(family: re.Pattern[bytes], text: bytes) -> int:
    """The sum of a family's samples, which are whole numbers."""
    return sum(int(float(value)) for _label, value in family.findall(text))


class ScrapeError(Exception):
    """No answer in time, or another status than 200."""


@dataclass(frozen=True)
class Scrape:
    """One answer: how long it took, and by robot what it says; ``ages`` in seconds at its end."""

    seconds: float
    up: dict[str, bool] = field(default_factory=dict)
    ages: dict[str, float] = field(default_factory=dict)
    rejected: dict[str, int] = field(default_factory=dict)
    messages: dict[str, int] = field(default_factory=dict)
    changes: dict[str, int] = field(default_factory=dict)


class Scraper:
    """Keeps its connection from scrape to scrape; before the address may be NAME:PASSWORD@."""

    def __init__(self, address: str) -> None:
        login, _, host = address.rpartition("@")
        self._headers = dict(HEADERS)
        if login:
            self._headers["Authorization"] = f"Basic {b64encode(login.encode()).decode()}"
        self._connection = http.client.HTTPConnection(host, timeout=TIMEOUT)

    def scrape(self) -> Scrape:
        """Scrape once.

        Raises:
            ScrapeError: It failed.
        """
        begin = time.monotonic()
        text = self.text()
        return _parse(text, time.monotonic() - begin, time.time())

    def text(self) -> bytes:
        """Scrape once; return the text as it was served, unzipped.

        Raises:
            ScrapeError: It failed.
        """
        try:
            return gzip.decompress(self._ask_again_if_closed(time.monotonic() + TIMEOUT))
        except (OSError, http.client.HTTPException) as error:
            self.close()
            raise ScrapeError(f"{type(error).__name__}: {error}") from error

    def close(self) -> None:
        """Close the connection; the next scrape opens another."""
        self._connection.close()

    def _ask_again_if_closed(self, deadline: float) -> bytes:
        """Ask; a kept connection that was closed meanwhile is replaced, as Go's client does."""
        kept = self._connection.sock is not None
        try:
            return self._ask(deadline)
        except (ConnectionResetError, BrokenPipeError):
            if not kept:
                raise
        self.close()
        return self._ask(deadline)

    def _ask(self, deadline: float) -> bytes:
        if self._connection.sock is None:
            self._connection.connect()
        self._connection.request("GET", "/metrics", headers=self._headers)
        self._limit(deadline)
        response = self._connection.getresponse()
        body = bytearray()
        while piece := response.read1(PIECE):
            body += piece
            self._limit(deadline)
        response.close()
        if response.status != http.client.OK:
            raise ScrapeError(f"status {response.status}")
        return bytes(body)

    def _limit(self, deadline: float) -> None:
        """Let the next wait for the server end at the deadline."""
        left = deadline - time.monotonic()
        if left <= 0:
            raise TimeoutError(f"no whole answer in {TIMEOUT:g} s")
        if self._connection.sock is not None:  # None where the server closes after its answer
            self._connection.sock.settimeout(left)


def _parse(text: bytes, seconds: float, now: float) -> Scrape:
    up = {robot.decode(): float(value) == 1 for robot, value in UP.findall(text)}
    ages = {robot.decode(): now - float(value) for robot, value in LAST_MESSAGE.findall(text)}
    sums = (_sums(family, text) for family in (REJECTED, MESSAGES, CHANGES))
    return Scrape(seconds, up, ages, *sums)


def _sums(family: re.Pattern[bytes], text: bytes) -> dict[str, int]:
    sums: Counter[str] = Counter()
    for label, value in family.findall(text):
        sums[label.decode()] += int(float(value))
    return dict(sums)
