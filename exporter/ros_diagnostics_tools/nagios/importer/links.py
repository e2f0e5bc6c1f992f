"""Links of Nagios' hosts and services -> those of robots in fleet.yml."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from ros_diagnostics_exporter.config.errors import WrongValueError
from ros_diagnostics_exporter.config.links import MAX_NAME, link, link_name
from ros_diagnostics_tools.nagios.importer.inheritance import Thing
from ros_diagnostics_tools.nagios.importer.site import Service, Site

KEYS = ("notes_url", "action_url")


def links(site: Site, host: Thing, services: Iterable[Service], where: str) -> dict[str, Any]:
    """The key `links` of a robot, ``where`` in fleet.yml; {} without links."""
    found = dict(_of(site, host, host, None, where))
    for service in services:
        found |= _of(site, service.thing, host, service, where)
    return {"links": found} if found else {}


def _of(
    site: Site, thing: Thing, host: Thing, service: Service | None, where: str
) -> Iterator[tuple[str, str]]:
    """The links of a host, or of a service: their names and addresses."""
    for key in KEYS:
        if key not in thing:
            continue
        name = f"{service.name} {key}" if service else key
        name = name[-MAX_NAME:].strip()
        try:
            yield link_name(name), link(site.filled(thing.get(key), host, service))
            thing.take(key, f"{where}.links[{name}]")
        except WrongValueError as error:
            thing.lose(key, f"{error}: add it to links of the robot in fleet.yml")
