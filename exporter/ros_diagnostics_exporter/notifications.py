"""Who was notified of each fault, and who acknowledged it.

Alertmanager posts here what it sends to a receiver, as
https://prometheus.io/docs/alerting/latest/configuration/#webhook_config describes (version 4). That
says that the notification was passed to the receiver, not that a mail or text message arrived:
each integration of a receiver is sent and retried on its own.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Literal, NamedTuple

from pydantic import BaseModel, Field, TypeAdapter, ValidationError

from ros_diagnostics_exporter.config.errors import first_error
from ros_diagnostics_exporter.events import Event, Numbered, Wanted
from ros_diagnostics_exporter.faults.model import Fault, as_texts
from ros_diagnostics_exporter.silences import (
    AUTHOR_LENGTH,
    IDENTITY,
    NAME_LENGTH,
    Acknowledgement,
    clean,
)
from ros_diagnostics_exporter.texts import encodable

MAX_ALERTS = 1_000  # of a message
MAX_NOTIFIED = 100  # events of a fault; a reminder a day, for a quarter of a year
MAX_RECEIVERS = 20  # of a fault
MAX_ENDED = 1_000  # faults that ended, for which notifications may still come
ENDED = 3600.0  # seconds after a fault ended in which it may be notified after a restart

Key = tuple[str, ...]  # which fault: the labels of _KEY as Alertmanager has them
_KEY = IDENTITY[1:]  # without the fleet
_Text = Annotated[str, Field(max_length=NAME_LENGTH)]


class _Annotations(BaseModel):
    canary: str = ""  # when it began, Unix time


class _Alert(BaseModel):
    status: Literal["firing", "resolved"]
    labels: Annotated[dict[_Text, _Text], Field(max_length=100)]
    annotations: _Annotations = _Annotations()


class Message(BaseModel):
    """What is read of a message of Alertmanager's webhook."""

    version: Literal["4"]
    receiver: Annotated[str, Field(min_length=1, max_length=NAME_LENGTH)]
    alerts: Annotated[list[_Alert], Field(max_length=MAX_ALERTS)]


_MESSAGE = TypeAdapter(Message)


def parse(body: bytes) -> Message:
    """A message of Alertmanager's webhook.

    Raises:
        ValueError: It is none, or has more than the limits above; the text names the field.
    """
    try:
        return _MESSAGE.validate_json(body)
    except ValidationError as error:
        wrong = first_error(error, "the body")
        raise ValueError(f"not a message of Alertmanager's webhook, version 4: {wrong}") from error


def key_of(labels: Mapping[str, str]) -> Key:
    """Which fault of a fleet these labels name."""
    return tuple(encodable(labels.get(name, "")) for name in _KEY)


def _labels(event: Event) -> dict[str, str]:
    """The fields of an event that name its fault."""
    return {name: str(getattr(event, name)) for name in _KEY}


@dataclass(eq=False)
class _Known:
    """One fault: ``labels`` as in its events, ``receivers`` -> when last notified that it lasts."""

    labels: dict[str, str]
    since: float
    is_over: bool = False
    receivers: dict[str, float] = field(default_factory=dict)
    notified: int = 0
    over: set[str] = field(default_factory=set)  # receivers that were notified of its end
    acknowledged: set[float] = field(default_factory=set)  # when


class Received(NamedTuple):
    """What came of a message: events to be recorded, and the number of alerts ignored."""

    events: list[Event]
    ignored: int


