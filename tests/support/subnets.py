"""Hosts in subnets of their own behind a router, as network namespaces: multicast ends there.

All of it is in one namespace of users, networks and mounts: it needs no root where the kernel lets
users make these, collides with nothing on this machine, and is gone with its first process.
"""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path

from support.called import called
from support.replaced import replace_text
from testbed.polling import until
from testbed.processes import Process

# The router forwards; the kernel has no multicast routing unless a daemon sets it up.
ROUTED = """
mount -t tmpfs tmpfs /run
ip link set lo up
echo 1 > /proc/sys/net/ipv4/ip_forward
number=0
for host in "$@"; do
    number=$((number + 1))
    ip netns add "$host"
    ip link add "to$number" type veth peer name eth0 netns "$host"
    ip address add "10.77.$number.1/24" dev "to$number"
    ip link set "to$number" up
    ip -n "$host" address add "10.77.$number.2/24" dev eth0
    ip -n "$host" link set lo up
    ip -n "$host" link set eth0 up
    ip -n "$host" route add default via "10.77.$number.1"
done
echo ready
exec sleep infinity
"""
# The router forwards nothing, and the hosts know no way but to it.
APART = "".join(
    line
    for line in ROUTED.splitlines(keepends=True)
    if "ip_forward" not in line and "route add" not in line
)
SWITCHED = """
mount -t tmpfs tmpfs /run
ip link add switch type bridge
ip link set switch up
number=0
for host in "$@"; do
    number=$((number + 1))
    ip netns add "$host"
    ip link add "to$number" type veth peer name eth0 netns "$host"
    ip link set "to$number" master switch up
    ip -n "$host" address add "10.77.$number.2/16" dev eth0
    ip -n "$host" link set lo up
    ip -n "$host" link set eth0 up
done
echo ready
exec sleep infinity
"""
# In one subnet, whose network loses and delays frames as a file says.
RELAYED = f"""
mount -t tmpfs tmpfs /run
for host in "$@"; do ip netns add "$host"; done
exec {sys.executable} {Path(__file__).with_name("relay.py")} "$RELAY_CONTROL" "$RELAY_SEED" "$@"
"""
FETCH = "import sys, urllib.request as u; print(u.urlopen(sys.argv[1], timeout=5).read().decode())"


def missing() -> str:
    """Why there can be no subnets here; empty where there can."""
    if shutil.which("ip") is None:
        return "needs the program ip (package iproute2)"
    probe = ["unshare", "--user", "--map-root-user", "--net", "--mount", "--", "sh", "-ec"]
    script = (
        "mount -t tmpfs tmpfs /run && ip netns add any && ip link add one type veth peer name other"
    )
    done = called([*probe, script], code=None)
    return "no network namespaces: unshare --user --net fails" if done.returncode else ""


class Subnets:
    """Hosts that reach each other, by unicast only unless they are in one subnet.

    Args:
        stack: Ends all of it.
        folder: For what the programs write.
        hosts: Their names.
        layout: ``ROUTED``, each in a subnet of its own, ``APART``, the same without a route from
            one to another, ``SWITCHED``, all in one, or ``RELAYED``, too, by a network that loses
            and delays frames; ``disturb`` says how many.
    """

    def __init__(
        self, stack: ExitStack, folder: Path, hosts: Sequence[str], layout: str = ROUTED
    ) -> None:
        self._stack = stack
        self._folder = folder
        self._started = 0
        self._control = folder / "relay"
        self.disturb(0.0, 0.0)
        unshare = ["unshare", "--user", "--map-root-user", "--net", "--mount", "--"]
        env = {**os.environ, "RELAY_CONTROL": str(self._control), "RELAY_SEED": "1"}
        self._router = self._start("router", [*unshare, "sh", "-ec", layout, "sh", *hosts], env)
        self._router.wait_for_output("ready")
        # Fast DDS uses the interfaces that have a carrier when a participant starts.
        until(lambda: all(map(self._is_up, hosts)), "the interfaces of the hosts are up")

    def disturb(self, loss: float, delay: float) -> None:
        """From now on lose this share of the frames in a RELAYED network, and delay the others.

        ``delay`` is in seconds.
        """
        replace_text(self._control, f"{loss} {delay}")

    def start(self, host: str, argv: Sequence[str | Path], env: Mapping[str, str]) -> Process:
        """Start a program on a host ("": the router); it ends with the stack."""
        return self._start(
            f"{host or 'router'}-{Path(argv[0]).name}", [*self._into(host), *argv], env
        )

    def run(self, host: str, *argv: str) -> None:
        """Run a command on a host ("": the router) until it ends.

        Raises:
            CalledProcessError: It ended with an error.
        """
        subprocess.run([*self._into(host), *argv], check=True)

    def output(self, host: str, *argv: str) -> str:
        """What a command writes on a host; arguments as `run`."""
        command = [*self._into(host), *argv]
        return called(command).stdout

    def fetch(self, host: str, url: str) -> str:
        """What a server answers to a host.

        Raises:
            OSError: There is no answer, or an error of HTTP.
        """
        argv = [*self._into(host), sys.executable, "-c", FETCH, url]
        done = called(argv, code=None, timeout=20)
        if done.returncode:
            raise OSError(done.stderr)
        return done.stdout

    def _is_up(self, host: str) -> bool:
        argv = [*self._enter(), "ip", "-json", "-n", host, "link", "show", "eth0"]
        done = called(argv)
        (link,) = json.loads(done.stdout)
        return link["operstate"] in ("UP", "UNKNOWN")  # a TAP device does not say

    def _enter(self) -> list[str]:
        into = ["--user", "--preserve-credentials", "--net", "--mount"]
        return ["nsenter", "--target", str(self._router.pid), *into, "--"]

    def _into(self, host: str) -> list[str]:
        return [*self._enter(), "ip", "netns", "exec", host] if host else self._enter()

    def _start(
        self, name: str, argv: Sequence[str | Path], env: Mapping[str, str] | None
    ) -> Process:
        self._started += 1
        process = Process(name, argv, env, self._folder / f"{name}-{self._started}.log")
        self._stack.callback(process.stop)
        return process.start()
