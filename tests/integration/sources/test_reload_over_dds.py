"""fleet.yml and robots.d change under a running exporter, on real DDS."""

from __future__ import annotations

import threading

import pytest

from ros_diagnostics_exporter.config.errors import ConfigError
from ros_diagnostics_exporter.config.load import load
from ros_diagnostics_exporter.model import Status
from testbed.polling import until

pytestmark = pytest.mark.integration

HOT, COOL = Status(2, "Motor", "Hot"), Status(0, "Motor", "OK")
RELEVANT = (
    "component_level",
    "component_since_timestamp_seconds",
    "component_problem_since_timestamp_seconds",
    "component_changes_total",
)


def fleet_file(path, domain_id: int, *names: str) -> None:
    robots = "".join(
        f"  - {{name: {name}, domain_id: {domain_id}, topic: /{name}/diagnostics, source: raw}}\n"
        for name in names
    )
    path.write_text(f"fleet: f\nrobots:\n{robots}")


def test_robots_come_and_go_by_files_while_a_fault_is_on(
    ros_domain, robots, run_exporter, tmp_path, caplog
):
    path = tmp_path / "fleet.yml"
    fleet_file(path, ros_domain, "faulty", "leaving")
    running = run_exporter(load(path))
    for name in ("faulty", "coming", "dropped_in"):
        robots.offer(f"/{name}/diagnostics")
    until(lambda: robots.listeners("/faulty/diagnostics"), "the faulty robot's topic is subscribed")

    stop = threading.Event()
    sent = []

    def keep_sending() -> None:
        while not stop.wait(0.05):
            for name in ("faulty", "coming", "dropped_in"):
                robots.send(f"/{name}/diagnostics", HOT)
            sent.append(1)

    sender = threading.Thread(target=keep_sending)
    sender.start()
    try:
        running.wait_for("component_level", 2, robot="faulty")
        before = {name: running.sample(name, robot="faulty") for name in RELEVANT}

        fleet_file(path, ros_domain, "faulty", "coming")
        running.wait_for("component_level", 2, robot="coming")
        assert running.sample("robot_up", robot="leaving") is None

        folder = tmp_path / "robots.d"
        folder.mkdir()
        (folder / "dropped_in.yml").write_text(
            f"name: dropped_in\ndomain_id: {ros_domain}\n"
            "topic: /dropped_in/diagnostics\nsource: raw\n"
        )
        running.wait_for("component_level", 2, robot="dropped_in")

        path.write_text("fleet: f\nrobots: nonsense\n")
        running.wait_for("exporter_config_last_reload_successful", 0)
        assert running.sample("component_level", robot="coming") == 2
        with pytest.raises(ConfigError):
            running.service.reload()
        assert caplog.text.count("reload failed (POST /-/reload); keeping the previous") == 1

        fleet_file(path, ros_domain, "faulty")
        running.wait_for("exporter_config_last_reload_successful", 1)
        running.wait_for("robot_up", None, robot="coming")

        after = {name: running.sample(name, robot="faulty") for name in RELEVANT}
        assert after == before
    finally:
        stop.set()
        sender.join()
    until(
        lambda: running.sample("robot_messages_total", robot="faulty") == len(sent),
        lambda: f"no message missed of {len(sent)}: {running.samples('robot_messages_total')}",
    )
