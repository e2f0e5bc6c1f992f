"""Contacts whose hours relieve one another -> oncall.yml.

Several contacts of one host or service all receive its notifications in Nagios. Only where their
hours share out the week, without a gap and without an overlap, is one of them on call at a time.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any, NamedTuple

from ros_diagnostics_exporter.config.scalars import DAY
from ros_diagnostics_tools.nagios.importer.hours import Hours
from ros_diagnostics_tools.nagios.importer.inheritance import Thing
from ros_diagnostics_tools.nagios.importer.site import Site

WHERE = "oncall.yml"
SINCE = "2024-01-01T00:00"  # a Monday; with one person in a shift it makes no difference
_PHONE = re.compile(r"\+[1-9]\d{6,14}")


class Turn(NamedTuple):
    """When a contact receives notifications."""

    contact: str
    hours: Hours


def relieve_one_another(hours: Iterable[Hours]) -> bool:
    """Whether at any time of any week exactly one of several holds."""
    every = list(hours)
    if len(every) < 2 or any(each.muted or each.added for each in every):
        return False
    for day in range(7):
        ranges = sorted(each for one in every for each in one.weekly[day])
        ends = [0, *(end for _, end in ranges)]
        if [start for start, _ in ranges] != ends[:-1] or ends[-1] != DAY:
            return False
    return True


def content(site: Site, rotas: dict[str, list[Turn]], time_zone: str) -> dict[str, Any] | None:
    """The content of oncall.yml, or None where nobody relieves anybody; ``rotas`` by receiver."""
    if not rotas:
        return None
    names = dict.fromkeys(turn.contact for turns in rotas.values() for turn in turns)
    people = {name: _person(site.find("contact", name)) for name in names}
    teams = [
        {"name": receiver, "levels": {"first": {"receiver": receiver, "shifts": _shifts(turns)}}}
        for receiver, turns in rotas.items()
    ]
    return {"time_zone": time_zone, "people": people, "teams": teams}


def _person(contact: Thing | None) -> dict[str, str]:
    if contact is None:
        return {}
    found = {"email": contact.take("email", f"{WHERE}: people")}
    if _PHONE.fullmatch(contact.get("pager")):
        found["phone"] = contact.take("pager", f"{WHERE}: people")
    return found


def _shifts(turns: list[Turn]) -> list[dict[str, Any]]:
    return [
        {"people": [turn.contact], "since": SINCE, "hours": turn.hours.inside()} for turn in turns
    ]
