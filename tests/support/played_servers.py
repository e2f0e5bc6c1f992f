"""An exporter and an Alertmanager in place of the client of ``ros-diagnostics``."""

from collections.abc import Iterator
from typing import Any
from urllib.parse import parse_qs

import pytest

from ros_diagnostics_exporter.http_client import Client, UnreachableError
from support.as_listed import read_downtimes
from support.web_server import fleet


class PlayedServers:
    """Both servers: what an Alertmanager got it lists, and the exporter follows its downtimes."""

    def __init__(self) -> None:
        self.fleet: dict[str, Any] = fleet()
        self.alerts: list[dict[str, Any]] = []
        self.silences: list[dict[str, Any]] = []
        self.routed: dict[str, Any] = {}  # what Alertmanager says of each alert beside it
        self.exporter_answers = self.follows = True

    def get(self, client: Client, path: str) -> Any:
        where, _, query = path.partition("?")
        if where == "/api/v2/silences":
            return self.silences
        if where == "/api/v2/alerts":
            return [{**each, **self.routed} for each in self.alerts]
        assert where == "/api/v1/fleet"
        if not self.exporter_answers:
            raise UnreachableError(f"{client.url} refused")
        wanted = parse_qs(query).get("robot", [])
        planned = read_downtimes(self.silences, self.fleet["fleet"]) if self.follows else []
        robots = [
            {**each, "downtimes": self._shown(planned, each["robot"])}
            for each in self.fleet["robots"]
            if not wanted or each["robot"] in wanted
        ]
        return {**self.fleet, "robots": robots}

    def _shown(self, planned, robot: str) -> list[dict[str, Any]]:
        of_robot = (each for each in planned if each.robot == robot)
        return [{"component": each.component, "until": each.end} for each in of_robot]

    def post(self, _client: Client, path: str, body: Any) -> dict[str, str] | None:
        if path == "/api/v2/alerts":
            self.alerts += body
            return None
        number = f"id-{len(self.silences)}"
        self.silences.append({"id": number, "status": {"state": "active"}, **body})
        return {"silenceID": number}

    def delete(self, _client: Client, path: str) -> None:
        self.silences = [each for each in self.silences if not path.endswith(f"/{each.get('id')}")]

    def matched(self) -> list[dict[str, str]]:
        """What each silence is of: the value of each label."""
        return [{each["name"]: each["value"] for each in of["matchers"]} for of in self.silences]


@pytest.fixture
def played() -> Iterator[PlayedServers]:
    """The two servers; each client of the test asks them."""
    servers = PlayedServers()
    with pytest.MonkeyPatch.context() as patch:
        for name in ("get", "post", "delete"):
            method = getattr(servers, name)
            patch.setattr(Client, name, lambda client, *given, m=method: m(client, *given))
        yield servers
