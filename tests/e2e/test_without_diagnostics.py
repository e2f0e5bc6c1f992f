"""A robot without diagnostics, from its topics to the mails: its battery, its log, its end."""

import sys

import pytest

from support.mailbox import wait_for_mail
from support.replaced import replace_text
from testbed.site import Site

FLEET = """
fleet: hall
robots: [{{name: amr_1, namespace: /amr_1, domain_id: {domain}, source: {source}}}]
profiles:
  default:
    confirm_after: 3s
    stale_after: 5s
    graph: {{watch: {{logs: true, log_faults: "*avoided*", log_ends_after: 10s}}}}
    topics: [{{topic: battery_state, component: Battery, fields: {{percentage: Charge}}}}]
    values:
      - {{component: Battery, scale: 100, unit: "%", thresholds: {{low: {{critical: 15}}}}}}
faults: {{restart_grace: 1s}}
"""
ROBOT = """
import sys
from pathlib import Path

import rclpy
from sensor_msgs.msg import BatteryState

charge = Path(sys.argv[1])
rclpy.init()
node = rclpy.create_node("driver", namespace="/amr_1")
battery = node.create_publisher(BatteryState, "battery_state", 10)

def work():
    percentage = float(charge.read_text())
    battery.publish(BatteryState(percentage=percentage))
    if percentage < 0.5:
        node.get_logger().error("collision avoided")

node.create_timer(1.0, work)
rclpy.spin(node)
"""


@pytest.mark.parametrize("source", ["auto", "none"])
def test_its_battery_and_its_log_are_mails_and_recoveries_and_so_is_its_silence(
    site: Site, source: str
):
    charge = site.write("charge", "0.1")
    site.start_mail_server()
    fleet = site.write("fleet.yml", FLEET.format(domain=site.domain_id, source=source))
    site.start_exporter(fleet)
    site.start_prometheus(interval=1, tenth=True)
    site.start_alertmanager(edit=lambda it: it["route"].update(group_interval="1s"))
    argv = [sys.executable, str(site.write("robot.py", ROBOT)), str(charge)]
    robot = site.start_program("robot", argv, domain_id=site.domain_id)
    site.wait_until_ready()

    wait_for_mail(site.inbox, "PROBLEM", "amr_1", "Battery")
    wait_for_mail(site.inbox, "PROBLEM", "amr_1", "log driver")
    assert not any("nothing was ever received" in f"{each}" for each in site.inbox.mails())
    replace_text(charge, "0.8")
    wait_for_mail(site.inbox, "RECOVERY", "amr_1", "Battery")
    wait_for_mail(site.inbox, "RECOVERY", "amr_1", "log driver")
    robot.process.stop()
    wait_for_mail(site.inbox, "PROBLEM", "amr_1", "SILENT")
