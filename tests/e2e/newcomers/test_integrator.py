"""An integrator, who knows ROS and not Prometheus, follows README.md from a checkout to a mail."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest

from support.newcomer import blocks, newcomer

pytestmark = [pytest.mark.e2e, pytest.mark.slow, pytest.mark.timeout(1800)]


def test_from_a_checkout_to_the_mail_and_back(tmp_path: Path):
    fleet, install, exporter, prometheus, alertmanager, robots, fault = blocks(
        "README.md", "## Point it at real robots"
    )
    with newcomer(tmp_path) as person:
        person.has_a_mail_server()
        (person.checkout / "fleet.yml").write_text(fleet)
        assert "fleet warehouse" in person.does(install, 1200)
        for name, script in (
            ("exporter", exporter),
            ("prometheus", prometheus),
            ("alertmanager", alertmanager),
            ("robots", robots),
        ):
            person.starts(name, script)
        activate = exporter.splitlines()[0]
        status = f"{activate}\nCOLUMNS=200 ros-diagnostics status"
        person.until_output(status, "3 OK")
        person.until_output("curl -s localhost:9090/-/ready", "Ready")
        settled = "promtool query instant http://localhost:9090 'ros_diagnostics_exporter_settled'"
        person.until_output(settled, "=> 1")

        person.does(fault)
        person.until_output(status, "CRITICAL")
        person.until_mail("** PROBLEM ** warehouse/robot_1 Motor 1 is CRITICAL")
        person.does(f"{activate}\nvirtual-robots fault robot_1 'Motor 1' ok")
        person.until_mail("** RECOVERY ** warehouse/robot_1 Motor 1 is no longer CRITICAL")
        (mail,) = (each for each in person.mails() if "PROBLEM" in each["Subject"])
        text = mail.get_body(("plain",)).get_content()
        runbook = next(line for line in text.splitlines() if line.startswith("Runbook:"))
        page = person.does(f"curl --fail --silent {shlex.quote(runbook.split()[1])}")
        assert "RosDiagnosticsComponentCritical" in page
