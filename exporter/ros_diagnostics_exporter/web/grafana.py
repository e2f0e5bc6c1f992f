"""Links from the pages to the dashboards, where `--grafana.url` says who serves them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple
from urllib.parse import urlencode

FLEET, ROBOT = "ros-diagnostics-fleet", "ros-diagnostics-robot"
AROUND = 900.0  # seconds before a fault and after it


class Grafana(NamedTuple):
    """The server at ``url``; without one no page has a link to it."""

    url: str = ""

    def of(self, fleet: str, robot: str = "", fault: Mapping[str, Any] | None = None) -> str:
        """The address of a robot's dashboard, without one of the fleet's; "" without a server.

        Its time is that of ``fault``, with `since` and perhaps `until`.
        """
        if not self.url:
            return ""
        query = {"var-fleet": fleet} | ({"var-robot": robot} if robot else {})
        if fault:
            until = fault.get("until")
            query["from"] = _ms(fault["since"] - AROUND)
            query["to"] = "now" if until is None else _ms(until + AROUND)
        board = ROBOT if robot else FLEET
        return f"{self.url.rstrip('/')}/d/{board}?{urlencode(query, errors='replace')}"


def _ms(unix: float) -> str:
    return str(int(unix * 1000))
