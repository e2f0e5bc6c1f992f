"""A newcomer's empty machine: the documentation's commands run as they are written.

Network and folders of its own (Linux namespaces): the documented ports and paths (`localhost:9090`,
`/etc`, `/opt`, the home folder) are free there, whatever else runs on this machine, and nothing is
left behind. A copy of the checkout is the folder in which the commands run.
"""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from email import message_from_bytes, policy
from email.message import EmailMessage
from pathlib import Path

import pytest

from support import subnets
from support.called import called
from testbed.configuration import CHECKOUT
from testbed.polling import until
from testbed.processes import Process

IGNORED = shutil.ignore_patterns(
    *(".git", ".venv*", ".hypothesis", "__pycache__", ".*_cache", "data", "dist")
)
# Brings up the loopback device (ioctl of netdevice(7)), mounts, and waits.
START = """
python3 - <<'END'
import fcntl, socket, struct
with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any:
    fcntl.ioctl(any, 0x8914, struct.pack("16sh14x", b"lo", 1))
END
mount --bind "$0/etc" /etc
mount --bind "$0/opt" /opt
mount --bind "$0/lib" /var/lib
echo ready
exec sleep infinity
"""


def blocks(page: str, heading: str) -> list[str]:
    """The code blocks of a page of the documentation below a heading, up to the next one."""
    found: list[str] = []
    here, is_code = False, False
    for line in (CHECKOUT / page).read_text().splitlines(keepends=True):
        if line.startswith("```"):
            is_code = not is_code
            if here and is_code:
                found.append("")
        elif is_code:
            if here:
                found[-1] += line
        elif line.startswith("#"):
            here = line.strip() == heading
    assert found, f"{page} has no code below {heading!r}"
    return found


