"""Random fleets, losses and restarts against a plain model of the rules.

The model keeps for each component nothing but its history and applies the rules as they are written
in docs/architecture.md; it shares no code with the state.
"""

import tempfile
from dataclasses import dataclass, field
from pathlib import Path

from hypothesis import example, given, settings
from hypothesis import strategies as st

from ros_diagnostics_exporter.config.fleet import Source
from ros_diagnostics_exporter.model import Instant, Status
from support.state_driver import ERROR, OK, STALE, WALL, WARN, StateDriver, tree

STALE_AFTER = 7.3  # between two ticks, so that no comparison hangs on a rounding


@dataclass
class Expected:
    """One component by the rules."""

    level: int | None = None
    before_stale: int | None = None
    since: float = 0.0
    changes: int = 0
    received: float | None = None
    gaps: list[float] = field(default_factory=list)
    last_raw: float | None = None
    resume: float | None = None  # restored and not received since: when its level began

    def set(self, level: int, wall: float) -> None:
        if level == self.level:
            self.resume = None
            return
        if self.resume is not None and level == self.before_stale:
            self.since, self.level = self.resume, level
            self.before_stale = self.resume = None
            return
        if self.level is not None:
            self.changes += 1
        self.before_stale = self.level if level == STALE else None
        self.level, self.since, self.resume = level, wall, None


class Model:
    """One robot by the rules; ``raw`` says which kind of arrays it gets."""

    def __init__(self, raw: bool) -> None:
        self.raw = raw
        self.components: dict[str, Expected] = {}
        self.last: float | None = None
        self.up = False

    def threshold(self, component: Expected) -> float:
        if not self.raw:
            return STALE_AFTER
        if len(component.gaps) < 10 and sum(component.gaps) < 5:
            return 90.0
        return max(5.0, 3 * max(component.gaps[-10:]))

    def receive(self, levels: dict[str, int], mono: float, wall: float) -> None:
        self.last, self.up = mono, True
        for name, level in levels.items():
            component = self.components.setdefault(name, Expected())
            if self.raw:
                if component.last_raw is not None:
                    gap = mono - component.last_raw
                    component.gaps.append(min(gap, 2 * self.threshold(component)))
                component.last_raw = mono
            if level != STALE:
                component.received = mono
            component.set(level, wall)
        for name in self.components.keys() - levels.keys():
            if not self.raw and levels:
                self.components[name].set(STALE, wall)

    def tick(self, mono: float, wall: float) -> None:
        if not self.up:
            return
        if mono - self.last > STALE_AFTER:
            self.up = False
            for component in self.components.values():
                component.set(STALE, wall)
            return
        for component in self.components.values():
            if component.level == STALE or component.received is None:
                continue
            if mono > component.received + self.threshold(component):
                component.set(STALE, wall)

    def restart(self, wall: float) -> None:
        self.up = False
        for component in self.components.values():
            component.received = component.last_raw = None
            component.gaps = []
            component.changes = 0
            if component.level != STALE:
                component.before_stale, component.resume = component.level, component.since
                component.level = STALE
            if component.resume is not None:  # STALE since this process, not since the last one
                component.since = wall


LEVELS = st.sampled_from([OK, WARN, ERROR, STALE])
ACTIONS = st.one_of(
    st.tuples(
        st.just("send"), st.dictionaries(st.sampled_from(["A", "B/x", "n: C"]), LEVELS, max_size=3)
    ),
    st.tuples(st.just("wait"), st.sampled_from([0.25, 1.0, 3.0, 8.0, 30.0, 100.0])),
    st.tuples(st.just("restart"), st.just(None)),
)


class Play:
    """The same actions on the state and on the model."""

    def __init__(self, source: Source, path: Path) -> None:
        self.source, self.path = source, path
        self.driver = StateDriver(source, stale_after=STALE_AFTER)
        self.model = Model(raw=source is Source.RAW)
        self.wall = WALL

    def send(self, levels: dict[str, int]) -> None:
        statuses = [Status(level, name, "text") for name, level in levels.items()]
        if self.source is Source.RAW:
            self.driver.raw(*statuses)
        elif statuses:
            self.driver.agg(*tree(Group=statuses))
        else:  # as the aggregator does right after its start
            self.driver.agg(Status(STALE, "/Group", "Stale"))
        self.model.receive(levels, self.driver.now.mono, self.driver.now.wall)

    def wait(self, seconds: float) -> None:
        until = self.driver.now.mono + seconds
        while self.driver.now.mono < until:
            self.driver.wait(0.25)
            self.model.tick(self.driver.now.mono, self.driver.now.wall)

    def restart(self, _nothing: None) -> None:
        self.driver.keep(self.path)
        wall = self.driver.now.wall + 2.0
        self.driver = self.driver.restart(self.path, after=2.0)
        offset = wall
        self.driver.at = lambda seconds: self._at(seconds, offset)  # type: ignore[method-assign]
        self.model.restart(wall)

    def _at(self, seconds: float, offset: float) -> None:
        self.driver.now = Instant(seconds, offset + seconds)
        self.driver.state.tick(self.driver.now)

    def compare(self) -> None:
        found = {
            component.name: (
                component.level,
                component.before_stale,
                component.since,
                component.changes,
            )
            for component in self.driver.robot.components
        }
        expected = {
            name: (each.level, each.before_stale, each.since, each.changes)
            for name, each in self.model.components.items()
        }
        assert found == expected
        assert self.driver.robot.up == self.model.up


SEND_A, SEND_NONE = ("send", {"A": OK}), ("send", {})
STALE_AFTER_A_RESTART = [SEND_A, ("restart", None), SEND_NONE, ("send", {"A": STALE})]
LATE_BEFORE_SILENCE = [SEND_A, ("wait", 0.25), SEND_NONE, ("wait", 8.0), SEND_NONE]
MISSING_AT_ONE_MOMENT = [SEND_A, ("send", {"B/x": OK}), ("wait", 0.25), SEND_NONE]


@settings(max_examples=200)
@example(Source.RAW, [*STALE_AFTER_A_RESTART, ("wait", 0.25), ("send", {"A": WARN})])
@example(Source.AGG, MISSING_AT_ONE_MOMENT)
@example(Source.AGG, LATE_BEFORE_SILENCE)
@given(st.sampled_from([Source.RAW, Source.AGG]), st.lists(ACTIONS, max_size=25))
def test_the_state_keeps_the_rules_whatever_happens(source, actions):
    with tempfile.TemporaryDirectory() as folder:
        play = Play(source, Path(folder) / "state")
        for what, argument in actions:
            getattr(play, what)(argument)
            play.compare()
        play.driver.close()


@settings(max_examples=100)
@given(st.sampled_from([Source.RAW, Source.AGG]), st.lists(ACTIONS, max_size=25))
def test_absence_never_ends_a_fault(source, actions):
    """Once WARN or ERROR, a component is never gone, and OK only after a fresh OK."""
    with tempfile.TemporaryDirectory() as folder:
        play = Play(source, Path(folder) / "state")
        faulty: dict[str, bool] = {}
        for what, argument in actions:
            getattr(play, what)(argument)
            if what == "send":
                for name, level in argument.items():
                    if level != STALE:
                        faulty[name] = level in (WARN, ERROR)
            for name, is_faulty in faulty.items():
                component = play.driver.component(name)
                worst = component.level if component.level != STALE else component.before_stale
                assert (worst in (WARN, ERROR)) == is_faulty
        play.driver.close()
