"""A Nagios operator keeps Nagios: the plug-in of docs/deployment.md, Nagios' mail and its log."""

from pathlib import Path

import pytest

from support.nagios_program import ALWAYS, FILES, QUICK
from support.newcomer import Newcomer, blocks, newcomer

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1800)]

FLEET = """\
fleet: hall
profiles:
  default:
    stale_after: 5s
    checks: {motors: {match: [Motor], expect: 3}}
discovery:
  - {topic: "/{robot}/diagnostics_agg"}
"""
# What the operator has: mails by the machine's own server.
SETTINGS = "cfg_file=/etc/nagios4/site.cfg\nenable_notifications=1\n"
SITE = """\
define command {
  command_name alive
  command_line /bin/true
}
define command {
  command_name mail
  command_line printf 'Subject: $NOTIFICATIONTYPE$ $HOSTNAME$/$SERVICEDESC$\\n\\n%s\\n' \\
    '$SERVICEOUTPUT$' | curl --silent smtp://localhost:25 --mail-from nagios@localhost \\
    --mail-rcpt ops@localhost --upload-file -
}
define contact {
  contact_name ops
  host_notifications_enabled 0
  host_notification_period always
  service_notification_period always
  service_notification_options w,u,c,r
  host_notification_commands mail
  service_notification_commands mail
}
define host {
  host_name robot_1
  address robot_1
  check_command alive
  max_check_attempts 1
  check_interval 60
  contacts ops
}
define service {
  name generic-service
  register 0
  max_check_attempts 2
  check_interval 2
  retry_interval 2
  notification_interval 0
  check_period always
  notification_period always
  contacts ops
}
"""


def has_nagios(person: Newcomer, objects: str) -> None:
    folder = person.home / "nagios"
    folder.mkdir()
    etc = person.folder / "etc" / "nagios4"
    etc.mkdir(exist_ok=True)
    (etc / "site.cfg").write_text(ALWAYS + SITE + objects)
    files = FILES.format(folder=folder, user="root", group="root")
    (etc / "site-nagios.cfg").write_text(SETTINGS + QUICK + files)
    person.starts("nagios", "exec nagios4 /etc/nagios4/site-nagios.cfg")


def test_the_first_fault_is_mailed_by_nagios(tmp_path: Path):
    with newcomer(tmp_path) as person:
        person.has_a_mail_server()
        person.does(blocks("docs/deployment.md", "## Install")[0], 1200)
        person.does("/opt/ros-diagnostics-exporter/bin/pip install ./sim", 600)
        config = tmp_path / "etc" / "ros-diagnostics-exporter"
        config.mkdir()
        (config / "fleet.yml").write_text(FLEET)
        bin_ = Path("/opt/ros-diagnostics-exporter/bin")
        person.starts_unit(bin_, person.home)
        person.starts("robots", f"exec {bin_}/virtual-robots --robots 1")
        person.until_output(f"{bin_}/ros-diagnostics status", "robot_1 is OK")
        (objects,) = blocks("docs/deployment.md", "## Nagios")
        has_nagios(person, objects.replace("http://exporter:9877", "http://localhost:9877"))
        status = "cat ~/nagios/status.dat"
        person.until_output(status, "plugin_output=OK - OK sensor.s. list: /Motor/Motor 1")
        person.until_output(status, "performance_data=critical=0;;;0 stale=0;;;0 warning=0")

        person.does(f"{bin_}/virtual-robots fault robot_1 'Motor 1' error --message 'Over current'")
        person.until_mail("PROBLEM robot_1/Motors")
        (mail,) = person.mails()
        assert "Over current" in mail.get_content()
        person.does(f"{bin_}/virtual-robots fault robot_1 'Motor 1' ok")
        person.until_mail("RECOVERY robot_1/Motors")
        # Of its own log the comparison reads both; without an Alertmanager nobody is notified here.
        compare = f"{bin_}/ros-diagnostics nagios compare ~/nagios/nagios.log"
        person.until_output(compare, "0 the same, 2 only in Nagios, 0 only here")
