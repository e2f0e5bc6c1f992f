"""From what is wrong with the exporter to the operator's inbox, by all real servers."""

import time

import pytest

from ros_diagnostics_tools.main import main
from testbed import http


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_a_reload_that_fails_is_one_mail_can_be_acknowledged_and_has_one_recovery(
    stack, wait_for_mails, capsys
):
    config = stack.exporter.config
    valid = config.read_text()
    config.write_text(f"{valid}\nno_such_key: true\n")
    fleet = http.get_json(stack.addresses.exporter, "/api/v1/fleet")["fleet"]
    problem = f"** PROBLEM ** {fleet} exporter is WARNING: fleet.yml"
    assert wait_for_mails(1, within=180) == [problem]
    (mail,) = stack.inbox.mails()
    assert "it could not be reloaded" in mail.text
    assert "RosDiagnosticsExporterFault.html" in mail.text

    who = ("--author", "ann", "--comment", "a typo")
    url = ("--alertmanager", f"http://{stack.addresses.alertmanager}")
    assert main(["ack", "--part", "fleet.yml", *who, *url]) == 0
    assert "fleet.yml of the exporter WARNING" in capsys.readouterr().out

    config.write_text(valid)
    recovery = f"** RECOVERY ** {fleet} exporter is no longer WARNING: fleet.yml"
    assert wait_for_mails(2, within=120) == [problem, recovery]
    (ended,) = http.get_json(stack.addresses.exporter, "/api/v1/events?kind=fault_ended")["events"]
    at = time.strftime("%Y-%m-%d %H:%M:%S UTC", time.gmtime(ended["time"]))
    assert f" to {at}: " in stack.inbox.mails()[-1].text  # the fault's own end
