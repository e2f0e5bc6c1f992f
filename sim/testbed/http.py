"""HTTP requests to servers on this machine, with httpx."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import httpx

# No proxy of the environment, and a connection for each request: servers are restarted.
_CLIENT = httpx.Client(trust_env=False, limits=httpx.Limits(max_keepalive_connections=0))
# No connection, a timeout, or a status other than 2xx.
Unanswered = httpx.HTTPError


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


def get_json(address: str, path: str, seconds: float = 5.0) -> Any:
    """Return the parsed JSON of ``http://ADDRESS PATH``; raises as `get`."""
    return json.loads(get(address, path, seconds))


def ask(address: str, path: str, form: Mapping[str, Any]) -> Any:
    """Return the parsed JSON of the answer to a form.

    Raises:
        Unanswered: As `get`.
        ValueError: The form is rejected; the text has the reason, and the form.
    """
    response = _CLIENT.post(f"http://{address}{path}", data=form, timeout=60.0)
    if response.status_code in {400, 422}:
        raise ValueError(f"{response.json()['error']}\n{form}")
    return response.raise_for_status().json()


def answers(address: str, path: str) -> bool:
    """Return whether ``http://ADDRESS PATH`` answers 2xx within two seconds."""
    try:
        get(address, path, seconds=2.0)
    except Unanswered:
        return False
    return True
