"""What the web is handed: callables, and the words in which they answer.

The only thing that the HTTP room knows of the rest of the exporter. Every callable is called from
a thread of the web's own, up to four at once, and may block.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from ros_diagnostics_exporter.events import Wanted


@dataclass(frozen=True)
class Doors:
    """Ways into the exporter.

    Attributes:
        metrics: The whole exposition; True asks for OpenMetrics, False for the text format 0.0.4.
        fleet: The fleet as /api/v1/fleet answers it.
        events: What happened, newest first, each with its ``id``.
        targets: Prometheus' http_sd list of a job (node, ping, ssh, http, tcp), at a port if one
            is given; raises LookupError for a job that is unknown, ValueError for a port that is
            missing or too much.
        ready: None when messages are subscribed to, else why not.
        reload: Read the config again; raises ValueError with the text for the person who asked.
        forget: Take out a robot, or one of its components; how many components went. Raises
            LookupError when there is none of that name.
    """

    metrics: Callable[[bool], bytes]
    fleet: Callable[[], dict[str, Any]]
    events: Callable[[Wanted], Iterable[dict[str, Any]]]
    targets: Callable[[str, int | None], list[dict[str, Any]]]
    ready: Callable[[], str | None]
    reload: Callable[[], None]
    forget: Callable[[str, str | None], int]
