"""A web server on a fake backend: the web is tested without ROS and without the state."""

import http.client
import json
import socket
import ssl
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import pytest
import trustme

from ros_diagnostics_exporter.model import Part
from ros_diagnostics_exporter.rejected_logins import RejectedLogins
from ros_diagnostics_exporter.severity import STATE_OF_LEVEL
from ros_diagnostics_exporter.web import server as server_module
from ros_diagnostics_exporter.web.server import Server

Serve = Callable[..., Server]


def component(name: str, level: str, **changed: Any) -> dict[str, Any]:
    """A component as /api/v1/fleet shows it."""
    return {
        "component": name,
        "group": "/Motor",
        "hardware_id": "m-1",
        "level": level,
        "reported_level": level,
        "level_before_stale": "OK" if level == "STALE" else None,
        "state": STATE_OF_LEVEL[level],
        "planned_stale": False,
        "suppressed_because": "",
        "message": f"{name} reports {level}",
        "level_since": 990.0,
        "changes": 3,
        "flap_ratio": 0.25,
        "values": [{"key": "Level", "value": "12.3 V", "number": 12.3, "unit": "V"}],
        **changed,
    }


def _identity(scope: str, state: str) -> dict[str, Any]:
    return {
        "scope": scope,
        "state": state,
        "severity": "critical" if state in {"critical", "silent"} else "warning",
        **dict.fromkeys(("site", "robot", "group", "component", "check", "key", "bound"), ""),
    }


def problem(scope: str, state: str, **changed: Any) -> dict[str, Any]:
    """A problem as /api/v1/fleet shows it: not confirmed yet, for 5 s of 60."""
    return {
        **_identity(scope, state),
        "since": 1_000.0,
        "confirmed": None,
        "due": 1_065.0,
        "suppressed": None,
        "suppressed_by": None,
        "because": "",
        "healthy": False,
        "evidence": "",
        "details": {},
        "fault": None,
        "recording": None,
        "notified": None,
        "acknowledged": None,
        **changed,
    }


def broken(name: str = "Motor 1", state: str = "critical", **changed: Any) -> dict[str, Any]:
    """A confirmed problem of a component of the group /Motor."""
    of = {"group": "/Motor", "component": name, "confirmed": 1_010.0}
    return problem("component", state, **(of | changed))


def robot(name: str, *components: dict[str, Any], **changed: Any) -> dict[str, Any]:
    """A robot as /api/v1/fleet shows it."""
    return {
        "robot": name,
        "up": True,
        "silent_reason": None,
        "last_message": 1_060.0,
        "labels": {"site": "hall"},
        "address": None,
        "links": {},
        "domain_id": 7,
        "namespace": f"/{name}",
        "topic": f"/{name}/diagnostics_agg",
        "profile": "default",
        "maintenance": False,
        "maintenance_until": None,
        "capabilities_text": "",
        "downtimes": [],
        "downtimes_ahead": [],
        "problems": [],
        "capabilities": [],
        "short_checks": [],
        "groups": [{"group": "/Motor", "level": "OK", "message": "OK"}],
        "components": list(components),
        **changed,
    }


def downtime(component: str = "", **changed: Any) -> dict[str, Any]:
    """A downtime that ann planned until 20:00 UTC, as /api/v1/fleet shows it."""
    times = {"from": 0.0, "until": 72_000.0}
    known = {"component": component, **times, "author": "ann", "comment": "new gears"}
    return {**known, **changed}


def fleet(*robots: dict[str, Any], problems: Iterable[dict[str, Any]] = ()) -> dict[str, Any]:
    """A fleet as /api/v1/fleet shows it, at Unix time 1,060."""
    return {
        "fleet": "hall",
        "time": 1_060.0,
        "version": "1",
        "problems": list(problems),
        "capabilities": [],
        "robots": list(robots),
    }


def no_faults() -> dict[str, Any]:
    return {"fleet": "hall", "time": 1_060.0, "faults": []}


def no_history(fault: str) -> dict[str, Any]:
    return {"fault": fault, "time": 1_060.0, "events_since": None, "occurrences": []}


def occurrence(scope: str, state: str, **changed: Any) -> dict[str, Any]:
    """A fault as /api/v1/faults/ID shows it: of 1,000 to 1,030, recovered."""
    return {
        **_identity(scope, state),
        "since": 1_000.0,
        "confirmed": 1_010.0,
        "until": 1_030.0,
        "reason": "recovered",
        "evidence": "",
        "details": {},
        "end": "",
        "acknowledged": [],
        "notified": [],
        **changed,
    }


def no_story(robot: str) -> dict[str, Any]:
    of = {"fleet": "hall", "robot": robot, "time": 1_060.0, "since": 10.0}
    return {**of, "sentences": [{"about": "", "text": "No fault in the last 7 days."}]}


def no_recording(fault: str, so_far: bool) -> bytes:
    raise LookupError(f"no recording of fault {fault!r}")


def no_fault_history(
    robot: str, component: str | None, at: float | None, *, ask: bool = True
) -> dict[str, Any]:
    times = {"time": 1_060.0, "at": 1_060.0 if at is None else at}
    return {
        "fleet": "hall",
        "robot": robot,
        "component": component,
        **times,
        "entries": [],
        "now": ["asked"] if ask else [],
    }


def no_capabilities(robot: str | None) -> dict[str, Any]:
    return {"fleet": "hall", "robot": robot, "time": 1_060.0, "capabilities": []}


def no_missions(_robot: str | None) -> dict[str, Any]:
    return {"fleet": "hall", "time": 1_060.0, "robots": []}


def no_targets(job: str, _port: int | None) -> list[dict[str, Any]]:
    raise LookupError(job)


