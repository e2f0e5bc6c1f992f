"""Made-up histories of an action server, and a recount of what was received of it.

The recount is brute force: it has all lists before it, and asks of each id in which of them it is.
"""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from hypothesis import strategies as st

from ros_diagnostics_exporter.decode.goals import (
    ABORTED,
    ACCEPTED,
    CANCELED,
    EXECUTING,
    SUCCEEDED,
    Goal,
    Key,
)
from ros_diagnostics_exporter.robots.goals import REPLACED, RETURN, Goals

WORDS = {SUCCEEDED: "succeeded", ABORTED: "aborted", CANCELED: "cancelled"}
ENDS = tuple(WORDS)

# What may happen: to the server's goals, to the server, to what is heard of it, to the exporter.
_of_goals = st.one_of(
    st.tuples(st.just("accept"), st.integers(0, 5)),  # one of few ids, so that they come again
    st.tuples(st.just("execute"), st.integers(0, 3)),
    st.tuples(st.just("end"), st.integers(0, 3), st.sampled_from(ENDS)),
    st.tuples(st.just("expire"), st.integers(0, 3)),
    st.tuples(st.just("pass"), st.sampled_from((0.0, 0.4, 0.7, 1.5, 30.0))),
)
_of_others = st.one_of(
    st.tuples(st.just("pass"), st.sampled_from((400.0, 700.0))),
    st.tuples(st.just("clock"), st.sampled_from((-1e6, 1e6))),
    st.sampled_from((("lose",), ("hear",), ("server",), ("leave",), ("return",), ("exporter",))),
)
_happening = st.one_of(_of_goals, _of_goals, _of_goals, _of_others)


