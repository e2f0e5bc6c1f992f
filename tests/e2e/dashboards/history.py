"""A recorded history for reports about a time range, as OpenMetrics text.

The samples are those that the rules would have recorded in the hours before the test; they end half
an hour before its start, when the reports are queried. The tests of the rules cover the recording.
"""

from collections.abc import Iterator
from pathlib import Path

SLOT = 300  # seconds of one slot of availability
SLOTS = 48  # four hours
GAP = 1800  # seconds between the end of the history and the start

# How many slots a robot spent in each part.
PARTS = {
    "well": {"ok": 48},
    "broken": {"ok": 24, "warning": 12, "critical": 12},
    "maintained": {"ok": 24, "maintenance": 24},
    "silent": {"ok": 24, "silent": 12, "undetermined": 12},
}
# How many slots of what a robot, or without one the fleet, could do.
ABLE = {
    'robot="well",capability="lifting"': {"able": 48},
    'robot="broken",capability="lifting"': {"able": 36, "lost": 9, "unknown": 3},
    'capability="lifting in the hall"': {"able": 40, "lost": 8},
}
# Seven days, this week's and those before: at the end of each the exporter counted.
DAY = 86_400
WEEK = {
    "faults": (3, 5),
    "acknowledged_faults": (2, 4),
    'acknowledge_seconds quantile="0.5"': (60, 120),
    'acknowledge_seconds quantile="1"': (90, 150),
    "recovered_faults": (1, 3),
    'recover_seconds quantile="0.5"': (600, 700),
    'recover_seconds quantile="1"': (660, 800),
    "notifications": (7, 9),
    'night_notifications night="2026-01-05"': (4, 4),
    'night_notifications night="2026-01-06"': (0, 0),
    'faulty_seconds robot="broken",part="/Motor/Motor 1"': (1800, 60),
    'faulty_times robot="broken",part="/Motor/Motor 1"': (2, 1),
}
# Goals of robots, and what one of them took: in how many slots there was one.
GOALS = {
    'robot="well",action="go",result="succeeded"': 30,
    'robot="well",action="go",result="aborted"': 2,
    'robot="broken",action="go",result="succeeded"': 5,
    'robot="broken",action="dock",result="succeeded"': 1,
    'robot="broken",action="dock",result="aborted"': 15,
    'robot="broken",action="dock",result="cancelled"': 3,
    'robot="broken",action="dock",result="unknown"': 4,
}
INTERVENTIONS = {"well": 0, "broken": 3}
MISSIONS_OF_A_DAY = {"goal_success": 0.875, "interventions_per_hour": 0.5}
AUTONOMOUS = {"well": 48, "broken": 24}  # slots
CARRIERS = ("well", "broken", "silent")
Sample = tuple[str, str, float, float]  # name, labels, value, Unix time


def write(path: Path, start: float) -> float:
    """Write the history before the Unix time ``start``; return the Unix time of its end."""
    end = float(int(start) - GAP)
    # OpenMetrics wants the samples of a series together, in the order of their times.
    samples = sorted(
        [
            *(*_parts(end), *_days(end), *_able(end), *_week(end)),
            *(*_missions(end), *_faults(end), *_alerts(end)),
        ],
        key=lambda sample: (sample[0], sample[1], sample[3]),
    )
    lines: list[str] = []
    for name in dict.fromkeys(sample[0] for sample in samples):
        lines.append(f"# TYPE {name} gauge")
        lines.extend(
            f"{each}{{{labels}}} {value} {time}"
            for each, labels, value, time in samples
            if each == name
        )
    path.write_text("\n".join([*lines, "# EOF", ""]))
    return end


def _parts(end: float) -> Iterator[Sample]:
    """A sample at the end of each slot; the last one at ``end``."""
    sums: dict[tuple[str, str, float], float] = {}
    for robot, parts in PARTS.items():
        slots = [part for part, count in parts.items() for _ in range(count)]
        for number, part in enumerate(slots, start=1):
            time = end - (SLOTS - number) * SLOT
            labels = f'fleet="hall",robot="{robot}",part="{part}"'
            yield "robot:ros_diagnostics_part_seconds:sum5m", labels, SLOT, time
            sums["fleet", part, time] = sums.get(("fleet", part, time), 0) + SLOT
            if robot in CARRIERS:
                sums["group", part, time] = sums.get(("group", part, time), 0) + SLOT
    for (level, part, time), seconds in sums.items():
        if level == "fleet":
            labels = f'fleet="hall",part="{part}"'
            yield "fleet:ros_diagnostics_part_seconds:sum5m", labels, seconds, time
        else:
            labels = f'fleet="hall",robot_group="carriers",part="{part}"'
            yield "robot_group:ros_diagnostics_part_seconds:sum5m", labels, seconds, time