def render_metrics(openmetrics: bool, _parts: frozenset[Part]) -> list[bytes]:
    return [b"openmetrics\n" if openmetrics else b"text\n"]


@dataclass(frozen=True)
class FakeBackend:
    """A Backend made of functions."""

    rejected_logins: RejectedLogins = field(default_factory=RejectedLogins)

    render_metrics: Callable[[bool, frozenset[Part]], Sequence[bytes]] = render_metrics
    count_scrape: Callable[[], None] = lambda: None
    fleet_snapshot: Callable[[], dict[str, Any]] = fleet
    faults: Callable[[], dict[str, Any]] = no_faults
    fault_history: Callable[[str], dict[str, Any]] = no_history
    recording: Callable[[str, bool], bytes] = no_recording
    story: Callable[[str], dict[str, Any]] = no_story
    last_event: Callable[[], int] = lambda: 0
    find_events: Callable[[Any], Iterable[dict[str, Any]]] = lambda _wanted: []
    why: Callable[..., dict[str, Any]] = no_fault_history
    capabilities: Callable[[str | None], dict[str, Any]] = no_capabilities
    missions: Callable[[str | None], dict[str, Any]] = no_missions
    notified: Callable[[bytes], tuple[int, int]] = lambda _body: (1, 0)
    targets: Callable[[str, int | None], list[dict[str, Any]]] = no_targets
    hanging_reason: Callable[[], str | None] = lambda: None
    not_ready_reason: Callable[[], str | None] = lambda: None
    reload: Callable[[], None] = lambda: None
    acknowledge: Callable[..., None] = lambda *_given: None
    plan_downtime: Callable[..., None] = lambda *_given: None
    cancel_downtime: Callable[..., None] = lambda *_given: None
    forget: Callable[[str, str | None], tuple[int, bool]] = lambda _robot, _component: (1, True)
    accept_graph: Callable[[str], int] = lambda _robot: 1


BACKEND_METHODS = {each.name for each in fields(FakeBackend)}


@pytest.fixture
def serve() -> Iterator[Serve]:
    """Starts servers; keywords are methods of the backend and options of the server."""
    started = []

    def start(listen: str = "127.0.0.1:0", **given: Any) -> Server:
        options = {name: given.pop(name) for name in list(given) if name not in BACKEND_METHODS}
        server = Server(FakeBackend(**given), listen=[listen], **options)
        server.start()
        started.append(server)
        return server

    yield start
    for server in started:
        server.stop()


@pytest.fixture
def seldom(monkeypatch: pytest.MonkeyPatch) -> None:
    """The web config is read again when a test wants it (`reloaded`)."""
    monkeypatch.setattr(server_module, "RELOAD_INTERVAL", 3_600.0)


def reloaded(server: Server) -> Server:
    """The server once it has read the files as they are now."""
    wait_until(lambda: server.loop.last_turn)
    before = server.loop.last_turn
    server.loop.wake()
    wait_until(lambda: server.loop.last_turn > before)
    return server


def wait_until(condition: Callable[[], object], seconds: float = 20.0) -> None:
    """Returns when ``condition`` holds; fails when it does not in time."""
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "timed out"
        threading.Event().wait(0.01)


@pytest.fixture(scope="session")
def plain() -> Iterator[Server]:
    """A server on an unchanged FakeBackend, for tests that do not change it."""
    server = Server(FakeBackend(), listen=["127.0.0.1:0"])
    server.start()
    yield server
    server.stop()


@pytest.fixture(scope="session")
def ca() -> trustme.CA:
    return trustme.CA()


def renew(ca: trustme.CA, folder: Path) -> None:
    """A fresh certificate for 127.0.0.1: server.crt and server.key in ``folder``."""
    issued = ca.issue_cert("127.0.0.1")
    issued.private_key_pem.write_to_path(folder / "server.key")
    (folder / "server.crt").write_bytes(b"".join(each.bytes() for each in issued.cert_chain_pems))


@pytest.fixture
def tls_config(tmp_path: Path, ca: trustme.CA) -> Path:
    """A web config with TLS and nothing else."""
    renew(ca, tmp_path)
    path = tmp_path / "web.yml"
    path.write_text("tls_server_config: {cert_file: server.crt, key_file: server.key}")
    return path


class Reply:
    """A response: status, headers and the whole body."""

    def __init__(self, response: http.client.HTTPResponse) -> None:
        self.status = response.status
        self.headers = response.headers
        self.body = response.read()

    @property
    def text(self) -> str:
        return self.body.decode()

    @property
    def json(self) -> Any:
        return json.loads(self.body)


def url_of(server: Server, path: str = "") -> str:
    """The URL of the server, or of one of its pages."""
    return f"http://{server.addresses[0]}{path}"


def ask(
    server: Server,
    path: str,
    method: str = "GET",
    tls: ssl.SSLContext | None = None,
    source: str = "",
    *,
    body: bytes | None = None,
    **headers: str,
) -> Reply:
    """One request on its own connection, from ``source``; header names with _ for -."""
    host, _, port = server.addresses[0].rpartition(":")
    client: http.client.HTTPConnection
    if tls is None:
        client = http.client.HTTPConnection(
            host.strip("[]"), int(port), timeout=20, source_address=(source, 0) if source else None
        )
    else:
        client = http.client.HTTPSConnection(host, int(port), timeout=20, context=tls)
    with closing(client):
        client.request(
            method, path, body, headers={k.replace("_", "-"): v for k, v in headers.items()}
        )
        return Reply(client.getresponse())


def connect(server: Server) -> socket.socket:
    """A bare connection, for misbehaving clients."""
    host, _, port = server.addresses[0].rpartition(":")
    return socket.create_connection((host, int(port)), timeout=20)
