"""Fault histories: events at given seconds, and the changes of faults that each causes.

Each history runs three times: as written, with time advanced second by second, and with a new
engine restored from the written rows before each event. All three must give the same changes.
"""

import json
from collections.abc import Callable, Iterable
from itertools import cycle
from typing import Any

from ros_diagnostics_exporter.config.fleet import FaultSettings, Threshold
from ros_diagnostics_exporter.faults.engine import Faults
from ros_diagnostics_exporter.faults.model import (
    Change,
    ComponentName,
    ComponentReport,
    ComponentSettings,
    Followed,
    Identity,
    Reason,
    RobotSettings,
    Row,
    Scope,
    ValueReport,
)
from ros_diagnostics_exporter.model import Instant, Level

OK, WARN, ERROR, STALE = Level
EXPLAINED = (Reason.DEPENDS_ON, Reason.CAPABILITY)
WALL = 1_000_000.0  # Unix time at second 0
READY = -100.0  # second at which the robots are first received; the engine starts before
Event = Callable[[Faults, Instant], "list[Change]"]


BOOTS = (20_000.0, 10_000.0)  # monotonic time at second 0, of machines that run in turns


# -- events ------------------------------------------------------------------------------------


def level(component: str, to: Level, robot: str = "r1", **more: Any) -> Event:
    """One component is received with this level, or turns STALE; ``more`` as for several."""
    return levels([component], to, robot, **more)


def levels(
    components: Iterable[str],
    to: Level,
    robot: str = "r1",
    *,
    group: str = "",
    total: int = 20,
    confirm_after: float = 10.0,
    **settings: bool,
) -> Event:
    """One array has several components with this level."""
    used = ComponentSettings(confirm_after, **settings)
    reports = [ComponentReport(ComponentName(group, each), to, used) for each in components]
    return lambda faults, now: faults.components_changed(robot, reports, total, now)


def on_robots(robots: Iterable[str], event: Callable[..., Event], *args: object) -> Event:
    """The same event on several robots, at one time."""
    events = [event(*args, robot=robot) for robot in robots]
    return together(*events)


def together(*events: Event) -> Event:
    return lambda faults, now: [change for event in events for change in event(faults, now)]


def silent(robot: str = "r1", last: float | None = None) -> Event:
    """Nothing was received from the robot for its stale_after."""

    def event(faults: Faults, now: Instant) -> list[Change]:
        ago = 0.0 if last is None else now.wall - WALL - last
        return faults.robot_silent(robot, Instant(now.mono - ago, now.wall - ago), now)

    return event


def back(robot: str = "r1", *reports: Event) -> Event:
    """The robot is received again, with the reports of its first array."""
    return together(lambda faults, now: faults.robot_back(robot, now), *reports)


def never(robot: str = "r1") -> Event:
    return lambda faults, now: faults.robot_pending(robot, now)


def maintenance(*robots: str, planned: bool) -> Event:
    """A planned downtime of these robots (r1) begins or ends."""
    return lambda faults, now: faults.maintenance(dict.fromkeys(robots or ("r1",), planned), now)


def unreachable(*robots: str, is_so: bool) -> Event:
    """What these robots are behind begins to fail, or no longer does."""
    return lambda faults, now: faults.cut_off(dict.fromkeys(robots, is_so), now)


def restart() -> Event:
    """The exporter was killed, and starts with what it had written."""
    return lambda faults, now: faults.started(now, 0.0)


def robot_settings(
    robot: str = "r1", *, declared: bool = True, confirm_after: float = 10.0, **labels: str
) -> Event:
    settings = RobotSettings(labels, confirm_after)
    return lambda faults, now: faults.configure_robot(robot, settings, now, declared=declared)


def forget(robot: str = "r1", component: str | None = None) -> Event:
    if component is None:
        return lambda faults, now: faults.forget_robot(robot, now)
    name = ComponentName("", component)
    return lambda faults, now: faults.forget_component(robot, name, now)


def moved(component: str, group: str, to: str, robot: str = "r1") -> Event:
    old, new = ComponentName(group, component), ComponentName(to, component)
    return lambda faults, now: faults.component_moved(robot, old, new, now)


def check(found: int, expected: int | None, name: str = "motors", robot: str = "r1") -> Event:
    return lambda faults, now: faults.check_changed(robot, name, found, expected, now)


BATTERY = (Threshold("low", "warning", 20.0), Threshold("low", "critical", 10.0))


def value(
    number: float | None,
    thresholds: tuple[Threshold, ...] = BATTERY,
    robot: str = "r1",
    key: str = "charge",
    confirm_after: float = 10.0,
    **more: Any,
) -> Event:
    report = ValueReport(key, number, thresholds)
    name, settings = ComponentName("", "battery"), ComponentSettings(confirm_after, **more)
    return lambda faults, now: faults.values_changed(robot, name, settings, [report], now)


# -- running -----------------------------------------------------------------------------------


def words(identity: Identity) -> str:
    parts = [part for part in identity[2:] if part]
    return " ".join([f"{identity.scope.value}/{identity.state.value}", *parts])


def texts(changes: Iterable[Change]) -> list[str]:
    return [f"{change.what} {words(change.fault.identity)}" for change in changes]


