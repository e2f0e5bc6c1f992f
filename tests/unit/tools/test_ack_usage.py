from __future__ import annotations

import os
import subprocess
import sys

import pytest

from ros_diagnostics_tools.main import main


@pytest.mark.parametrize("lasts", ["-1d", "0d", "nan", "999999d", "long"])
def test_an_invalid_duration_is_rejected(lasts, capsys):
    assert main(["ack", "robot_1", "--comment", "on it", f"--for={lasts}"]) == 2
    assert f"'{lasts}' is not a duration such as" in capsys.readouterr().err


NAMES = ("LOGNAME", "USER", "LNAME", "USERNAME")
WITHOUT_ENTRY = """
import os, pwd, sys
from ros_diagnostics_tools.main import main
if os.geteuid() == 0:
    os.setresuid(54321, 0, 0)  # the effective one stays, so that all files can still be read
else:
    def getpwuid(uid):
        raise KeyError(f"getpwuid(): uid not found: {uid}")
    pwd.getpwuid = getpwuid
sys.exit(main(["ack", *sys.argv[1:]]))
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
    done = run_without_passwd_entry("--list", "--alertmanager", "http://127.0.0.1:1")
    assert done.returncode == 3
    assert done.stderr.startswith("ros-diagnostics: http://127.0.0.1:1/")


def test_an_acknowledgement_without_a_user_name_asks_for_author():
    done = run_without_passwd_entry("robot_1", "--comment", "on it")
    assert done.returncode == 2
    assert "give your name with --author" in done.stderr
    done = run_without_passwd_entry(
        "robot_1", "--comment", "on it", "--author", "me", "--alertmanager", "http://[::1]:1"
    )
    assert done.returncode == 3
    assert "Traceback" not in done.stderr
