"""What of fleet.yml's capabilities may be forgotten, by what is known live: components, names.

Notes, not errors: a component that no capability needs has notifications of its own.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from ros_diagnostics_exporter.config.capabilities import (
    CapabilityOf,
    CheckOf,
    ComponentsOf,
    in_order,
    parts_of,
)
from ros_diagnostics_exporter.config.fleet import Fleet, Profile
from ros_diagnostics_exporter.fleet.unmatched import KnownRobot
from ros_diagnostics_exporter.robots.rules import SEARCHED, check_matches
from ros_diagnostics_exporter.texts import first_few

_MOST = 10  # names in a note

_Named = set[tuple[str, str]]  # group, component


def capability_notes(fleet: Fleet, known: Iterable[KnownRobot]) -> list[str]:
    """A line for each profile with components in no capability, and for each that nothing feeds.

    Profiles without capabilities, and those of which no robot was received, have none.
    """
    robots = list(known)
    return [
        note
        for profile in fleet.profiles.values()
        if profile.capabilities
        for note in _of_profile(profile, [each for each in robots if each.profile == profile.name])
    ]


def _of_profile(profile: Profile, robots: list[KnownRobot]) -> Iterator[str]:
    components = {(part[0], part[1]) for robot in robots for part in robot.components}
    if not components:
        return
    fed = _fed(profile, components)
    for name, found in fed.items():
        if not found:
            yield f"profile {profile.name}: nothing that was received feeds capability {name}"
    names = sorted({name for _group, name in components.difference(*fed.values())})
    if names:
        yield (
            f"profile {profile.name}: {len(names)} components in no capability: "
            f"{first_few(names, _MOST)}"
        )


def _fed(profile: Profile, components: _Named) -> dict[str, _Named]:
    """Of each capability, the components that it rests on."""
    fed: dict[str, _Named] = {}
    checks = {check.name: check for check in profile.checks}
    for capability in in_order(profile.capabilities):
        found = fed[capability] = set()
        for need in parts_of(profile.capabilities[capability].need):
            if isinstance(need, CapabilityOf):
                found |= fed[need.name]
            elif isinstance(need, CheckOf):
                found |= {each for each in components if check_matches(checks[need.name], *each)}
            elif isinstance(need, ComponentsOf):
                found |= {
                    each
                    for each in components
                    if any(one.search(each[1][:SEARCHED]) for one in need.patterns)
                }
    return fed