def _days(end: float) -> Iterator[Sample]:
    """A good slot of robot well on each of the days before, of which the last is a week before."""
    for back in range(1, 8):
        for level, robot in (("robot", ',robot="well"'), ("fleet", "")):
            name = f"{level}:ros_diagnostics_part_seconds:sum5m"
            yield name, f'fleet="hall"{robot},part="ok"', SLOT, end - back * DAY - SLOT


def _week(end: float) -> Iterator[Sample]:
    for series, (this, before) in WEEK.items():
        family, _, labels = series.partition(" ")
        of = ",".join(filter(None, ('fleet="hall"', labels)))
        for value, time in ((this, end), (before, end - 7 * DAY)):
            yield f"ros_diagnostics_week_{family}", of, value, time


def _able(end: float) -> Iterator[Sample]:
    for able, parts in ABLE.items():
        slots = [part for part, count in parts.items() for _ in range(count)]
        for number, part in enumerate(slots, start=1):
            labels = f'fleet="hall",{able},part="{part}"'
            time = end - (SLOTS - number) * SLOT
            yield "capability:ros_diagnostics_part_seconds:sum5m", labels, SLOT, time


def _missions(end: float) -> Iterator[Sample]:
    robots = {f'robot="{name}"': number for name, number in INTERVENTIONS.items()}
    autonomous = {f'robot="{name}"': number for name, number in AUTONOMOUS.items()}
    for series, counts, value in (
        ("action:ros_diagnostics_goals:increase5m", GOALS, 1),
        ("robot:ros_diagnostics_interventions:increase5m", robots, 1),
        ("robot:ros_diagnostics_autonomous_seconds:increase5m", autonomous, SLOT),
    ):
        for labels, count in counts.items():
            for number in range(1, SLOTS + 1):
                time = end - (SLOTS - number) * SLOT
                yield series, f'fleet="hall",{labels}', value * (number <= count), time
    for series, value in MISSIONS_OF_A_DAY.items():
        yield f"fleet:ros_diagnostics_{series}:ratio1d", 'fleet="hall"', value, end


def _faults(end: float) -> Iterator[Sample]:
    """Two faults of robot broken, of 10 and 20 minutes; robot silent is silent for 15 minutes."""
    motor = (
        'fleet="hall",scope="component",severity="critical",'
        'robot="broken",group="/Motor",component="Motor 1"'
    )
    for begin, length in ((end - 7200, 600), (end - 3600, 1200)):
        for time in _every(15, begin, length):
            yield "robot:ros_diagnostics_fault_start:held", motor, begin, time
        yield from _down("broken", begin, length)
    begin = end - 5400
    silence = 'fleet="hall",scope="robot",severity="critical",robot="silent"'
    for time in _every(15, begin, 900):
        yield "robot:ros_diagnostics_fault_start:held", silence, begin, time
    yield from _down("silent", begin, 900)


def _down(robot: str, begin: float, length: float) -> Iterator[Sample]:
    labels = f'fleet="hall",robot="{robot}"'
    for time in _every(15, begin, length):
        yield "robot:ros_diagnostics_down:seconds", labels, time - begin, time


def _alerts(end: float) -> Iterator[Sample]:
    """The alerts of the faults of robot broken."""
    labels = (
        'alertname="RosDiagnosticsComponentCritical",severity="critical",scope="component",'
        'state="critical",fleet="hall",robot="broken",group="/Motor",component="Motor 1"'
    )
    for begin, length in ((end - 7200, 600), (end - 3600, 1200)):
        for time in _every(15, begin, length):
            yield "ALERTS", f'{labels},alertstate="firing"', 1, time
            yield "ALERTS_FOR_STATE", labels, begin, time


def _every(step: int, begin: float, length: float) -> Iterator[float]:
    return (begin + offset for offset in range(0, int(length) + 1, step))
