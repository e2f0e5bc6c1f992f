"""Runs histories on both sides and compares; what differs is made as small as it still differs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from conformance import stack
from conformance.exporter import play
from conformance.histories import NOT_TWICE, OPEN_ENDS
from conformance.history import History, Notification
from conformance.nagios import Nagios


@dataclass(frozen=True)
class Outcome:
    """The notifications of one history on both sides."""

    history: History
    nagios: list[Notification]
    ours: list[Notification]

    @property
    def same(self) -> bool:
        """Whether both notify the same, in the same order."""
        return self.nagios == self.ours

    @property
    def reason(self) -> str:
        """Why they differ on purpose; "" for the same, or for no reason."""
        return "" if self.same else self.history.reason or _after_flapping(self)

    def __str__(self) -> str:
        return "\n".join(
            (
                f"{self.history.name}: {dict(self.history.services)} {dict(self.history.hosts)}",
                f"  Nagios: {'; '.join(map(str, self.nagios)) or 'nothing'}",
                f"  here:   {'; '.join(map(str, self.ours)) or 'nothing'}",
            )
        )


def _after_flapping(outcome: Outcome) -> str:
    """The reason of a difference that is in what follows a FLAPPINGSTOP only."""
    if outcome.nagios == list(_without(outcome.ours, "RECOVERY")):
        return OPEN_ENDS
    again = {each.kind for each in outcome.ours} - {"RECOVERY"}
    if any(outcome.ours == list(_without(outcome.nagios, kind)) for kind in again):
        return NOT_TWICE
    return ""


def _without(notifications: list[Notification], kind: str) -> Iterator[Notification]:
    """All but those of a kind that follow a FLAPPINGSTOP at once."""
    before = ""
    for each in notifications:
        if (before, each.kind) != ("FLAPPINGSTOP", kind):
            yield each
        before = each.kind


Play = Callable[[History], "list[Notification]"]


def run(folder: Path, histories: Sequence[History], ours: Play = play) -> list[Outcome]:
    """Both sides of each history, in the order given.

    Nagios plays together those that need the same length of a tick, hours and restarts; so does
    a real Alertmanager those that are about whom it notifies, whatever ``ours`` is.
    """
    groups: dict[tuple[bool, bool, tuple[int, ...]], list[History]] = {}
    for each in histories:
        key = (each.timed, each.hours is not None, each.restarts)
        groups.setdefault(key, []).append(each)
    found: dict[int, list[Notification]] = {}
    for number, group in enumerate(groups.values()):
        played = Nagios(folder / f"nagios-{number}", group).play()
        found |= {id(each): notes for each, notes in zip(group, played, strict=True)}
    people = [each for each in histories if each.of_people]
    sent = []
    if people:
        (folder / "stack").mkdir()
        sent = stack.notifications(folder / "stack", people)
    of_people = {id(each): notes for each, notes in zip(people, sent, strict=True)}
    return [
        Outcome(each, found[id(each)], of_people[id(each)] if each.of_people else ours(each))
        for each in histories
    ]


def shrunk(folder: Path, history: History, ours: Play = play) -> Outcome:
    """The smallest history found that still differs as ``history`` does."""
    (smallest,) = run(folder / "0", [history], ours)
    for number in range(1, 100):
        candidates = list(_smaller(smallest.history))
        outcomes = run(folder / str(number), candidates, ours) if candidates else []
        differing = [each for each in outcomes if not each.same]
        if not differing:
            return smallest
        smallest = min(differing, key=lambda each: _size(each.history))
    return smallest


def _size(history: History) -> tuple[int, int]:
    tracks = [*history.services.values(), *history.hosts.values()]
    return sum(map(len, tracks)), sum(letter not in "ou" for track in tracks for letter in track)


def _smaller(history: History) -> Iterator[History]:
    """Histories without one service or one tick, or with one result that is well."""
    for each in history.services if len(history.services) + len(history.hosts) > 1 else ():
        services = {key: track for key, track in history.services.items() if key != each}
        yield replace(history, services=services)
    for tick in range(history.ticks if history.ticks > 1 else 0):
        yield replace(
            history,
            services=_cut(dict(history.services), tick),
            hosts=_cut(dict(history.hosts), tick),
        )
    for each, track in history.services.items():
        for tick, letter in enumerate(track):
            if letter != "o":
                calmer = track[:tick] + "o" + track[tick + 1 :]
                yield replace(history, services={**history.services, each: calmer})


def _cut(tracks: dict[str, str], tick: int) -> dict[str, str]:
    return {key: track[:tick] + track[tick + 1 :] for key, track in tracks.items()}
