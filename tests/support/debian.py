"""Debian 12 in a folder: made by debootstrap, entered by chroot, or booted with systemd.

A booted one has namespaces of its own (processes, network, mounts, cgroups): the documented ports
and paths are free there, its services do not see this machine's, and nothing is left behind. Its
only network is the loopback device. Needs root.

What is installed comes from where this machine's own packages come from: its Debian mirror, its
settings of apt and pip, its certificates.
"""

import configparser
import fcntl
import os
import re
import shutil
import subprocess
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from support.called import called
from testbed.polling import until
from testbed.processes import Process

SUITE = "bookworm"
PRIVATE = "somebody@private.example.org"  # in the checkout from which packages are built
MIRROR = re.compile(r"^(?:URIs:|deb) .*?(\S+://\S+/debian)/?\s", re.MULTILINE)
PUBLIC_MIRROR = "http://deb.debian.org/debian"
PATH = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"
CERTIFICATES = "/etc/ssl/certs/ca-certificates.crt"
# Only root's folder is mounted over, with pip's cache, so that nothing is downloaded twice.
ENTER = """
set -eu
mount -t proc proc "$ROOT/proc"
if [ -d "$CACHE" ]; then
    mkdir -p "$ROOT/root/.cache/pip"
    mount --bind "$CACHE" "$ROOT/root/.cache/pip"
fi
exec chroot "$ROOT" /bin/bash -euo pipefail -c "$SCRIPT"
"""
# What systemd expects of a container's manager (https://systemd.io/CONTAINER_INTERFACE).
BOOT = """
set -eu
mount --bind "$ROOT" "$ROOT"
mount -t proc proc "$ROOT/proc"
mount -t sysfs -o ro sysfs "$ROOT/sys"
mount -t cgroup2 cgroup2 "$ROOT/sys/fs/cgroup"
for name in run tmp; do mount -t tmpfs -o mode=1777 tmpfs "$ROOT/$name"; done
mount -t tmpfs -o mode=755 tmpfs "$ROOT/dev"
# Made anew: those of this machine are only as good as what root has left of them. Where /dev/null
# is a file, systemd starts no service that has PrivateDevices=yes.
while read -r name major minor; do
    mknod -m 666 "$ROOT/dev/$name" c "$major" "$minor"
done <<END
null 1 3
zero 1 5
full 1 7
random 1 8
urandom 1 9
tty 5 0
END
mkdir "$ROOT/dev/shm" "$ROOT/dev/pts"
mount -t tmpfs tmpfs "$ROOT/dev/shm"
mount -t devpts -o newinstance,ptmxmode=0666 devpts "$ROOT/dev/pts"
ln -s pts/ptmx "$ROOT/dev/ptmx"
cd "$ROOT"
pivot_root . mnt
umount -l /mnt
exec env -i container=tests PATH="$SEARCH" /lib/systemd/systemd --system --log-target=console
"""


def why_not(*programs: str) -> str | None:
    """Why there can be no Debian here, or None; it needs root, debootstrap and ``programs``."""
    if os.geteuid() != 0:
        return "needs root: chroot"
    missing = [name for name in ("debootstrap", *programs) if shutil.which(name) is None]
    return f"not installed: {', '.join(missing)}" if missing else None


def marks(absent: str | None) -> list[pytest.MarkDecorator]:
    """The marks of tests that need a Debian; ``absent`` is why there can be none, or None."""
    return [
        pytest.mark.slow,
        pytest.mark.timeout(2400),
        pytest.mark.skipif(absent is not None, reason=str(absent)),
    ]


