"""Ask a server on 127.0.0.1 over HTTP."""

from __future__ import annotations

import http.client
import json
from typing import Any, NamedTuple
from urllib.parse import quote


class Unanswered(Exception):  # noqa: N818 - says what happened, as TimeoutError does
    """The server did not answer, or answered something else than 200."""


def get(address: str, path: str, seconds: float = 5.0) -> bytes:
    """Return what ``http://ADDRESS PATH`` answers.

    Args:
        address: HOST:PORT.
        path: With its leading slash and query.
        seconds: The deadline for connecting, and for each read.

    Raises:
        Unanswered: No connection, no answer in time, or a status other than 200.
    """
    connection = http.client.HTTPConnection(address, timeout=seconds)
    try:
        connection.request("GET", path)
        response = connection.getresponse()
        body = response.read()
    except (OSError, http.client.HTTPException) as error:
        raise Unanswered(f"http://{address}{path}: {error}") from error
    finally:
        connection.close()
    if response.status != http.client.OK:
        raise Unanswered(f"http://{address}{path}: {response.status} {body[:200]!r}")
    return body


def get_json(address: str, path: str) -> Any:
    """Return the JSON that ``http://ADDRESS PATH`` answers; raises as `get` does."""
    return json.loads(get(address, path))


class Sample(NamedTuple):
    """One element of an instant vector."""

    labels: dict[str, str]
    value: float


def query(address: str, promql: str) -> list[Sample]:
    """Return the instant vector that Prometheus computes now.

    Raises:
        Unanswered: As `get`; also for an expression that Prometheus refuses.
    """
    answer = get_json(address, f"/api/v1/query?query={quote(promql)}")
    return [Sample(each["metric"], float(each["value"][1])) for each in answer["data"]["result"]]


def answers(address: str, path: str) -> bool:
    """Say whether ``http://ADDRESS PATH`` answers 200 at once."""
    try:
        get(address, path, seconds=2.0)
    except Unanswered:
        return False
    return True
