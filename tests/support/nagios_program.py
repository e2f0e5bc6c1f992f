"""The distribution's Nagios 4, with all of its files in one folder."""

import getpass
import grp
import os
import re
import shutil
from collections.abc import Mapping
from pathlib import Path

from testbed.processes import Process

# Debian installs it to /usr/sbin, which is not in every PATH.
PROGRAM = shutil.which("nagios4", path=f"{os.environ['PATH']}:/usr/sbin")

# Its own files, in a folder.
FILES = """\
object_cache_file={folder}/objects.cache
precached_object_file={folder}/objects.precache
status_file={folder}/status.dat
log_file={folder}/nagios.log
lock_file={folder}/nagios.lock
temp_file={folder}/nagios.tmp
temp_path={folder}
check_result_path={folder}
query_socket={folder}/nagios.qh
command_file={folder}/nagios.cmd
state_retention_file={folder}/retention.dat
nagios_user={user}
nagios_group={group}
"""
# Seconds in place of minutes.
QUICK = """\
interval_length=1
check_for_updates=0
use_syslog=0
"""

ALWAYS = """\
define timeperiod {
  timeperiod_name always
  alias always
  monday 00:00-24:00
  tuesday 00:00-24:00
  wednesday 00:00-24:00
  thursday 00:00-24:00
  friday 00:00-24:00
  saturday 00:00-24:00
  sunday 00:00-24:00
}
"""


def installed() -> str:
    """The program."""
    assert PROGRAM, "nagios4 is not installed; ./run test --all installs it (nagios4-core)"
    return PROGRAM


def files(folder: Path) -> str:
    """The lines of nagios.cfg by which all files are in the folder, and of who runs the tests."""
    group = grp.getgrgid(os.getgid()).gr_name
    return FILES.format(folder=folder, user=getpass.getuser(), group=group)


def prepare(
    folder: Path, objects: str, settings: str = "", environment: Mapping[str, str] | None = None
) -> Process:
    """Write the configuration to ``folder``, which it makes; the program is not started.

    Args:
        folder: For configuration, log and all other files: `nagios.log`, `nagios.cmd`, ...
        objects: The object definitions.
        settings: Lines of nagios.cfg beside the names of files.
        environment: Of the program; by default only its time zone, UTC.
    """
    program = installed()
    folder.mkdir(parents=True)
    own = f"cfg_file={folder}/objects.cfg\nstatus_update_interval=1\nlog_rotation_method=n\n"
    (folder / "nagios.cfg").write_text(own + files(folder) + QUICK + settings)
    (folder / "objects.cfg").write_text(objects)
    argv = [program, folder / "nagios.cfg"]
    return Process("nagios", argv, environment or {"TZ": "UTC"}, folder / "out.log")


def service(folder: Path, host: str, name: str) -> dict[str, str]:
    """A service as Nagios' status file has it; empty before its first check."""
    path = folder / "status.dat"
    text = path.read_text() if path.exists() else ""
    for block in re.findall(r"servicestatus \{(.*?)\n\t\}", text, re.DOTALL):
        fields = dict(line.strip().partition("=")[::2] for line in block.splitlines())
        about = (fields.get("host_name"), fields.get("service_description"))
        if about == (host, name) and fields["has_been_checked"] == "1":
            return fields
    return {}
