"""Forged diagnostics, as SECURITY.md describes them: accepted, and visible in the metrics."""

from ros_diagnostics_exporter.model import Level, Status
from support.exposition import value
from support.ros_publisher import publisher
from testbed.polling import until

TOPIC = "/robot_1/diagnostics_agg"
ALL_IS_WELL = (
    Status(Level.OK, "/Motor", "OK", values=(("Motor 2", "OK"),)),
    Status(Level.OK, "/Motor/Motor 2", "all is well", "mc-02"),
)


def test_a_second_publisher_that_denies_a_fault_is_visible_and_does_not_resolve_it(site):
    exporter = site.serve()
    site.start_robots(1)
    motor = {"robot": "robot_1", "component": "Motor 2"}

    def becomes(wanted: float, name: str, **labels: str) -> None:
        until(
            lambda: value(site.address, name, **labels) == wanted,
            lambda: f"{name} {wanted}, is {value(site.address, name, **labels)}",
        )

    exporter.wait_for_output("serving fleet")
    until(lambda: value(site.address, "robot_publishers", robot="robot_1"), exporter.describe)
    site.fault("robot_1", "Motor 2", "error")
    becomes(2, "component_level", **motor)
    honest = value(site.address, "robot_publishers", robot="robot_1")
    changes = value(site.address, "component_changes_total", **motor)
    with publisher(site.domain_id) as forger:
        forger.offer(TOPIC)
        forger.wait_for_listeners()
        becomes(honest + 1, "robot_publishers", robot="robot_1")
        forger.send(TOPIC, *ALL_IS_WELL)
        # The robot keeps sending ERROR once a second: to OK and back are two changes.
        until(
            lambda: (value(site.address, "component_changes_total", **motor) or 0) >= changes + 2,
            lambda: f"two changes, are {value(site.address, 'component_changes_total', **motor)}",
        )
        assert (value(site.address, "component_flap_ratio", **motor) or 0) > 0
        becomes(2, "component_level", **motor)
    becomes(honest, "robot_publishers", robot="robot_1")
