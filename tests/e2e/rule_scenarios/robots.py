"""Stories of whole robots, of the network between, of exporters, and of a fleet of fifty."""

from __future__ import annotations

from e2e.rule_scenarios.fleets import EAST, WEST
from e2e.rule_scenarios.scenario import BEGIN, Story, critical, lasts, rank, silent, step

MUTE = (critical("mute", "Motor 3"), silent("mute"))
SCRAPPED = (critical("scrapped", "Laser 2"), silent("scrapped"))
SHAFT = (critical("gap", "Motor 1"), critical("lost", "Motor 1"))
UPLINK = "UplinkDown ap_9"
BUS = tuple(
    f"collapses/{part}"
    for part in (
        "Motor 1",
        "Motor 2",
        "Motor 3",
        "Sensor 1",
        "Sensor 2",
        "Laser 1",
        "Laser 2",
        "Cam 1",
    )
)
LIGHT_PARTS = ("Motor", "Laser", "Camera", "Gripper", "Radio")
TWENTY = tuple((robot, LIGHT_PARTS[n % 5]) for n, robot in enumerate((*EAST[:10], *WEST[:10])))
MANY_MOTORS = tuple(f"{robot}/Motor" for robot in (*EAST[:10], *WEST[:10]))


def _all(robots: tuple[str, ...], order: str) -> tuple[str, ...]:
    return tuple(f"{robot}: {order}" for robot in robots)


ROBOTS = (
    Story(
        "a robot that is declared and not heard is PENDING, until it is heard",
        ("late",),
        (
            step(BEGIN, "RobotPending late"),
            step("late: join", until=rank("late", 0)),
        ),
    ),
    Story(
        "planned maintenance is told and quiet; a fault that outlives it is told after it",
        ("serviced",),
        (
            step(BEGIN, until=rank("serviced", 0)),
            step("stage: maintain serviced", "Maintenance serviced"),
            step(
                ("serviced/Motor 1: error", "serviced/Motor 2: error"),
                "Maintenance serviced",
                until=lasts("serviced", 2),
            ),
            step("serviced/Motor 1: ok", "Maintenance serviced", until=lasts("serviced", 1)),
            step("stage: finish serviced", critical("serviced", "Motor 2")),
            step("serviced/Motor 2: ok", until=rank("serviced", 0)),
        ),
        spends={"maintenance": ((1, 4),), "critical": ((4, 5),)},
    ),
    Story(
        "a fault that is repaired while its robot is silent ends when the robot is heard",
        ("mute",),
        (
            step(BEGIN, until=rank("mute", 0)),
            step("mute/Motor 3: error", MUTE[0]),
            step("mute: hang", *MUTE),
            step(("mute/Motor 3: ok", "mute: resume"), until=rank("mute", 0)),
        ),
    ),
    Story(
        "many components of one robot that fail together are told once, as one fault of the robot",
        ("collapses",),
        (
            step(BEGIN, until=rank("collapses", 0)),
            step(_all(BUS, "error"), "ManyComponents collapses", until=lasts("collapses", 8)),
            step(_all(BUS, "ok"), until=rank("collapses", 0)),
        ),
        ranks={"collapses": (0, 3, 0)},
    ),
    Story(
        "a robot that is taken out of fleet.yml while CRITICAL ends its fault, and is not missed",
        ("sold",),
        (
            step(BEGIN, until=rank("sold", 0)),
            step("sold/Cam 1: error", critical("sold", "Cam 1")),
            step("stage: sell"),
        ),
    ),
    Story(
        "a robot that is gone and forgotten by a person while CRITICAL ends its fault",
        ("scrapped",),
        (
            step(BEGIN, until=rank("scrapped", 0)),
            step("scrapped/Laser 2: error", SCRAPPED[0]),
            step("scrapped: leave", *SCRAPPED),
            step("stage: forget scrapped"),
        ),
    ),
    Story(
        "a clock that is off is told until it is right again",
        ("ahead",),
        (
            step(BEGIN, until=rank("ahead", 0)),
            step("ahead: clock_jump: 30", "ClockOffset ahead"),
            step("ahead: clock_jump: -30"),
        ),
    ),
    Story(
        "what is beyond a limit is told until the limit is raised",
        ("crowded",),
        (
            step(BEGIN, "LimitHit crowded component_limit"),
            step("stage: raise limit"),
        ),
    ),
)
NETWORK = (
    Story(
        "a silent robot that answers pings is told from one that is off",
        ("wedged", "dark"),
        (
            step(BEGIN, until="count(probe_success) == 3"),
            step(
                ("wedged: hang", "dark: hang"),
                silent("wedged"),
                silent("dark"),
                says={
                    silent("wedged"): "It answers pings",
                    silent("dark"): "It does not answer pings",
                },
            ),
            step(("wedged: resume", "dark: resume")),
        ),
    ),
    Story(
        "robots behind a dead uplink are UNREACHABLE and not told; the uplink is",
        ("far_1", "far_2", "ap_9"),
        (
            step(BEGIN, until='probe_success{job="ros-diagnostics-uplink"} == 1'),
            step("stage: cut uplink", UPLINK),
            step(
                ("far_1: hang", "far_2: hang"),
                UPLINK,
                until='count(robot:ros_diagnostics_state:info{state="unreachable"}'
                " and on (robot) time() - robot:ros_diagnostics_silent:start > 12) == 2",
            ),
            step(("far_1: resume", "far_2: resume"), UPLINK, until=rank("far_2", 0)),
            step("stage: mend uplink"),
        ),
        spends={"unreachable": ((2, 3),)},
    ),
)
FLEETS = (
    Story(
        "a scrape gap, a killed exporter and a silent robot end no CRITICAL, and tell none again",
        ("gap", "lost", "shaft"),
        (
            step(BEGIN, until='count(robot:ros_diagnostics_state:rank{fleet="shaft"} == 0) == 2'),
            step(("gap/Motor 1: error", "lost/Motor 1: error"), *SHAFT),
            step("lost: hang", *SHAFT, silent("lost")),
            step("stage: stall exporter", *SHAFT, silent("lost"), "ExporterDown shaft"),
            step("stage: let exporter go on", *SHAFT, silent("lost"), until=rank("gap", 3)),
            step(
                ("stage: kill exporter", "lost/Motor 1: ok", "stage: start exporter"),
                *SHAFT,
                silent("lost"),
                until="time() - (fleet:ros_diagnostics_exporter_steady:start"
                '{fleet="shaft"} > BEGAN) > 15',
            ),
            step("lost: resume", SHAFT[0], until=rank("lost", 0)),
            step("gap/Motor 1: ok", until=rank("gap", 0)),
        ),
    ),
    Story(
        "twenty faults in a fleet of fifty are twenty; one part of many and half a fleet are one",
        ("yard", *EAST, *WEST),
        (
            step(BEGIN, until='count(robot:ros_diagnostics_state:rank{fleet="yard"} == 0) == 50'),
            step(
                tuple(f"{robot}/{part}: error" for robot, part in TWENTY),
                *(critical(robot, part) for robot, part in TWENTY),
            ),
            step(tuple(f"{robot}/{part}: ok" for robot, part in TWENTY)),
            step(_all(MANY_MOTORS, "error"), "CommonCause Motor"),
            step(_all(MANY_MOTORS, "ok")),
            step(_all(EAST, "hang"), "FleetPartDown east"),
            step(_all(EAST, "resume")),
        ),
    ),
)
