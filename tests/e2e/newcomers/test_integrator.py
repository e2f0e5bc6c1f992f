"""An integrator, who knows ROS and not Prometheus, follows docs/first-robot.md to a mail."""

import shlex
from pathlib import Path

import pytest

from support.newcomer import Newcomer, blocks, newcomer

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1800)]


def step(title: str) -> list[str]:
    """The code of a step, without that which is in a list of choices."""
    return blocks("docs/first-robot.md", f"## {title}")


def installs(person: Newcomer) -> None:
    """Steps 3 to 5, with each of the two files."""
    install, _with_own_ros = step("3. Install the exporter")
    (folder,) = step("4. Make a folder of your own")
    in_root, in_namespaces, check, summary = step("5. Describe the robot")
    person.does(f"{install}\n{folder}", 1200)
    for fleet, printed in ((in_root, summary), (in_namespaces, "fleet lab is valid")):
        (person.home / "monitoring" / "fleet.yml").write_text(fleet)
        assert printed in person.does(check)


def starts(person: Newcomer) -> str:
    """Steps 6 to 8 and the virtual robots of step 1; the command that shows the fleet."""
    address, alertmanager = step("6. Start Alertmanager with your address")
    (prometheus,) = step("7. Start Prometheus")
    exporter, status, *_output = step("8. Start the exporter")
    _with_ros, robots = step("1. Find the robot's diagnostics")
    person.does(address)
    for name, script in (
        ("alertmanager", alertmanager),
        ("prometheus", prometheus),
        ("exporter", exporter),
        ("robots", robots),
    ):
        person.starts(name, script)
    person.until_output(status, "3 OK")
    person.until_output("curl -s localhost:9090/-/ready", "Ready")
    settled = "promtool query instant http://localhost:9090 'ros_diagnostics_exporter_settled'"
    person.until_output(settled, "=> 1")
    return status


def test_from_a_checkout_to_the_mail_and_back(tmp_path: Path):
    fault, _shown, _mail, why, _history, repair = step("9. Break something")
    with newcomer(tmp_path) as person:
        person.has_a_mail_server()
        installs(person)
        status = starts(person)

        person.does(fault)
        person.until_output(status, "CRITICAL")
        person.until_mail("** PROBLEM ** lab/robot_3 Motor 2 is CRITICAL")
        person.until_output(why, "notification sent to email")
        person.does(repair)
        person.until_mail("** RECOVERY ** lab/robot_3 Motor 2 is no longer CRITICAL")
        (mail,) = (each for each in person.mails() if "PROBLEM" in each["Subject"])
        assert mail["To"] == "you@example.org"
        text = mail.get_body(("plain",)).get_content()
        runbook = next(line for line in text.splitlines() if line.startswith("Runbook:"))
        page = person.does(f"curl --fail --silent {shlex.quote(runbook.split()[1])}")
        assert "<h1>RosDiagnosticsComponentCritical</h1>" in page
        assert "ros-diagnostics why robot_3" in page
