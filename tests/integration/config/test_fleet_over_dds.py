"""The settings of fleet.yml in the metrics of the real command, with virtual robots over DDS."""

from __future__ import annotations

import sys
import urllib.request
from pathlib import Path
from urllib.error import URLError

import pytest
from prometheus_client.parser import text_string_to_metric_families

from testbed.polling import until

pytestmark = pytest.mark.integration

BIN = Path(sys.executable).parent
FLEET = """
fleet: demo
robots:
  - {{name: away, namespace: /away, domain_id: {domain}, address: away.lan}}
discovery:
  - type: diagnostic_msgs/msg/DiagnosticArray
    domain_ids: [{domain}]
    name: "amr_{{robot}}"
    include: "*_robot_*"
    exclude: amr_robot_3
    profile: amr
    address: "{{robot}}.lan"
    labels: {{site: hall, floor: 3}}
profiles:
  default: {{stale_after: 3s, stale_is_critical: true}}
  amr:
    checks: {{motors: {{match: motor, expect: 4}}, cameras: [{{regex: "^/Camera/"}}]}}
    components:
      - {{match: Cam, ignore: true}}
      - {{match: Laser 1, stale_after: 90s, confirm_after: 1m, planned_stale: true}}
    values:
      - key: Level
        metric: ros_battery_charge_ratio
        unit: ratio
        scale: 0.01
        thresholds: {{low: {{critical: 0.1}}}}
maintenance:
  - name: all day
    selector: {{site: hall, robot: "*_1"}}
    comment: never in service
    weekly: [daily 00:00-24:00]
    time_zone: Asia/Tokyo
"""


class Scrape(dict[str, list[tuple[dict[str, str], float]]]):
    """Series by name; a name may leave out the prefix."""

    def __init__(self, address: str) -> None:
        with urllib.request.urlopen(address, timeout=10) as answer:
            text = answer.read().decode()
        for family in text_string_to_metric_families(text):
            for sample in family.samples:
                name = sample.name.removeprefix("ros_diagnostics_")
                self.setdefault(name, []).append((sample.labels, sample.value))

    def values(self, name: str, *by: str, **labels: str) -> dict[tuple[str, ...], float]:
        """The values of the series that have these labels, each by its labels `by`."""
        return {
            tuple(found[label] for label in by): value
            for found, value in self.get(name, ())
            if labels.items() <= found.items()
        }


@pytest.fixture
def scrape(tmp_path, ros_domain, dds_environment, free_port, start_process):
    path = tmp_path / "fleet.yml"
    path.write_text(FLEET.format(domain=ros_domain))
    listen = f"127.0.0.1:{free_port()}"
    exporter = [BIN / "ros-diagnostics-exporter", "--config.file", path]
    options = ["--web.listen-address", listen, "--storage.path", tmp_path / "exporter.db"]
    start_process("exporter", [*exporter, *options], dds_environment)
    robots = [BIN / "virtual-robots", "--robots", "3", "--domain-id", str(ros_domain)]
    start_process("robots", robots, dds_environment)

    def scraped():
        try:
            found = Scrape(f"http://{listen}/metrics")
        except (URLError, ConnectionError):
            return None
        good = found.values("check_components", "robot", check="all", level="ok")
        complete = {("amr_robot_1",): 9.0, ("amr_robot_2",): 9.0, ("away",): 0.0}
        batteries = found.values("ros_battery_charge_ratio", "robot", "component")
        return found if good == complete and len(batteries) == 4 else None

    return until(scraped, "nine components of each of two robots, and their batteries", 60)


def test_fleet_yml_is_what_the_metrics_say(scrape, ros_domain):
    robots = dict.fromkeys([("amr_robot_1",), ("amr_robot_2",)], 1.0)
    assert scrape.values("robot_up", "robot") == {**robots, ("away",): 0.0}
    assert scrape.values("robot_stale_is_critical", "robot") == {**robots, ("away",): 1.0}
    assert scrape.values("robot_stale_after_seconds", "robot", robot="away") == {("away",): 3.0}
    inventory = ("robot", "ros_namespace", "domain_id", "address", "profile", "site", "floor")
    assert scrape.values("robot_info", *inventory, robot="amr_robot_1") == {
        ("amr_robot_1", "/robot_1", str(ros_domain), "amr_robot_1.lan", "amr", "hall", "3"): 1.0
    }
    assert scrape.values("robot_maintenance", "robot") == {
        ("amr_robot_1",): 1.0,
        ("amr_robot_2",): 0.0,
        ("away",): 0.0,
    }

    one = {"robot": "amr_robot_1"}
    assert scrape.values("check_expected_components", "check", **one) == {("motors",): 4.0}
    assert scrape.values("check_components", "check", level="ok", **one) == {
        ("all",): 9.0,
        ("motors",): 3.0,
        ("cameras",): 0.0,
    }
    laser = {"component": "Laser 1", **one}
    assert scrape.values("component_stale_after_seconds", **one) == {(): 90.0}
    assert scrape.values("component_planned_stale", **laser) == {(): 1.0}
    ratios = scrape.values("ros_battery_charge_ratio", "component", **one)
    assert {*ratios} == {("Laptop Battery",), ("Robot Battery",)}
    assert all(0 < ratio <= 1 for ratio in ratios.values())
    assert scrape.values("component_value", "component", key="Level", unit="ratio", **one) == ratios
    assert scrape.values("component_value_threshold", "component", "severity", **one) == {
        ("Laptop Battery", "critical"): 0.1,
        ("Robot Battery", "critical"): 0.1,
    }
