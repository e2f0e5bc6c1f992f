"""Which files of the exporter a message, a scrape and a restart pass through, in how many calls.

This program prints them as tables. What is traced is the exporter itself: its service with a
database, and its web server with a client. Only DDS is left out: a message begins as bytes that ROS
has serialized.
"""

from __future__ import annotations

import http.client
import json
import logging
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from types import FrameType

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.serialization import serialize_message

import ros_diagnostics_exporter
from ros_diagnostics_exporter.config.load import load
from ros_diagnostics_exporter.decode.cdr import Decoder, TopicQueue
from ros_diagnostics_exporter.loops import read_clocks
from ros_diagnostics_exporter.model import Topic
from ros_diagnostics_exporter.service import Service
from ros_diagnostics_exporter.storage.storage import Storage
from ros_diagnostics_exporter.web.server import Server
from testbed.polling import until

PACKAGE = Path(ros_diagnostics_exporter.__file__).parent
FLEET = """\
fleet: hall
robots: [{name: robot_1, labels: {site: hall}, topic: /robot_1/diagnostics_agg, source: agg}]
"""
TOPIC = Topic(0, "/robot_1/diagnostics_agg")
OK, ERROR = 0, 2

Calls = dict[str, int]  # how many of functions of a file, in the order of the files' first calls


class Tracer:
    """Counts the calls into the exporter's package while it is `tracing`, in every thread.

    A generator or coroutine is one call however often it goes on.
    """

    def __init__(self) -> None:
        self._seen: dict[int, FrameType] | None = None  # kept alive: so their ids stay theirs
        self._calls: Calls = {}

    @contextmanager
    def tracing(self, *, this_thread: bool = True) -> Iterator[Calls]:
        """Yields the calls, which are complete at its end."""
        self._seen, self._calls = {}, {}
        if this_thread:
            sys.setprofile(self.note)
        try:
            yield self._calls
        finally:
            sys.setprofile(None)
            self._seen = None

    def note(self, frame: FrameType, event: str, _argument: object) -> None:
        """What sys.setprofile calls."""
        seen = self._seen
        if seen is None or event != "call" or id(frame) in seen:
            return
        file = frame.f_code.co_filename
        if not file.startswith(f"{PACKAGE}/") or _is_no_function(frame) or _is_of_a_clock(frame):
            return
        seen[id(frame)] = frame
        name = str(Path(file).relative_to(PACKAGE))
        self._calls[name] = self._calls.get(name, 0) + 1


def _is_no_function(frame: FrameType) -> bool:
    """A comprehension or a class: what is a call there differs between versions of Python."""
    return frame.f_code.co_name.startswith("<") and frame.f_code.co_name != "<lambda>"


def _is_of_a_clock(frame: FrameType) -> bool:
    """What runs every so often, whatever is traced."""
    if threading.current_thread().name == "web-config":
        return True
    above: FrameType | None = frame
    while above is not None:
        if above.f_code.co_filename.endswith("uvicorn/server.py"):
            return True
        above = above.f_back
    return False


def traces() -> dict[str, Calls]:
    """The calls of each, by name; by a new process, in which no cache has anything yet."""
    program = [sys.executable, __file__, "--json"]
    found = subprocess.run(program, check=True, stdout=subprocess.PIPE)  # noqa: S603 - this file
    traced: dict[str, Calls] = json.loads(found.stdout)
    return traced


def _trace() -> dict[str, Calls]:
    tracer = Tracer()
    threading.setprofile(tracer.note)
    logging.getLogger("ros_diagnostics_exporter").setLevel(logging.ERROR)
    with TemporaryDirectory() as folder:
        return _trace_all(tracer, Path(folder))


