"""A notification, as both sides are compared."""

from __future__ import annotations

from dataclasses import dataclass

HOST = ""  # the service of a notification about a host
# What is compared; everything else that Nagios notifies is counted only.
STATES = ("OK", "WARNING", "CRITICAL", "UNKNOWN", "UP", "DOWN", "FLAPPINGSTART", "FLAPPINGSTOP")


@dataclass(frozen=True)
class Notice:
    """Somebody was notified at Unix time ``time`` that a robot, or its service, is in a state.

    ``detail`` is what is known beside it: the plug-in's output, or the component.
    """

    time: float
    robot: str
    service: str
    state: str
    detail: str = ""

    @property
    def about(self) -> tuple[str, str]:
        """What it is about."""
        return self.robot, self.service


def changes(notices: list[Notice]) -> list[Notice]:
    """Those that say something new: one for all contacts, and none that is sent again."""
    last: dict[tuple[str, str], str] = {}
    found = []
    for each in sorted(notices, key=lambda notice: notice.time):
        if last.get(each.about) != each.state:
            last[each.about] = each.state
            found.append(each)
    return found
