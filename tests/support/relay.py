"""A network that loses and delays what it carries: connects hosts by devices of its own.

The kernel's netem does this where it is built in; this needs /dev/net/tun alone. Each host gets
the device eth0 and the address 10.77.NUMBER.2/16; what one sends, all others receive. Of the file
CONTROL the two numbers are the share of frames that are lost, and the seconds by which they are
late; it may be replaced at any time.

    python relay.py CONTROL SEED HOST...
"""

import fcntl
import heapq
import os
import select
import struct
import subprocess
import sys
import time
from collections.abc import Sequence
from itertools import count
from pathlib import Path
from random import Random

SET_DEVICE, ETHERNET_ALONE = 0x400454CA, 0x0002 | 0x1000  # TUNSETIFF; IFF_TAP | IFF_NO_PI
LONGEST = 65536  # bytes of a frame
LOOK = 0.2  # seconds between two looks at CONTROL


def device(name: str) -> int:
    """A new Ethernet device of this name: what it sends is read from the descriptor."""
    made = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
    fcntl.ioctl(made, SET_DEVICE, struct.pack("16sH14x", name.encode(), ETHERNET_ALONE))
    return made


def connect(number: int, host: str) -> int:
    """Give a host its device."""
    made = device(f"to{number}")
    for command in (
        f"link set to{number} netns {host} name eth0",
        f"-n {host} address add 10.77.{number}.2/16 dev eth0",
        f"-n {host} link set eth0 up",
        f"-n {host} link set lo up",
    ):
        subprocess.run(["ip", *command.split()], check=True)
    return made


class Network:
    """Carries frames between the devices."""

    def __init__(self, devices: Sequence[int], control: Path, seed: int) -> None:
        self._devices = devices
        self._control = control
        self._random = Random(seed)
        self._under_way: list[tuple[float, int, int, bytes]] = []  # due, number, from, frame
        self._numbers = count()
        self._look_at = 0.0
        self._loss = self._delay = 0.0

    def run(self) -> None:
        """Carry until the process ends."""
        poll = select.poll()
        for each in self._devices:
            poll.register(each, select.POLLIN)
        while True:
            now = time.monotonic()
            if now >= self._look_at:
                self._look_at = now + LOOK
                self._loss, self._delay = map(float, self._control.read_text().split())
            due = min(self._look_at, self._under_way[0][0] if self._under_way else self._look_at)
            for ready, _event in poll.poll(max(0.0, due - now) * 1000):
                self._take(ready)
            self._deliver()

    def _take(self, device: int) -> None:
        try:
            frame = os.read(device, LONGEST)
        except BlockingIOError:
            return
        if self._random.random() >= self._loss:
            late = time.monotonic() + self._delay
            heapq.heappush(self._under_way, (late, next(self._numbers), device, frame))

    def _deliver(self) -> None:
        while self._under_way and self._under_way[0][0] <= time.monotonic():
            _due, _number, source, frame = heapq.heappop(self._under_way)
            for each in self._devices:
                if each != source:
                    os.write(each, frame)


if __name__ == "__main__":
    devices = [connect(number, host) for number, host in enumerate(sys.argv[3:], 1)]
    print("ready", flush=True)
    Network(devices, Path(sys.argv[1]), int(sys.argv[2])).run()