def _trace_all(tracer: Tracer, folder: Path) -> dict[str, Calls]:
    service = _service(folder)
    decoder, queue = Decoder(), TopicQueue()
    healthy = _message(OK)
    for _ in range(3):  # the first ones make the components
        _receive(service, queue, decoder, healthy)
    with tracer.tracing() as unchanged:
        _receive(service, queue, decoder, healthy)
    with _serving(service) as server:
        _scrape(server)  # makes the threads, and the texts of the robot
        broken = _message(ERROR)
        with tracer.tracing() as breaking:
            _receive(service, queue, decoder, broken)
        with tracer.tracing(this_thread=False) as scrape:  # this one is the client
            _scrape(server)
    service.stop()
    with tracer.tracing() as restart:
        again = _service(folder)
    again.stop()
    return {"unchanged": unchanged, "breaking": breaking, "scrape": scrape, "restart": restart}


def _service(folder: Path) -> Service:
    """One that is not started: it joins no domain, and no loop of it runs."""
    config = folder / "fleet.yml"
    config.write_text(FLEET, encoding="utf-8")
    return Service(load(config), config, Storage(folder / "state.db"))


@contextmanager
def _serving(service: Service) -> Iterator[Server]:
    with ExitStack() as stack:
        server = Server(service, ["127.0.0.1:0"])
        server.start()
        stack.callback(server.stop)
        yield server


def _scrape(server: Server) -> None:
    """Ask for /metrics on a new connection; returns when the server has closed it, too."""
    host, _, port = server.addresses[0].partition(":")
    client = http.client.HTTPConnection(host, int(port), timeout=30)
    client.request("GET", "/metrics")
    response = client.getresponse()
    response.read()
    client.close()
    if response.status != 200:
        raise RuntimeError(f"the scrape was answered {response.status}")
    until(lambda: not len(server.connections), "the end of the scrape's connection", every=0.01)


def _message(level: int) -> bytes:
    """An aggregator's array: one component of that level, all others OK."""
    levels = {"/Drives": level, "/Drives/Motor 1": OK, "/Drives/Motor 2": level}
    rows = [_status(name, of) for name, of in levels.items()]
    return _with_zeros(bytearray(serialize_message(DiagnosticArray(status=rows))))


def _with_zeros(message: bytearray) -> bytes:
    """The array with zeros for padding: ROS leaves there what was in memory, other each time."""
    at = 4 + 8  # after the encapsulation and the stamp

    def number() -> int:
        nonlocal at
        padding = -at % 4
        message[at : at + padding] = bytes(padding)
        at += padding + 4
        return int.from_bytes(message[at - 4 : at], "little")

    def skip_texts(count: int) -> None:
        nonlocal at
        for _ in range(count):
            length = number()
            at += length

    skip_texts(1)
    for _ in range(number()):
        at += 1  # the level
        skip_texts(3)
        skip_texts(2 * number())
    return bytes(message)


def _status(name: str, level: int) -> DiagnosticStatus:
    message = "overheated" if level else "OK"
    values = [KeyValue(key="Temperature (C)", value="90" if level else "40")]
    return DiagnosticStatus(level=bytes([level]), name=name, message=message, values=values)


def _receive(service: Service, queue: TopicQueue, decoder: Decoder, message: bytes) -> None:
    """What sources/reception.py does with the bytes of a message."""
    queue.put(message)
    service.state.receive(TOPIC, decoder.decode(*queue.get()), read_clocks())


# -- the tables ------------------------------------------------------------------------------


def table(calls: Calls) -> str:
    """How many calls into how many files; the files in order, each with its own first sentence."""
    rows = [f"{count:5} {name}: {_sentence(name)}" for name, count in calls.items()]
    return "\n".join([f"{sum(calls.values())} calls, {len(calls)} files", *rows]) + "\n"


def _sentence(name: str) -> str:
    first = (PACKAGE / name).read_text(encoding="utf-8").splitlines()[0]
    return first.strip('"').rstrip(".")


if __name__ == "__main__":
    found = _trace()
    if "--json" in sys.argv:
        json.dump(found, sys.stdout)
    else:
        sys.stdout.write("\n".join(f"{name}: {table(calls)}" for name, calls in found.items()))
