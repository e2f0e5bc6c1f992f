"""Scenarios of whole robots, the network, exporters and a fleet of fifty."""

from collections.abc import Iterator

from e2e.rule_scenarios.fleets import EAST, WEST
from e2e.rule_scenarios.scenario import (
    BEGIN,
    Scenario,
    Step,
    critical,
    in_trouble,
    rank,
    silent,
    step,
)

MUTE = (critical("mute", "Motor 3"), silent("mute"))
SCRAPPED = (critical("scrapped", "Laser 2"), silent("scrapped"))
SHAFT = (critical("gap", "Motor 1"), critical("lost", "Motor 1"))
NO_MESSAGES = (silent("wedged"), silent("dark"))
# For twice its confirm_after.
NO_PING = 'max_over_time(probe_success{robot="dark"}[12s]) == 0'
UPLINK = critical("ap_9", "uplink")
UNSTEADY = "RobotFlapping unsteady"
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
COMPONENTS = ("Motor", "Laser", "Camera", "Gripper", "Radio")
TWENTY = (*EAST[:10], *WEST[:10])
TWENTY_FAULTS = tuple((robot, COMPONENTS[n % 5]) for n, robot in enumerate(TWENTY))
MANY_MOTORS = tuple(f"{robot}/Motor" for robot in TWENTY)


def _all(robots: tuple[str, ...], order: str) -> tuple[str, ...]:
    return tuple(f"{robot}: {order}" for robot in robots)


def _comes_and_goes(times: int) -> Iterator[Step]:
    """The robot is silent for less than its confirm_after, and back, so many times."""
    for _ in range(times):
        yield step("unsteady: hang", until='ros_diagnostics_robot_up{robot="unsteady"} == 0')
        yield step("unsteady: resume", until='ros_diagnostics_robot_up{robot="unsteady"} == 1')


