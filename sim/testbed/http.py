"""HTTP requests to servers on this machine, with httpx; errors are httpx.HTTPError."""

from __future__ import annotations

from typing import Any, NamedTuple

import httpx

# No proxy of the environment, and a connection for each request: servers are restarted.
_CLIENT = httpx.Client(trust_env=False, limits=httpx.Limits(max_keepalive_connections=0))


class Sample(NamedTuple):
    """One element of an instant vector."""

    labels: dict[str, str]
    value: float


def get(address: str, path: str, seconds: float = 5.0) -> httpx.Response:
    """Return the response to ``GET http://ADDRESS PATH``.

    Args:
        address: HOST:PORT.
        path: With its leading slash and query.
        seconds: The timeout for connecting, and for each read.

    Raises:
        httpx.HTTPError: No connection, a timeout, or a status other than 2xx.
    """
    response = _CLIENT.get(f"http://{address}{path}", timeout=seconds)
    return response.raise_for_status()


def get_json(address: str, path: str) -> Any:
    """Return the parsed JSON of ``http://ADDRESS PATH``; raises as `get`."""
    return get(address, path).json()


def query(address: str, promql: str) -> list[Sample]:
    """Return the instant vector of an expression from Prometheus.

    Raises:
        httpx.HTTPError: As `get`; also for an invalid expression.
    """
    url = httpx.URL("/api/v1/query", params={"query": promql})
    result = get_json(address, str(url))["data"]["result"]
    return [Sample(each["metric"], float(each["value"][1])) for each in result]


def answers(address: str, path: str) -> bool:
    """Return whether ``http://ADDRESS PATH`` answers 2xx within two seconds."""
    try:
        get(address, path, seconds=2.0)
    except httpx.HTTPError:
        return False
    return True
