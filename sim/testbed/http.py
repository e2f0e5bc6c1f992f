"""HTTP requests to servers on this machine, with httpx."""

from __future__ import annotations

import json
from typing import Any, NamedTuple

import httpx

# No proxy of the environment, and a connection for each request: servers are restarted.
_CLIENT = httpx.Client(trust_env=False, limits=httpx.Limits(max_keepalive_connections=0))
# No connection, a timeout, or a status other than 2xx.
Unanswered = httpx.HTTPError


class Sample(NamedTuple):
    """One element of an instant vector."""

    labels: dict[str, str]
    value: float


def get(address: str, path: str, seconds: float = 5.0) -> bytes:
    """Return the body of ``GET http://ADDRESS PATH``.

    Args:
        address: HOST:PORT.
        path: With its leading slash and query.
        seconds: The timeout for connecting, and for each read.

    Raises:
        Unanswered: No connection, a timeout, or a status other than 2xx.
    """
    response = _CLIENT.get(f"http://{address}{path}", timeout=seconds)
    return response.raise_for_status().content


def get_json(address: str, path: str) -> Any:
    """Return the parsed JSON of ``http://ADDRESS PATH``; raises as `get`."""
    return json.loads(get(address, path))


def query(address: str, promql: str) -> list[Sample]:
    """Return the instant vector of an expression from Prometheus.

    Raises:
        Unanswered: As `get`; also for an invalid expression.
    """
    url = httpx.URL("/api/v1/query", params={"query": promql})
    result = get_json(address, str(url))["data"]["result"]
    return [Sample(each["metric"], float(each["value"][1])) for each in result]


def answers(address: str, path: str) -> bool:
    """Return whether ``http://ADDRESS PATH`` answers 2xx within two seconds."""
    try:
        get(address, path, seconds=2.0)
    except Unanswered:
        return False
    return True
