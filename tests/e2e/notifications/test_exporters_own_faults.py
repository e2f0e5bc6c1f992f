"""What is wrong with the exporter itself, from the file on its disk to the mail and back."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from ros_diagnostics_tools.main import main
from testbed.configuration import Clocks
from testbed.http import get_json
from testbed.polling import until
from testbed.site import Site
from testbed.stack import Plan, running

BROKEN = "\nno_such_key: true\n"


@pytest.fixture
def stack(tmp_path: Path) -> Iterator[Site]:
    with running(tmp_path, Plan(robots=1, clocks=Clocks(confirm_after=2))) as stack:
        yield stack


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_a_reload_that_fails_is_one_mail_can_be_acknowledged_and_has_one_recovery(
    stack: Site, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    (config,) = tmp_path.rglob("fleet.yml")
    valid = config.read_text()
    url = ("--alertmanager", f"http://{stack.addresses.alertmanager}")

    def subjects() -> list[str]:
        return [mail.subject for mail in stack.inbox.mails()]

    config.write_text(valid + BROKEN)
    until(subjects, "a mail", 180)
    (mail,) = stack.inbox.mails()
    fleet = get_json(stack.addresses.exporter, "/api/v1/fleet")["fleet"]
    assert mail.subject == f"** PROBLEM ** {fleet} exporter is WARNING: fleet.yml"
    assert "it could not be reloaded" in mail.text
    assert "RosDiagnosticsExporterFault.md" in mail.text

    who = ("--author", "ann", "--comment", "a typo")
    assert main(["ack", "--part", "fleet.yml", *who, *url]) == 0
    assert "fleet.yml of the exporter WARNING" in capsys.readouterr().out

    config.write_text(valid)
    recovery = f"** RECOVERY ** {fleet} exporter is no longer WARNING: fleet.yml"
    until(lambda: len(subjects()) == 2, lambda: str(subjects()), 120)
    assert subjects()[1] == recovery