def made_once(factory: pytest.TempPathFactory, name: str, make: Callable[[Path], None]) -> Path:
    """The folder ``name`` that ``make`` has filled, once for all workers of this run of pytest."""
    shared = factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        shared = shared.parent
    folder = shared / name
    with (shared / f"{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not folder.exists():
            unfinished = shared / f"{name}.unfinished"
            shutil.rmtree(unfinished, ignore_errors=True)
            unfinished.mkdir()
            make(unfinished)
            unfinished.rename(folder)
    return folder


def debootstrap(folder: Path) -> None:
    """Make a minimal Debian 12 with Python in an empty folder."""
    command = ["debootstrap", "--variant=minbase", "--include=ca-certificates,python3", SUITE]
    called([*command, str(folder), _mirror()])
    for name in ("/etc/resolv.conf", "/etc/hosts", "/etc/pip.conf", CERTIFICATES):
        if Path(name).exists():
            shutil.copy(name, folder / name[1:])
    _write_pip_settings(folder / "etc" / "pip.conf")
    settings = called(["apt-config", "dump"])
    lines = [line for line in settings.stdout.splitlines() if line.startswith("Acquire::http")]
    (folder / "etc/apt/apt.conf.d/99machine").write_text("".join(f"{line}\n" for line in lines))
    does(folder, "apt-get update --quiet=2")


def _mirror() -> str:
    """The mirror of Debian that this machine's apt uses."""
    files = [Path("/etc/apt/sources.list"), *Path("/etc/apt/sources.list.d").glob("*")]
    for path in files:
        if path.is_file():
            found = MIRROR.search(path.read_text())
            if found:
                return found[1]
    return PUBLIC_MIRROR


def _write_pip_settings(path: Path) -> None:
    """Add this process' variables PIP_... to a pip.conf, which programs of any environment read."""
    settings = configparser.RawConfigParser()
    settings.read(path)
    if not settings.has_section("global"):
        settings.add_section("global")
    for name, value in os.environ.items():
        if name.startswith("PIP_"):
            settings.set("global", name.removeprefix("PIP_").lower().replace("_", "-"), value)
    with path.open("w") as file:
        settings.write(file)


def _environment() -> dict[str, str]:
    """Of programs in it: how this machine reaches the internet, and nothing else of ours."""
    kept = {name: value for name, value in os.environ.items() if name.lower().endswith("_proxy")}
    return {"DEBIAN_FRONTEND": "noninteractive", "HOME": "/root", "PATH": PATH} | kept


@contextmanager
def copied(base: Path, folder: Path) -> Iterator[Path]:
    """A copy of a Debian that ends with the context."""
    subprocess.run(["cp", "-a", str(base), str(folder)], check=True)
    try:
        yield folder
    finally:
        shutil.rmtree(folder)


def does(root: Path, script: str, seconds: float = 600.0) -> str:
    """Run commands as root in the folder, with this machine's network; their output."""
    cache = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "pip"
    own = {"ROOT": str(root), "CACHE": str(cache), "SCRIPT": script}
    namespaces = ["unshare", "--mount", "--pid", "--fork", "--kill-child", "--"]
    return output([*namespaces, "sh", "-c", ENTER], seconds, _environment() | own)


def output(argv: Sequence[str | Path], seconds: float, env: dict[str, str] | None = None) -> str:
    """What a program that has to end with 0 wrote."""
    done = subprocess.run(
        [str(part) for part in argv],
        env=env,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=seconds,
        check=False,
    )
    assert done.returncode == 0, f"{argv[-1]} ended with {done.returncode}:\n{done.stdout[-4000:]}"
    return done.stdout


class Machine:
    """A Debian that has booted.

    Attributes:
        root: Its folder, as this machine sees it (without what is mounted in it).
        enter: The command that runs the rest of its line in it, as root.
    """

    def __init__(self, root: Path, init: int) -> None:
        self.root = root
        self.enter = [
            "nsenter",
            f"--target={init}",
            "--all",
            "--",
            "env",
            "-i",
            "HOME=/root",
            f"PATH={PATH}",
        ]

    def does(self, script: str, seconds: float = 120.0) -> str:
        """Run commands as root in it; their output."""
        return output([*self.enter, "bash", "-euo", "pipefail", "-c", script], seconds)

    def until_output(self, script: str, pattern: str, seconds: float = 60.0) -> str:
        """Repeat commands until their output has the pattern; that output."""
        found = ""

        def has_it() -> bool:
            nonlocal found
            found = self.does(f"{{ {script.strip()}\n}} || true")
            return re.search(pattern, found) is not None

        until(has_it, lambda: f"{pattern!r} from {script!r}: {found}", seconds, every=0.5)
        return found


@contextmanager
def booted(root: Path, log: Path) -> Iterator[Machine]:
    """Boot the Debian in a folder, which has systemd; it is off after the context."""
    group = f"debian-{os.getpid()}"
    groups = log.with_suffix(".cgroups")
    groups.mkdir()
    subprocess.run(["mount", "-t", "cgroup2", "cgroup2", str(groups)], check=True)
    try:
        (groups / group).mkdir()
        namespaces = ["--mount", "--uts", "--ipc", "--net", "--pid", "--cgroup"]
        start = f'echo $$ >"{groups / group}/cgroup.procs"; exec "$@"'
        argv = ["unshare", *namespaces, "--fork", "--kill-child", "--", "sh", "-c", BOOT]
        env = {"ROOT": str(root), "PATH": PATH, "SEARCH": PATH}
        process = Process("Debian", ["sh", "-c", start, "sh", *argv], env, log)
        process.start()
        try:
            machine = Machine(root, until(lambda: _child(process), process.describe))
            state = "systemctl is-system-running --wait"
            until(lambda: _running(machine, state), process.describe, 60, every=0.5)
            yield machine
        finally:
            process.kill()
            until(lambda: _removed(groups / group), f"end of the processes in {group}")
    finally:
        subprocess.run(["umount", str(groups)], check=True)


def _child(process: Process) -> int | None:
    """The init of the machine, as soon as it is systemd."""
    assert process.alive, process.describe()
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    for pid in children:
        if Path(f"/proc/{pid}/comm").read_text().strip() == "systemd":
            return int(pid)
    return None


def _running(machine: Machine, state: str) -> bool:
    done = subprocess.run([*machine.enter, *state.split()], capture_output=True, check=False)
    return done.stdout.strip() == b"running"


def _removed(group: Path) -> bool:
    """Whether the cgroup and those in it could be removed: they have no processes any more."""
    for folder, _, _ in os.walk(group, topdown=False):
        with suppress(OSError):
            Path(folder).rmdir()
    return not group.exists()