class Notifications:
    """The faults that last, or have just ended, with what is known of each. Safe from any thread.

    ``note`` is to be called with each event that is recorded: those that the other methods return
    count only then.
    """

    def __init__(self, lasting: Iterable[Fault] = ()) -> None:
        self._lock = threading.Lock()
        self._known: dict[Key, list[_Known]] = {}  # of one identity, the newest last
        self._ended: deque[tuple[Key, _Known]] = deque()
        self._ever = False
        for fault in lasting:
            labels = as_texts(fault.identity, fault.labels)
            self._known.setdefault(key_of(labels), []).append(_Known(labels, fault.since))

    def note(self, event: Event) -> None:
        """Follow an event; one of another kind than those of faults is none of this."""
        if event.since is None:
            return
        with self._lock:
            key = key_of(_labels(event))
            known = self._find(key, event.since)
            if event.kind in {"fault_began", "fault_ended"}:
                if known is None:
                    known = _Known(_labels(event), event.since)
                    self._known.setdefault(key, []).append(known)
                if event.kind == "fault_ended" and not known.is_over:
                    self._end(key, known)
            elif known is not None and event.kind == "acknowledged":
                known.acknowledged.add(event.time)
            elif event.kind == "notified":
                self._ever = True
                _count(known, event)

    def _find(self, key: Key, since: float) -> _Known | None:
        return next((each for each in self._known.get(key, ()) if each.since == since), None)

    def _end(self, key: Key, known: _Known) -> None:
        known.is_over = True
        self._ended.append((key, known))
        if len(self._ended) > MAX_ENDED:
            key, oldest = self._ended.popleft()
            self._known[key].remove(oldest)
            if not self._known[key]:
                del self._known[key]

    def receive(self, message: Message, fleet: str, wall: float) -> Received:
        """The events of a message that came at Unix time ``wall``.

        Alerts of other fleets, that are of no fault, or of one that is not known are ignored.
        """
        receiver = clean(message.receiver, AUTHOR_LENGTH)
        events: list[Event] = []
        with self._lock:
            for alert in message.alerts:
                labels, is_firing = alert.labels, alert.status == "firing"
                known = None
                if labels.get("fleet") == encodable(fleet):
                    known = self._choose(key_of(labels), receiver, is_firing=is_firing)
                if known is None or known.notified >= MAX_NOTIFIED:
                    continue
                step = clean(labels.get("step", ""), 8)
                events.append(
                    Event(
                        wall,
                        "notified",
                        **known.labels,
                        since=known.since,
                        after=alert.status,
                        receiver=receiver,
                        step=step,
                    )
                )
        return Received(events, len(message.alerts) - len(events))

    def _choose(self, key: Key, receiver: str, *, is_firing: bool) -> _Known | None:
        """The newest fault of that identity; for a recovery, the newest that ended without one."""
        found = self._known.get(key, [])
        if not is_firing:
            ended = [
                each
                for each in found
                if each.is_over and receiver in each.receivers and receiver not in each.over
            ]
            found = ended or found
        return found[-1] if found else None

    def acknowledge(self, acknowledgements: Iterable[Acknowledgement]) -> list[Event]:
        """The events of those acknowledgements that are new, of faults that last."""
        events: list[Event] = []
        with self._lock:
            for each in acknowledgements:
                for known in self._known.get(each.fault[1:], ()):
                    is_its = each.is_of(known.since) and not known.is_over
                    if is_its and each.at not in known.acknowledged:
                        events.append(
                            Event(
                                each.at,
                                "acknowledged",
                                **known.labels,
                                since=known.since,
                                message=each.comment,
                                author=each.author,
                            )
                        )
        return events

    def lasting(self) -> dict[Key, dict[str, float]] | None:
        """Of each fault that lasts, if anybody was notified: receiver -> when last, Unix time.

        None if there never was one: then Alertmanager may not be configured to post them.
        """
        with self._lock:
            if not self._ever:
                return None
            return {
                key: dict(found[-1].receivers)
                for key, found in self._known.items()
                if found[-1].receivers and not found[-1].is_over
            }


def _count(known: _Known | None, event: Event) -> None:
    if known is None:
        return
    known.notified += 1
    if event.after == "resolved":
        known.over.add(event.receiver)
    elif event.receiver in known.receivers or len(known.receivers) < MAX_RECEIVERS:
        known.receivers[event.receiver] = event.time


def restored(
    lasting: Iterable[Fault], find: Callable[[Wanted], Iterable[Numbered]] | None, wall: float
) -> Notifications:
    """What an earlier process knew, of the faults that last and of those that have just ended.

    Args:
        lasting: Those that last.
        find: The events that match, newest first; None where none are written.
        wall: The present, Unix time.
    """
    lasting = list(lasting)
    found = Notifications(lasting)
    if find is None:
        return found
    recent = wall - ENDED
    oldest = min((fault.since for fault in lasting), default=recent)
    for kind, since in (
        ("fault_ended", recent),
        ("acknowledged", oldest),
        ("notified", min(oldest, recent)),
    ):
        for _number, event in reversed([*find(Wanted(kind=kind, since=since, limit=10_000))]):
            found.note(event)
    return found
