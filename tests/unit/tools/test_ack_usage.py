from __future__ import annotations

import os
import subprocess
import sys

import pytest

from ros_diagnostics_tools.commands.ack import main


@pytest.mark.parametrize("days", ["-1", "0", "nan", "1e9", "long"])
def test_an_invalid_number_of_days_is_rejected(days, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["robot_1", "--comment", "on it", "--days", days])
    assert ended.value.code == 2
    assert f"'{days}' is not a number of days, at most 3650" in capsys.readouterr().err


NAMES = ("LOGNAME", "USER", "LNAME", "USERNAME")
WITHOUT_ENTRY = """
import os, pwd, sys
from ros_diagnostics_tools.commands.ack import main
if os.geteuid() == 0:
    os.setresuid(54321, 0, 0)  # the effective one stays, so that all files can still be read
else:
    def getpwuid(uid):
        raise KeyError(f"getpwuid(): uid not found: {uid}")
    pwd.getpwuid = getpwuid
sys.exit(main())
"""


def run_without_passwd_entry(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run the command as a UID without an entry in passwd; only root can switch to one."""
    environment = {name: value for name, value in os.environ.items() if name not in NAMES}
    return subprocess.run(
        [sys.executable, "-c", WITHOUT_ENTRY, *arguments],
        env=environment,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


def test_help_and_list_work_without_a_user_name():
    done = run_without_passwd_entry("--help")
    assert (done.returncode, done.stderr) == (0, "")
    assert "--author" in done.stdout
    done = run_without_passwd_entry("--list", "--url", "http://127.0.0.1:1")
    assert done.returncode == 1
    assert done.stderr.startswith("ros-diagnostics-ack: http://127.0.0.1:1/")


def test_an_acknowledgement_without_a_user_name_asks_for_author():
    done = run_without_passwd_entry("robot_1", "--comment", "on it")
    assert done.returncode == 2
    assert "give your name with --author" in done.stderr
    done = run_without_passwd_entry(
        "robot_1", "--comment", "on it", "--author", "me", "-u", "http://[::1]:1"
    )
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
