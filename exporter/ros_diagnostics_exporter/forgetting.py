"""What a person forgets at one exporter is forgotten by all exporters of the fleet.

Exporters do not know each other. A silence in Alertmanager that matches no alert passes it on:
every exporter reads it, as it reads acknowledgements and downtimes.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable
from datetime import datetime, timedelta, timezone

from ros_diagnostics_exporter.alertmanager import Alertmanager
from ros_diagnostics_exporter.faults.model import Fault, Identity
from ros_diagnostics_exporter.fleet.state import FleetState
from ros_diagnostics_exporter.http_client import UnreachableError
from ros_diagnostics_exporter.model import Instant
from ros_diagnostics_exporter.silences import Forgotten, forgotten_matchers, moment, silence

LASTS = timedelta(days=1)  # for an exporter that is down meanwhile
AUTHOR = "ros-diagnostics forget"
COMMENT = "has the other exporters of the fleet forget it, and silences nothing"

log = logging.getLogger(__name__)


class Forgetting:
    """What one exporter forgets, by its own API or because another one has."""

    def __init__(self, state: FleetState, alertmanager: Alertmanager | None) -> None:
        self._state, self._alertmanager = state, alertmanager
        self._known: set[Forgotten] = set()  # that were followed here

    def forget(self, robot: str, component: str | None, now: Instant) -> tuple[int, bool]:
        """Forget a robot or a component of it, and pass it on.

        Returns how many components, and whether other exporters read it from Alertmanager.

        Raises:
            LookupError: there is none of that name.
        """
        number = self._state.forget(robot, component, now)
        return number, self._pass_on(robot, component or "", now)

    def _pass_on(self, robot: str, component: str, now: Instant) -> bool:
        if self._alertmanager is None:
            return False
        begin = datetime.fromtimestamp(now.wall, timezone.utc)
        text = begin.isoformat(timespec="microseconds")
        self._known.add(Forgotten(robot, component, moment(text) or now.wall))
        matchers = forgotten_matchers(self._state.fleet.name, robot, component, text)
        try:
            self._alertmanager.add(silence(matchers, begin, begin + LASTS, AUTHOR, COMMENT))
        except UnreachableError as error:
            log.warning("other exporters do not forget robot %r as well: %s", robot, error)
            return False
        return True

    def forget_passed_on(self, now: Instant) -> None:
        """Forget what a person has others forget, if its trouble is older than that."""
        passed_on = set() if self._alertmanager is None else set(self._alertmanager.forgotten)
        for forgotten in passed_on - self._known:
            self._known.add(forgotten)
            if self._has(forgotten, now):
                what = forgotten.robot, forgotten.component or None
                log.info("robot %r, component %r: a person has them forgotten", *what)
                self._state.forget(*what, now)

    def _has(self, forgotten: Forgotten, now: Instant) -> bool:
        """Whether a problem of it was there when a person had it forgotten."""
        try:
            problems = self._state.problems(now, forgotten.robot)
        except LookupError:
            return False  # the robot is not known here
        known = self._state.components_of(forgotten.robot) or ()
        if forgotten.component and forgotten.component not in known:
            return False
        return any(_is_of(forgotten, each.identity, each.since) for each in problems)

    def without_forgotten(self, faults: Iterable[Fault]) -> list[Fault]:
        """Those of the faults whose alerts fire that no person has had forgotten since."""
        passed_on = [] if self._alertmanager is None else self._alertmanager.forgotten
        return [
            fault
            for fault in faults
            if not any(_is_of(each, fault.identity, fault.since) for each in passed_on)
        ]


def _is_of(forgotten: Forgotten, identity: Identity, since: float) -> bool:
    is_part = forgotten.component in ("", identity.component)
    return identity.robot == forgotten.robot and is_part and since < forgotten.at
