"""Scenarios of one robot's components and values.

They break different components, so that no common cause fires.
"""

from e2e.rule_scenarios.scenario import BEGIN, Scenario, critical, in_trouble, rank, step, warning

WORSENS = (warning("worsens", "Motor 1"), critical("worsens", "Motor 1"))
FLAPS = "ComponentFlapping flaps {}".format
TWO_FLAP = (FLAPS("Sensor 1"), FLAPS("Sensor 2"))
TENDER = "Value{} tender {} {}".format
LOW = TENDER("Warning", "Main Battery", "Charge")
EMPTY = TENDER("Critical", "Main Battery", "Charge")
HOT = TENDER("Warning", "Motor", "Temperature (°C)")
BURNING = TENDER("Critical", "Motor", "Temperature (°C)")

COMPONENTS = (
    Scenario(
        "0-1-2-1-0: CRITICAL at once after a confirmed WARNING, which goes on under it",
        ("worsens",),
        (
            step(BEGIN, until=rank("worsens", 0)),
            step("worsens/Motor 1: warn", WORSENS[0]),
            step("worsens/Motor 1: error", *WORSENS),
            step("worsens/Motor 1: warn", WORSENS[0], until=rank("worsens", 1)),
            step("worsens/Motor 1: ok", until=rank("worsens", 0)),
        ),
        ranks={"worsens": (0, 1, 6, 1, 0)},
    ),
    Scenario(
        "a component that no longer reports is STALE until it does",
        ("dozes",),
        (
            step(BEGIN, until=rank("dozes", 0)),
            step("dozes/Cam 1: silent", "ComponentStale dozes Cam 1"),
            step("dozes/Cam 1: ok", until=rank("dozes", 0)),
        ),
        ranks={"dozes": (0, 2, 0)},
    ),
    Scenario(
        "a fault that ends before its component's own confirm_after fires no alert",
        ("patient",),
        (
            step(BEGIN, until=rank("patient", 0)),
            step(
                ("patient/Sensor 1: error", "patient/Sensor 2: error"),
                critical("patient", "Sensor 1"),
                until=in_trouble("patient", 2),
            ),
            step(("patient/Sensor 1: ok", "patient/Sensor 2: ok"), until=rank("patient", 0)),
        ),
        ranks={"patient": (0, 6, 0)},
    ),
    Scenario(
        "STALE is CRITICAL where fleet.yml says so, and nothing where it is planned",
        ("strict",),
        (
            step(BEGIN, until=rank("strict", 0)),
            step(
                ("strict/Laser 1: silent", "strict/Cam 1: silent"),
                critical("strict", "Laser 1"),
                "ComponentStale strict Laser 1",
                until=in_trouble("strict", 2),
            ),
            step("strict/Laser 1: ok", until=rank("strict", 0)),
        ),
        ranks={"strict": (0, 6, 0)},
    ),
    Scenario(
        "flapping fires one alert; a fault that is left when it ends fires then",
        ("flaps",),
        (
            step(BEGIN, until=rank("flaps", 0)),
            step(("flaps/Sensor 1: flap", "flaps/Sensor 2: flap"), *TWO_FLAP),
            step(
                ("flaps/Sensor 1: ok", "flaps/Sensor 2: error"),
                critical("flaps", "Sensor 2"),
                until=rank("flaps", 6),
            ),
            step("flaps/Sensor 2: ok", until=rank("flaps", 0)),
        ),
    ),
    Scenario(
        "a fault that comes and goes between scrapes, again and again, is intermittent",
        ("loose",),
        (
            step(BEGIN),
            step(BEGIN, "ComponentIntermittent loose Laser 1"),
            step(BEGIN, until=rank("loose", 0)),
        ),
    ),
    Scenario(
        "a check that finds too few components, or none, fires until they are there",
        ("short",),
        (
            step(BEGIN, "CheckShort short lasers", "CheckShort short cameras"),
            step("site: complete short", until=rank("short", 0)),
        ),
    ),
)
VALUES = (
    Scenario(
        "values beyond the thresholds of fleet.yml fire, and resolve with the hysteresis",
        ("tender",),
        (
            step(BEGIN, until=rank("tender", 0)),
            step(("tender/Main Battery: low", "tender/Motor: hot"), LOW, HOT),
            step(("tender/Main Battery: empty", "tender/Motor: burning"), LOW, EMPTY, HOT, BURNING),
            step(
                ("tender/Main Battery: hovering", "tender/Motor: cool"),
                LOW,
                EMPTY,
                until='count_over_time((ros_diagnostics_component_value{robot="tender",'
                'key="Charge"} > 15 < 15.2)[12s:2s]) >= 6',
            ),
            step("tender/Main Battery: some", LOW),
            step("tender/Main Battery: full"),
        ),
    ),
    Scenario(
        "a battery that falls fast fires before it is low; one that falls slowly does not",
        ("drains",),
        (
            step(
                ("drains/Main Battery: leaking", "drains/Spare Battery: ageing"),
                "ValueFalling drains Main Battery Charge",
            ),
            step("drains/Main Battery: full"),
        ),
    ),
)
