"""A month of the recorded availability of many robots, as OpenMetrics text, for bench.dashboards.

What the rules record in 30 days: for every robot its parts of each slot of five minutes, and for
each of its faults since when it has been, at every evaluation. One robot in a hundred is down for
a day; all others have a fault of ten minutes twice a week.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

DAYS = 30
SLOT = 300  # seconds
INTERVAL = 5  # seconds between two evaluations
SECONDS = DAYS * 86400
GROUPS = 20
LONG_DOWN = 100  # every so many robots one is
PARTS = ("ok", "warning", "critical", "maintenance")

Spell = tuple[float, float]  # seconds from the beginning of the month, and how long


def spells(robot: int) -> list[Spell]:
    """When a robot is CRITICAL."""
    if robot % LONG_DOWN == 0:
        return [(86400.0 * (1 + robot % 25), 86400.0)]
    first = 600.0 * (robot % 300)
    return [(first + week * 302400, 600.0) for week in range(SECONDS // 302400)]


def text(robots: int, end: float) -> Iterator[str]:
    """The series of a month that ends at ``end``."""
    begin = int(end) - SECONDS
    name = "robot:ros_diagnostics_part_seconds:sum5m"
    yield f"# TYPE {name} gauge\n"
    for robot in range(robots):
        for part, slots in _slots(robot).items():
            labels = f'{{fleet="bench",robot="robot_{robot}",part="{part}"}}'
            yield _series(name + labels, ((begin + (n + 1) * SLOT, SLOT) for n in slots))
    yield from _sums(robots, begin)
    for name, labels, value_of in (
        (
            "robot:ros_diagnostics_fault_start:held",
            (',scope="component",severity="critical",group="/Motor",component="Motor 1"'),
            _since,
        ),
        ("robot:ros_diagnostics_down:seconds", "", _seconds),
    ):
        yield f"# TYPE {name} gauge\n"
        for robot in range(robots):
            series = f'{name}{{fleet="bench",robot="robot_{robot}"{labels}}}'
            for at, lasts in spells(robot):
                since = begin + int(at)
                times = range(since, since + int(lasts), INTERVAL)
                yield _series(series, ((now, value_of(now, since)) for now in times))
    yield "# EOF\n"


def _since(_now: int, since: int) -> int:
    return since


def _seconds(now: int, since: int) -> int:
    return now - since


def _series(series: str, samples: Iterable[tuple[int, float]]) -> str:
    return "".join(f"{series} {value} {time}\n" for time, value in samples)


def _slots(robot: int) -> dict[str, list[int]]:
    """Part -> the slots that were spent in it; every slot belongs to one part."""
    down: set[int] = set()
    for at, lasts in spells(robot):
        down.update(range(int(at) // SLOT, int(at + lasts) // SLOT))
    slots: dict[str, list[int]] = {part: [] for part in PARTS}
    for number in range(SECONDS // SLOT):
        hour = number // 12
        if number in down:
            slots["critical"].append(number)
        elif hour % 168 == robot % 24:
            slots["maintenance"].append(number)
        else:
            slots["warning" if hour % 24 == robot % 7 else "ok"].append(number)
    return {part: found for part, found in slots.items() if found}


def _sums(robots: int, begin: int) -> Iterator[str]:
    """What is recorded for groups and the fleet: few series, whose values matter to nobody here."""
    for level, labels in (
        ("robot_group", [f',robot_group="group_{n}"' for n in range(GROUPS)]),
        ("fleet", [""]),
    ):
        name = f"{level}:ros_diagnostics_part_seconds:sum5m"
        yield f"# TYPE {name} gauge\n"
        for which in labels:
            for part in PARTS:
                seconds = SLOT * robots / len(labels) / len(PARTS)
                times = range(begin + SLOT, begin + SECONDS + SLOT, SLOT)
                series = f'{name}{{fleet="bench"{which},part="{part}"}}'
                yield _series(series, ((time, seconds) for time in times))
