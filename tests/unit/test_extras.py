"""Without a library of an extra, a sentence names the command that installs it."""

import shlex
import sys

import pytest

from ros_diagnostics_exporter.extras import EXTRAS, install_command
from ros_diagnostics_tools.backtest.formats import RecordingError
from ros_diagnostics_tools.backtest.recordings import Recordings, RecordingSource
from ros_diagnostics_tools.main import main
from support.bags import every_second, write_ros1
from support.called import called
from testbed.configuration import CHECKOUT
from virtual_robots import cli


def extras(project):
    tomllib = pytest.importorskip("tomllib", reason="needs Python 3.11")
    return tomllib.loads((CHECKOUT / project).read_text())["project"]["optional-dependencies"]


def test_they_are_those_of_the_packages():
    ours = {name: tuple(wanted) for name, wanted in extras("pyproject.toml").items()}
    assert ours.pop("demo")  # needs a checkout, in which ./run installs it
    assert ours == EXTRAS
    theirs = {name: tuple(wanted) for name, wanted in extras("sim/pyproject.toml").items()}
    assert theirs == cli.EXTRAS


def test_pip_accepts_the_command_and_needs_no_index_that_has_this_package():
    command = [*shlex.split(install_command("mail")), "--dry-run", "--no-index"]
    assert "already satisfied: aiosmtpd" in called(command, timeout=60).stdout


def test_the_mail_relay_names_it(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "aiosmtpd.controller", None)
    assert main(["mail-relay"]) == 1
    assert capsys.readouterr().err == (
        f"ros-diagnostics: mail-relay needs aiosmtpd: {install_command('mail')}\n"
    )


def test_bags_of_ros_1_name_it(tmp_path, monkeypatch):
    bag = write_ros1(tmp_path / "one.bag", every_second(range(3), {"motor": []}))
    monkeypatch.setitem(sys.modules, "rosbags.rosbag1", None)
    with pytest.raises(RecordingError) as raised:
        Recordings([RecordingSource(bag)])
    assert str(raised.value).endswith(f"): {install_command('backtest')}")
