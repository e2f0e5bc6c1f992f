"""What a person does by a form of a page: the silences of ros-diagnostics ack and downtime.

Each is an event, with who did it and from which address.
"""

from __future__ import annotations

from datetime import datetime, timezone

from ros_diagnostics_exporter.acknowledging import acknowledged, problems, silence
from ros_diagnostics_exporter.alertmanager import (
    AUTHOR_LENGTH,
    COMMENT_LENGTH,
    SAME,
    Alertmanager,
    clean,
    downtime_matchers,
    downtime_of,
    identity_of,
    moment,
)
from ros_diagnostics_exporter.alertmanager import silence as plain_silence
from ros_diagnostics_exporter.events import Event
from ros_diagnostics_exporter.faults.model import Fault, as_texts
from ros_diagnostics_exporter.model import Person
from ros_diagnostics_exporter.severity import clock


def acknowledge(
    alertmanager: Alertmanager, fleet: str, fault: Fault, person: Person, now: float
) -> Event:
    """Acknowledge a fault of a fleet that lasts; what was done, as an event.

    Raises:
        LookupError: No alert of it fires, or somebody has acknowledged it.
        UnreachableError: No Alertmanager answers.
    """
    texts = {"fleet": fleet, **as_texts(fault.identity, fault.labels)}
    known = [
        each
        for each in problems(alertmanager.alerts(fleet))
        if identity_of(each.labels) == identity_of(texts)
        and each.since
        and abs(moment(each.since) - fault.since) <= 1.0
    ]
    if not known:
        raise LookupError("no alert of it fires: there is nothing to acknowledge yet")
    before = acknowledged(known[0], alertmanager.silences(fleet))
    if before is not None:
        raise LookupError(f"it is already acknowledged by {clean(before['createdBy'], 64)}")
    begin = datetime.fromtimestamp(now, timezone.utc)
    author, comment = _words(person)
    alertmanager.add(silence(known[0], author, comment, begin))
    message = f"{comment} (from {person.address})"
    return Event(
        now,
        "action",
        **as_texts(fault.identity, fault.labels),
        after="acknowledged",
        message=message,
        author=author,
        since=fault.since,
    )


def plan_downtime(
    alertmanager: Alertmanager,
    fleet: str,
    of: tuple[str, str],
    person: Person,
    times: tuple[float, float],
) -> Event:
    """Plan a downtime ``of`` a robot and its component ("" for all); what was done, as an event.

    ``times`` are its begin and end, Unix time.

    Raises:
        UnreachableError: No Alertmanager answers.
    """
    robot, component = of
    begin, end = (datetime.fromtimestamp(each, timezone.utc) for each in times)
    author, comment = _words(person)
    matchers = downtime_matchers(fleet, robot, component)
    alertmanager.add(plain_silence(matchers, begin, end, author, comment))
    until = clock(times[1], times[0], local=False)
    return Event(
        times[0],
        "action",
        robot=robot,
        component=component,
        after="downtime",
        message=f"until {until}: {comment} (from {person.address})",
        author=author,
    )


def cancel_downtime(
    alertmanager: Alertmanager,
    fleet: str,
    of: tuple[str, str, float],
    person: Person,
    now: float,
) -> Event:
    """End the downtimes ``of`` a robot and its component that last until then; what was done.

    Raises:
        LookupError: There is none (any more).
        UnreachableError: No Alertmanager answers.
    """
    robot, component, until = of
    known = [
        each["id"]
        for each in alertmanager.silences(fleet)
        if (planned := downtime_of(each, fleet)) is not None
        and planned[:2] == (robot, component)
        and abs(planned.end - until) <= SAME
    ]
    if not known:
        raise LookupError("there is no such downtime any more")
    for name in known:
        alertmanager.end(name)
    author, comment = _words(person)
    end = clock(until, now, local=False)
    return Event(
        now,
        "action",
        robot=robot,
        component=component,
        after="cancelled",
        message=f"it was until {end}: {comment} (from {person.address})",
        author=author,
    )


def _words(person: Person) -> tuple[str, str]:
    """Author and comment as others will see them."""
    return clean(person.user, AUTHOR_LENGTH), clean(person.comment, COMMENT_LENGTH)