ROBOTS = (
    Scenario(
        "a declared robot is PENDING until its first message",
        ("late",),
        (
            step(BEGIN, "RobotPending late"),
            step("late: join", until=rank("late", 0)),
        ),
    ),
    Scenario(
        "faults during maintenance fire nothing; one that outlives it fires at its end",
        ("serviced",),
        (
            step(BEGIN, until=rank("serviced", 0)),
            step("site: maintain serviced", "Maintenance serviced"),
            step(
                ("serviced/Motor 1: error", "serviced/Motor 2: error"),
                "Maintenance serviced",
                until=in_trouble("serviced", 2),
            ),
            step("serviced/Motor 1: ok", "Maintenance serviced", until=in_trouble("serviced", 1)),
            step("site: finish serviced", critical("serviced", "Motor 2")),
            step("serviced/Motor 2: ok", until=rank("serviced", 0)),
        ),
    ),
    Scenario(
        "a fault that is repaired while its robot is silent resolves when the robot is back",
        ("mute",),
        (
            step(BEGIN, until=rank("mute", 0)),
            step("mute/Motor 3: error", MUTE[0]),
            step("mute: hang", *MUTE),
            step(("mute/Motor 3: ok", "mute: resume"), until=rank("mute", 0)),
        ),
    ),
    Scenario(
        "a robot that comes and goes is one alert, and none about its silence",
        ("unsteady",),
        (
            step(BEGIN, until=rank("unsteady", 0)),
            *_comes_and_goes(3),
            step("unsteady: hang", UNSTEADY),
            step(
                "",
                UNSTEADY,
                until='max_over_time(ros_diagnostics_robot_up{robot="unsteady"}[20s]) == 0',
            ),
            step("unsteady: resume", UNSTEADY, until=rank("unsteady", 1.5)),  # as long as it flaps
        ),
    ),
    Scenario(
        "many components of one robot that fail together are one alert about the robot",
        ("collapses",),
        (
            step(BEGIN, until=rank("collapses", 0)),
            step(_all(BUS, "error"), "ManyComponents collapses", until=in_trouble("collapses", 8)),
            step(_all(BUS, "ok"), until=rank("collapses", 0)),
        ),
        ranks={"collapses": (0, 6, 0)},
    ),
    Scenario(
        "removing a CRITICAL robot from fleet.yml resolves its fault and fires nothing",
        ("sold",),
        (
            step(BEGIN, until=rank("sold", 0)),
            step("sold/Cam 1: error", critical("sold", "Cam 1")),
            step("site: sell"),
        ),
    ),
    Scenario(
        "forgetting a CRITICAL robot through the API resolves its fault",
        ("scrapped",),
        (
            step(BEGIN, until=rank("scrapped", 0)),
            step("scrapped/Laser 2: error", SCRAPPED[0]),
            step("scrapped: leave", *SCRAPPED),
            step("site: forget scrapped"),
        ),
    ),
    Scenario(
        "a wrong clock fires until it is right again",
        ("ahead",),
        (
            step(BEGIN, until=rank("ahead", 0)),
            step("ahead: clock_jump: 30", "ClockOffset ahead"),
            step("ahead: clock_jump: -30"),
        ),
    ),
    Scenario(
        "a limit that is hit fires until it is raised",
        ("crowded",),
        (
            step(BEGIN, "LimitHit crowded component_limit"),
            step("site: raise limit"),
        ),
    ),
)
NETWORK = (
    Scenario(
        "the description of a silent robot says whether it answers pings",
        ("wedged", "dark"),
        (
            step(BEGIN, until="count(probe_success == 1) == 3"),
            step(
                ("wedged: hang", "dark: hang"),
                *NO_MESSAGES,
                descriptions=dict.fromkeys(NO_MESSAGES, "it answers pings"),
            ),
            # While it is silent, its host is no fault of its own.
            step(
                "site: switch off dark",
                *NO_MESSAGES,
                until=NO_PING,
                descriptions={
                    silent("wedged"): "it answers pings",
                    silent("dark"): "it does not answer pings",
                },
            ),
            step(("site: switch on dark", "wedged: resume", "dark: resume"), until=rank("dark", 0)),
            # A robot that publishes and yet does not answer.
            step("site: switch off dark", critical("dark", "ping")),
            step("site: switch on dark"),
        ),
    ),
    Scenario(
        "robots behind a dead uplink are UNREACHABLE, and only its alert fires",
        ("far_1", "far_2", "ap_9"),
        (
            step(BEGIN, until=rank("ap_9", 0)),
            step("site: cut uplink", UPLINK),
            step(
                ("far_1: hang", "far_2: hang"),
                UPLINK,
                until='count(robot:ros_diagnostics_state:info{state="unreachable"}) == 2',
            ),
            step(("far_1: resume", "far_2: resume"), UPLINK, until=rank("far_2", 0)),
            step("site: mend uplink"),
        ),
    ),
)
FLEETS = (
    Scenario(
        "a CRITICAL keeps firing over a scrape gap, a killed exporter and a silent robot",
        ("gap", "lost", "shaft"),
        (
            step(BEGIN, until='count(robot:ros_diagnostics_state:rank{fleet="shaft"} == 0) == 2'),
            step(("gap/Motor 1: error", "lost/Motor 1: error"), *SHAFT),
            step("lost: hang", *SHAFT, silent("lost")),
            step("site: stall exporter", *SHAFT, silent("lost"), "ExporterDown shaft"),
            step("site: continue exporter", *SHAFT, silent("lost"), until=rank("gap", 6)),
            step(
                ("site: kill exporter", "lost/Motor 1: ok", "site: start exporter"),
                *SHAFT,
                silent("lost"),
                until='ros_diagnostics_exporter_settled{fleet="shaft"} == 1'
                ' and min_over_time(ros_diagnostics_exporter_settled{fleet="shaft"}[30s]) == 0',
            ),
            step("lost: resume", SHAFT[0], until=rank("lost", 0)),
            step("gap/Motor 1: ok", until=rank("gap", 0)),
        ),
    ),
    Scenario(
        "twenty faults are twenty alerts; one component of many robots and half a fleet are one",
        ("yard", *EAST, *WEST),
        (
            step(BEGIN, until='count(robot:ros_diagnostics_state:rank{fleet="yard"} == 0) == 50'),
            step(
                tuple(f"{robot}/{part}: error" for robot, part in TWENTY_FAULTS),
                *(critical(robot, part) for robot, part in TWENTY_FAULTS),
            ),
            step(tuple(f"{robot}/{part}: ok" for robot, part in TWENTY_FAULTS)),
            step(_all(MANY_MOTORS, "error"), "CommonCause Motor"),
            step(_all(MANY_MOTORS, "ok")),
            step(_all(EAST, "hang"), "FleetPartDown east"),
            step(_all(EAST, "resume")),
        ),
    ),
)
