"""What the web server needs of the rest of the exporter."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Protocol

from ros_diagnostics_exporter.events import Wanted
from ros_diagnostics_exporter.model import Part, Person
from ros_diagnostics_exporter.rejected_logins import RejectedLogins


class Backend(Protocol):
    """The source of everything that is served.

    The methods are called from worker threads, up to four at once, and may block.
    """

    rejected_logins: RejectedLogins

    def render_metrics(self, openmetrics: bool, parts: frozenset[Part], /) -> Sequence[bytes]:
        """These parts of the exposition, as OpenMetrics or in the text format 0.0.4, in pieces."""

    def count_scrape(self) -> None:
        """Note that a scrape was answered; called from the event loop, must not block."""

    def fleet_snapshot(self) -> dict[str, Any]:
        """The fleet as /api/v1/fleet returns it."""

    def faults(self) -> dict[str, Any]:
        """The faults that last as /api/v1/faults returns them."""

    def fault_history(self, fault: str, /) -> dict[str, Any]:
        """Each time that a fault lasted as /api/v1/faults/ID returns it."""

    def recording(self, fault: str, so_far: bool, /) -> bytes:
        """The newest recording around the begin of a fault, as MCAP.

        Raises:
            LookupError: There is none; the text says why.
        """

    def last_event(self) -> int:
        """The id of the last event, 0 before the first; from the event loop, must not block."""

    def find_events(self, wanted: Wanted, /) -> Iterable[dict[str, Any]]:
        """The events that match the filter, newest first, each with its ``id``."""

    def why(
        self, robot: str, component: str | None, at: float | None, /, *, ask: bool = True
    ) -> dict[str, Any]:
        """The history of a robot at a Unix time (None: now) as /api/v1/why returns it.

        With ``ask`` Alertmanager is asked, which may take some seconds.

        Raises:
            LookupError: There is no such robot.
        """

    def capabilities(self, robot: str | None, /) -> dict[str, Any]:
        """What a robot, or None the fleet, can do as /api/v1/capabilities returns it.

        Raises:
            LookupError: There is no such robot.
        """

    def missions(self, robot: str | None, /) -> dict[str, Any]:
        """How the goals of a robot, or (None) of all, ended as /api/v1/missions returns it.

        Raises:
            LookupError: There is no such robot.
        """

    def notified(self, body: bytes, /) -> tuple[int, int]:
        """Record the notifications of a message of Alertmanager's webhook: how many, how many not.

        Raises:
            ValueError: It is no such message; the text says why.
        """

    def acknowledge(self, fault: str, person: Person, /) -> None:
        """Have Alertmanager know that a person takes care of a fault, and record it.

        Raises:
            LookupError: There is nothing to acknowledge; the text says why.
            ConnectionError: No Alertmanager answers.
        """

    def plan_downtime(
        self, robot: str, component: str, begin: float, seconds: float, person: Person, /
    ) -> None:
        """Plan a downtime of a robot, or of one component of it, and record it.

        It begins at ``begin`` (Unix time) and lasts so many seconds.

        Raises:
            LookupError: There is no such robot or component.
            ConnectionError: No Alertmanager answers.
        """

    def cancel_downtime(self, robot: str, component: str, until: float, person: Person, /) -> None:
        """End a downtime of a robot or component that lasts until then (Unix time), and record it.

        Raises:
            LookupError: There is no such downtime.
            ConnectionError: No Alertmanager answers.
        """

    def targets(self, job: str, port: int | None, /) -> list[dict[str, Any]]:
        """The http_sd list of a job (node, ping, ssh, http, tcp), at ``port`` if one is given.

        Raises:
            LookupError: The job is unknown.
            ValueError: The job needs a port, or takes none.
        """

    def hanging_reason(self) -> str | None:
        """Why a restart may help; None while all goes on. From the event loop, must not block."""

    def not_ready_reason(self) -> str | None:
        """Why the exporter is not ready; None when it subscribes to the robots' messages."""

    def reload(self) -> None:
        """Reload the configuration.

        Raises:
            ValueError: The configuration is invalid; the text lists every error.
        """

    def forget(self, robot: str, component: str | None, /) -> tuple[int, bool]:
        """Remove a robot, or one of its components.

        Returns the number of components removed, and whether other exporters follow.

        Raises:
            LookupError: There is none of that name.
        """

    def accept_graph(self, robot: str, /) -> int:
        """Take what the ROS graph shows of a robot as expected; how many nodes are.

        Raises:
            LookupError: Nothing of such a robot was ever seen there.
        """