class Newcomer:
    """Somebody who follows the documentation on a machine of their own."""

    def __init__(self, folder: Path, ending: ExitStack) -> None:
        self.home = folder / "home"
        self.checkout = folder / "home" / "checkout"
        self.folder = folder
        self._ending = ending
        self._user = [] if os.geteuid() == 0 else ["--map-root-user"]
        self._holder: Process | None = None
        self._number = 0

    def start(self) -> None:
        """Make the machine."""
        shutil.copytree(CHECKOUT, self.checkout, ignore=IGNORED, symlinks=True)
        (self.folder / "opt").mkdir()
        (self.folder / "lib").mkdir()
        # Without what only root may read.
        subprocess.run(["cp", "-a", "/etc", self.folder], stderr=subprocess.DEVNULL, check=False)
        (self.folder / "bin").mkdir()
        self._add_program("python3", str(Path(sys.executable).resolve()))
        found = shutil.which("alertmanager") or shutil.which("prometheus-alertmanager")
        for name in ("alertmanager", "prometheus-alertmanager"):  # Debian calls it by the second
            self._add_program(name, found or name)
        argv = ["unshare", *self._user, "--net", "--mount", "--", "sh", "-ec", START]
        self._holder = self._process("machine", [*argv, str(self.folder)])
        self._holder.wait_for_output("ready", 30)

    def _add_program(self, name: str, path: str) -> None:
        (self.folder / "bin" / name).symlink_to(path)

    def _environment(self) -> dict[str, str]:
        own = str(Path(sys.executable).parent)  # what the tests have installed is not there
        paths = [each for each in os.environ["PATH"].split(":") if each != own]
        kept = {name: os.environ[name] for name in ("LANG", "TERM", "TZ") if name in os.environ}
        pip = {name: value for name, value in os.environ.items() if name.startswith("PIP_")}
        cache = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "pip"
        return {
            **kept,
            "PIP_CACHE_DIR": str(cache),
            **pip,
            "HOME": str(self.home),
            "PATH": ":".join([str(self.folder / "bin"), *paths, "/usr/sbin"]),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",  # the only network there
            "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4",
        }

    def _process(self, name: str, argv: list[str]) -> Process:
        self._number += 1
        log = self.folder / f"{name}-{self._number}.log"
        process = Process(name, argv, self._environment(), log)
        self._ending.callback(process.stop)
        process.start()
        return process

    def _argv(self, script: str, *, online: bool) -> list[str]:
        assert self._holder is not None
        assert self._holder.alive, self._holder.describe()
        into = ["--user", "--preserve-credentials"] if self._user else []
        network = [] if online else ["--net"]
        enter = ["nsenter", "--target", str(self._holder.pid), *into, "--mount", *network, "--"]
        return [*enter, "bash", "-euo", "pipefail", "-c", f"cd {self.checkout}\n{script}"]

    def does(self, script: str, seconds: float = 60.0) -> str:
        """Run commands in the checkout until they end; their output. Only pip has the internet."""
        argv = self._argv(script, online="pip " in script)
        process = self._process("command", argv)
        until(lambda: not process.alive, process.describe, seconds, every=0.1)
        assert process.exit_code == 0, f"{script}\n{process.describe(40)}"
        return process.output()

    def starts(self, name: str, script: str) -> Process:
        """Run commands of which the last is a server, in a terminal of their own."""
        return self._process(name, self._argv(script, online=False))

    def starts_unit(self, commands: Path, state: Path) -> Process:
        """Start the exporter by the line of its systemd unit, as systemd reads it.

        Args:
            commands: The folder in which the exporter is installed.
            state: The folder for its state.
        """
        unit = (self.checkout / "packaging" / "ros-diagnostics-exporter.service").read_text()
        line = re.search(
            r"^ExecStart=(\S+)/ros-diagnostics-exporter((?:.*\\\n)*.*)$", unit, re.MULTILINE
        )
        default = re.search(r"^EnvironmentFile=-(.*)$", unit, re.MULTILINE)
        assert line
        assert default
        arguments = line[2].replace("\\\n", " ")
        return self.starts(
            "exporter",
            f"set -a; ARGS=; test ! -e {default[1]} || . {default[1]}; set +a\n"
            f"export STATE_DIRECTORY={state}\n"
            f"exec {commands}/ros-diagnostics-exporter {arguments}",
        )

    def until_output(self, script: str, pattern: str, seconds: float = 60.0) -> None:
        """Repeat a command until its output has the pattern."""
        output = ""

        def found() -> bool:
            nonlocal output
            argv = self._argv(script, online=False)
            done = called(argv, code=None, env=self._environment(), timeout=60)
            output = done.stdout + done.stderr
            return re.search(pattern, output) is not None

        until(found, lambda: f"{pattern!r} from {script!r}: {output}", seconds, every=0.5)

    def has_a_mail_server(self) -> None:
        """Start the machine's mail server at port 25, as the documentation assumes."""
        mails = self.folder / "mails"
        server = f"{sys.executable} -m aiosmtpd -n -c aiosmtpd.handlers.Mailbox {mails}"
        self.starts("mail-server", f"exec {server} -l localhost:25")
        self.until_output(f"python3 -c '{_SMTP}'", "220")

    def mails(self) -> list[EmailMessage]:
        """The mails that came."""
        found = sorted((self.folder / "mails" / "new").glob("*"))
        parsed = (message_from_bytes(each.read_bytes(), policy=policy.default) for each in found)
        return [each for each in parsed if isinstance(each, EmailMessage)]  # all are

    def subjects(self) -> list[str]:
        """Of the mails that came."""
        return [str(each["Subject"]) for each in self.mails()]

    def until_mail(self, subject: str, seconds: float = 90.0) -> None:
        """Wait for a mail with this subject."""
        until(lambda: subject in self.subjects(), lambda: f"{subject}: {self.subjects()}", seconds)


_SMTP = 'import socket; print(socket.create_connection(("localhost", 25), 5).recv(99))'


@contextmanager
def newcomer(folder: Path) -> Iterator[Newcomer]:
    """A machine in ``folder`` that ends with the context."""
    if why := subnets.missing():
        pytest.skip(why)
    with ExitStack() as ending:
        found = Newcomer(folder, ending)
        found.start()
        yield found