def histories(most: int) -> Any:
    """Histories of up to so many things that happen."""
    return st.lists(_happening, min_size=most // 2, max_size=most)


@dataclass
class Server:
    """An action server as rcl has it, which publishes its list at each change."""

    clock: float = 1_000_000.0
    goals: list[Goal] = field(default_factory=list)
    accepted: int = 0

    def change(self, what: str, *values: Any) -> bool:
        """Let something happen to a goal; whether the list is published."""
        at = values[0]
        if what == "accept":
            return self._accept(at.to_bytes(16, "big"))
        chosen = [
            index for index, each in enumerate(self.goals) if each.has_ended == (what == "expire")
        ]
        if not chosen:
            return False
        index = chosen[at % len(chosen)]
        if what == "expire":
            del self.goals[index]  # which rcl does not publish
            return False
        status = EXECUTING if what == "execute" else values[1]
        self.goals[index] = self.goals[index]._replace(status=status)
        return True

    def _accept(self, goal_id: bytes) -> bool:
        if any(each.id == goal_id for each in self.goals):
            return False  # the server rejects it
        self.accepted += 1
        self.goals.append(Goal(goal_id, self.clock, ACCEPTED))
        return True


@dataclass
class Played:
    """A history as it was received: ``heard`` are (seconds, what, the list where it is one)."""

    goals: Goals
    server: Server
    heard: list[tuple[float, str, tuple[Goal, ...]]]
    is_whole: bool  # nothing was lost, and nobody was away or restarted
    now: float


def play(history: list[tuple[Any, ...]]) -> Played:
    """Play a history, and let what is held settle."""
    played = Played(Goals(), Server(), [], is_whole=True, now=0.0)
    hears, is_reached = True, True
    hear(played)
    for what, *values in history:
        if what == "pass":
            played.now += values[0]
            played.server.clock += values[0]
            played.goals.tick(played.now)
        elif what == "clock":
            played.server.clock += values[0]
        elif what in ("lose", "hear"):
            hears = what == "hear"
        elif what in ("server", "leave", "return", "exporter"):
            is_reached = what != "leave" and (is_reached or what == "return")
            disturb(played, what)
        else:
            played.now += 0.01
            played.server.clock += 0.01
            if played.server.change(what, *values):
                if hears and is_reached:
                    hear(played)
                else:
                    played.is_whole = False
    played.now += REPLACED + 0.5
    played.goals.tick(played.now)
    return played


def hear(played: Played) -> None:
    """Receive the server's list as it is."""
    goals = tuple(played.server.goals)
    played.heard.append((played.now, "list", goals))
    played.goals.see(goals, played.now)


def disturb(played: Played, what: str) -> None:
    """Restart the server, or the exporter; or let the server go or return."""
    played.is_whole = False
    played.heard.append((played.now, what, ()))
    if what == "server":
        played.server.goals.clear()
        played.goals.restart(played.now)
    elif what == "leave":
        played.goals.leave(played.now)
    elif what == "return":
        played.goals.return_(played.now)
    else:
        learned = played.goals.learned(played.now)
        played.goals = Goals()
        played.goals.restore(learned, played.now)


@dataclass
class Life:
    """One goal, in lists that follow each other."""

    first: int  # index in what was heard
    last: int
    goal: Goal


def recount(played: Played) -> Counter[str]:
    """How the goals ended by what was received, found in all of it at once."""
    return Counter(filter(None, (_result(played, each) for each in _lives(played))))


def _lists(played: Played) -> list[int]:
    return [index for index, each in enumerate(played.heard) if each[1] == "list"]


def _lives(played: Played) -> list[Life]:
    keys = {goal.key for each in played.heard for goal in each[2]}
    return [life for each in keys for life in _lives_of(played, each)]


def _lives_of(played: Played, key: Key) -> Iterator[Life]:
    life: Life | None = None
    for index, (_at, what, goals) in enumerate(played.heard):
        goal = next((each for each in goals if each.key == key), None)
        if what not in {"list", "server"}:
            continue
        if goal is None:
            if life:
                yield life
            life = None
        if goal and life and not life.goal.has_ended:
            life.last, life.goal = index, goal
        life = life or (Life(index, index, goal) if goal else None)
    if life:
        yield life


def _result(played: Played, life: Life) -> str | None:
    """How one goal ended; None where it is not counted, or runs."""
    begin = played.heard[life.first][2]
    started_ended = next(each for each in begin if each.key == life.goal.key).has_ended
    if started_ended and not _is_counted_at_once(played, life):
        return None
    lost_at = _lost_at(played, life)
    if lost_at is not None:
        return "unknown"
    if life.goal.has_ended:
        return _ended(played, life)
    following = [index for index in _lists(played) if index > life.last]
    return "unknown" if following else None


def _is_counted_at_once(played: Played, life: Life) -> bool:
    """Whether a goal counts that had ended when it was seen first."""
    before = [
        index for index in range(life.first) if played.heard[index][1] in ("list", "exporter")
    ]
    if not before:
        return False
    if played.heard[before[-1]][1] == "list":
        return True
    known = [played.heard[index][2] for index in before if played.heard[index][2]]
    return not known or life.goal.stamp > max(each.stamp for each in known[-1])


def _lost_at(played: Played, life: Life) -> float | None:
    """When a goal became unknown while nothing of it was received."""
    until = life.last if life.goal.has_ended else len(played.heard)
    away: float | None = None
    for at, what, _goals in played.heard[life.first + 1 : until]:
        if away is not None and at >= away + RETURN:
            return at
        if what == "server":
            return at
        if what in {"leave", "exporter"}:
            away = at if away is None or what == "exporter" else away
        elif what in ("return", "list"):
            away = None
    at = played.heard[until][0] if until < len(played.heard) else played.now
    return at if away is not None and at >= away + RETURN else None


def _ended(played: Played, life: Life) -> str:
    word, at = WORDS[life.goal.status], played.heard[life.last][0]
    if word == "succeeded":
        return word
    newer = [each for each in _lives(played) if _is_newer(each, life)]
    begins = [played.heard[each.first][0] for each in newer if _was_accepted(played, each, life)]
    if any(at - REPLACED <= each <= at for each in begins if each <= at):
        return "preempted"
    later = any(at < each <= at + REPLACED for each in begins)
    return "preempted" if word == "cancelled" and later else word


def _is_newer(each: Life, life: Life) -> bool:
    same = each.first == life.first
    return each.first > life.first or (same and each.goal.stamp > life.goal.stamp)


def _was_accepted(played: Played, each: Life, life: Life) -> bool:
    """Whether one exporter saw that a goal was accepted, and how another one ended."""
    before = [
        what for _at, what, _goals in played.heard[: each.first] if what in ("list", "exporter")
    ]
    first, last = sorted((each.first, life.last))
    between = [what for _at, what, _goals in played.heard[first:last]]
    return before[-1:] == ["list"] and "exporter" not in between