class Player:
    """An engine and the rows that it has written."""

    def __init__(self, settings: FaultSettings, *, each_second: bool = False) -> None:
        self.settings = settings
        self.faults = Faults(settings)
        self.rows: dict[tuple[str, tuple[str, ...]], Row] = {}
        self.reborn_at_events = False
        self.writes = True
        self._each_second = each_second
        self.second = READY - 100
        self.shown: dict[str, dict[ComponentName, Followed]] = {}  # what a scrape has, by robot
        self._boots = cycle(BOOTS)
        self._boot = next(self._boots)
        self.clock_set = 0.0  # seconds by which the wall clock was set

    def at(self, second: float) -> Instant:
        """What the clocks of the engine's machine show."""
        return Instant(self._boot + second, WALL + self.clock_set + second)

    def write(self, second: float) -> None:
        """Write the changed rows, as JSON, as the database does."""
        for row in self.faults.take_rows(self.at(second)):
            if row.fields is None:
                self.rows.pop((row.kind, row.key), None)
            else:
                fields = json.loads(json.dumps(row.fields))
                self.rows[row.kind, row.key] = row._replace(fields=fields)

    def reborn(self, second: float, set_back: float = 0.0) -> None:
        """Continue with a new engine on another machine, restored from the written rows.

        Its wall clock is set back by so many seconds: from now on, ``second`` is by that.
        """
        self.write(second)
        self._boot = next(self._boots) + set_back
        self.second = second - set_back
        self.faults = Faults(self.settings)
        dropped = self.faults.restore(list(self.rows.values()), self.at(self.second))
        assert dropped == []
        self.shown = {robot: self.faults.followed(robot) for robot in self.faults._book.robots}

    def go(self, second: float, *events: Event) -> list[Change]:
        """Advance the time, apply the events; return all changes."""
        changes: list[Change] = []
        while self._each_second and self.second + 1 < second:
            self.second += 1
            changes += self.faults.advance(self.at(self.second))
            self.write(self.second)
        self.second = second
        changes += self.faults.advance(self.at(second))
        for event in events:
            if self.reborn_at_events:
                self.reborn(second)
            if isinstance(event, FleetChange):
                self.settings = event.settings
            changes += event(self.faults, self.at(second))
            if self.writes:
                self.write(second)
        return changes


class FleetChange:
    """Changes the settings of the fleet, also for new engines."""

    def __init__(self, settings: FaultSettings) -> None:
        self.settings = settings

    def __call__(self, faults: Faults, now: Instant) -> list[Change]:
        return faults.configure(self.settings, now)


def player(
    robots: Iterable[str],
    settings: FaultSettings,
    *,
    reborn: bool = False,
    each_second: bool = False,
) -> Player:
    """A fleet whose robots are up and OK, long after the start."""
    found = Player(settings, each_second=each_second)
    found.go(READY - 100, restart(), *(robot_settings(robot) for robot in robots))
    assert found.go(READY, *(back(robot) for robot in robots)) == []
    found.reborn_at_events = reborn
    return found


def assert_views_agree(player: Player) -> None:
    """What explains the trouble of components is what suppresses their problems."""
    faults, now = player.faults, player.at(player.second)
    found: dict[tuple[str, ComponentName], set[Reason]] = {}
    for view in faults.problems(now):
        of, due = view.identity, view.due <= now.wall
        is_suppressed = (
            view.fault is None and not view.healthy and due and view.suppressed in EXPLAINED
        )
        if is_suppressed and of.scope in (Scope.COMPONENT, Scope.FLAPPING):
            assert view.suppressed is not None
            name = ComponentName(of.group, of.component)
            found.setdefault((of.robot, name), set()).add(view.suppressed)
    explained = {
        (robot, name): reason
        for robot in faults._book.robots
        for name, reason in faults.suppressed_components(robot, now).items()
    }
    assert not any(cause.is_usual for cause in faults._book.causes.values())
    robots = faults._book.robots
    for robot in robots:
        problems = sorted(each.identity for each in faults.problems(now, robot))
        views = (view.identity for view in faults.problems(now))
        assert sorted(each for each in views if each.robot == robot) == problems
        assert sorted(faults.identities(robot)) == problems
        assert faults.in_trouble(robot) is bool(problems)
        parts = {ComponentName(each.group, each.component) for each in problems}
        for name in faults._book.robots[robot].components:
            assert faults.in_trouble(robot, name) is (name in parts)
    player.shown |= {
        each: faults.followed(each) for each in faults.take_followed() if each in robots
    }
    for robot in robots:
        shown, followed = (
            {name: each for name, each in found_of.items() if any(each)}
            for found_of in (player.shown.get(robot, {}), faults.followed(robot))
        )
        assert shown == followed, robot
    assert explained.keys() == found.keys()
    assert all(reason in found[of] for of, reason in explained.items())


def play(
    *steps: tuple[object, ...],
    robots: Iterable[str] = ("r1",),
    settings: FaultSettings | None = None,
) -> Player:
    """Run steps (second, event or None, expected change, ...); return the player at the end."""
    settings, robots = settings or FaultSettings(), list(robots)
    for how in ({"reborn": True}, {"each_second": True}, {}):
        last = player(robots, settings, **how)
        for second, event, *expected in steps:
            changes = last.go(second, *([] if event is None else [event]))
            found = texts(changes)
            assert_views_agree(last)
            assert found == expected, f"at {second} s, {how}: {found}, expected {expected}"
        assert len(list(last.faults.faults())) == sum(
            1 if "began" in text else -1 for _, _, *expected in steps for text in expected
        )
    return last
