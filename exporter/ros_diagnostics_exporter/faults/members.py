"""Which robots and components a larger fault is about: what it counts, as one fault."""

from __future__ import annotations

from collections.abc import Iterator

from ros_diagnostics_exporter.faults.book import Book
from ros_diagnostics_exporter.faults.model import ComponentName, Identity, PartName, Scope

Member = tuple[str, ComponentName]  # robot; of a robot as a whole a component without a name


def members(book: Book, identity: Identity) -> Iterator[Member]:
    """The members of a fault of a site, of many robots, or of a capability; others have none."""
    if identity.scope is Scope.CAPABILITY:
        found = {
            (part.robot or identity.robot, ComponentName(part.group, part.component))
            for part in _parts(book, identity)
        }
        yield from sorted(each for each in found if each != (identity.robot, ("", "")))
    elif identity.scope in (Scope.SITE, Scope.COMMON):
        cause = book.causes.get((identity.scope, identity.site or identity.component))
        for robot, groups in cause.counted.items() if cause else ():
            for group in groups:
                yield robot, ComponentName(group, identity.component)


def _parts(book: Book, identity: Identity) -> Iterator[PartName]:
    """What keeps a capability of a robot, or of the fleet, from being OK."""
    robot = book.robots.get(identity.robot)
    capabilities = book.capabilities if robot is None else robot.capabilities
    record = capabilities.get(identity.check)
    yield from record.parts if record else ()
