"""Alertmanager's mail about a fault, with what the robot published around its begin."""

import sys
from contextlib import closing
from pathlib import Path

import pytest

from ros_diagnostics_tools.backtest.recordings import Recordings, RecordingSource
from support.alerts import reload
from testbed import short_clocks


@pytest.mark.slow
def test_a_mail_about_a_fault_carries_its_recording_and_its_recovery_none(
    stack, tmp_path, free_port, start_process, wait_for_mails
):
    port = free_port()
    program = Path(sys.executable).with_name("ros-diagnostics")
    addresses = ["--listen", f"127.0.0.1:{port}", "--smarthost", stack.addresses.smtp]
    url = f"http://{stack.addresses.exporter}"
    relay = start_process("relay", [program, "mail-relay", *addresses, "--url", url])
    relay.wait_for_output("listening on")
    path = tmp_path / "alertmanager" / "alertmanager.yml"
    to_relay = {"smtp_smarthost": f"127.0.0.1:{port}"}
    short_clocks.edit(path, lambda config: config["global"].update(to_relay))
    reload(stack.addresses.alertmanager)

    stack.fault("robot_2", "Motor 2", "error", "winding at 131 C")
    wait_for_mails(1)
    stack.fault("robot_2", "Motor 2", "ok")
    wait_for_mails(2)

    problem, recovery = stack.inbox.mails()
    assert "winding at 131 C" in problem.text
    assert f"{problem.text.splitlines()[0]}</h1>" in problem.html
    ((name, content),) = problem.files.items()
    assert name.removesuffix(".mcap") in problem.text  # in the link to its page
    (tmp_path / name).write_bytes(content)
    with closing(Recordings([RecordingSource(tmp_path / name)])) as recordings:
        arrays = [message.decode() for message in recordings.messages()]
    assert any(
        status.message == "winding at 131 C" for array in arrays for status in array.statuses
    )
    assert (recovery.subject.startswith("** RECOVERY"), recovery.files) == (True, {})
