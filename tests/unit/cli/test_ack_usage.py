from __future__ import annotations

import os
import subprocess
import sys

import pytest

from ros_diagnostics_exporter.cli.ack import main


@pytest.mark.parametrize("days", ["-1", "0", "nan", "1e9", "long"])
def test_a_number_of_days_that_no_silence_can_last_is_refused(days, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["robot_1", "--comment", "on it", "--days", days])
    assert ended.value.code == 2
    assert f"'{days}' is not a number of days, at most 3650" in capsys.readouterr().err


NAMES = ("LOGNAME", "USER", "LNAME", "USERNAME")
WITHOUT_ENTRY = """
import os, pwd, sys
from ros_diagnostics_exporter.cli.ack import main
if os.geteuid() == 0:
    os.setresuid(54321, 0, 0)  # the effective one stays, so that all files can still be read
else:
    def getpwuid(uid):
        raise KeyError(f"getpwuid(): uid not found: {uid}")
    pwd.getpwuid = getpwuid
sys.exit(main())
"""


def as_nobody_known(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run the command as a UID that passwd does not know; only root can become one."""
    environment = {name: value for name, value in os.environ.items() if name not in NAMES}
    return subprocess.run(
        [sys.executable, "-c", WITHOUT_ENTRY, *arguments],
        env=environment,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


def test_help_and_list_need_no_name_of_the_user():
    done = as_nobody_known("--help")
    assert (done.returncode, done.stderr) == (0, "")
    assert "--author" in done.stdout
    done = as_nobody_known("--list", "--url", "http://127.0.0.1:1")
    assert done.returncode == 1
    assert done.stderr.startswith("ros-diagnostics-ack: http://127.0.0.1:1/")


def test_an_acknowledgement_without_a_name_says_how_to_give_one():
    done = as_nobody_known("robot_1", "--comment", "on it")
    assert done.returncode == 2
    assert "say with --author who takes care" in done.stderr
    done = as_nobody_known(
        "robot_1", "--comment", "on it", "--author", "me", "-u", "http://[::1]:1"
    )
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
