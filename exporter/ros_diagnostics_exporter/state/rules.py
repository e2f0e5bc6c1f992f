"""Which rule applies to a component, to a value; which checks hold one; of which robot it is.

Rules are looked up once for a component or a key, when it is first seen, not for every message.
What robots say is cut before it is searched: see `patterns`.
"""

from __future__ import annotations

from ros_diagnostics_exporter.config.fleet import (
    Check,
    ComponentRule,
    Profile,
    Shared,
    ValueRule,
)
from ros_diagnostics_exporter.config.scalars import is_name

SEARCHED = 256  # characters of a robot's string; what is beyond cannot match


def component_rule(profile: Profile, name: str) -> ComponentRule | None:
    """The first rule whose pattern is found in the component's name."""
    name = name[:SEARCHED]
    return next((rule for rule in profile.components if rule.pattern.search(name)), None)


def value_rule(profile: Profile, component: str, key: str) -> ValueRule | None:
    """The first rule that holds for the component and matches the whole key.

    Drivers of both updaters write keys like ``Received packets:``; a rule need not.
    """
    component, key = component[:SEARCHED], key[:SEARCHED]
    for rule in profile.values:
        if rule.component is not None and not rule.component.search(component):
            continue
        if rule.key is None or rule.key.fullmatch(key) or rule.key.fullmatch(key.rstrip(": ")):
            return rule
    return None


def check_matches(check: Check, group: str, component: str) -> bool:
    """Whether the check holds the component; patterns are searched in ``group/component``."""
    path = f"{group[:SEARCHED]}/{component[:SEARCHED]}"
    return not check.patterns or any(pattern.search(path) for pattern in check.patterns)


def shared_identity(shared: Shared, hardware_id: str, name: str) -> tuple[str, str] | None:
    """Of which robot a status on a shared topic is, and which component of it.

    Returns:
        The names of the robot and of the component; None where the status does not say.
    """
    said = hardware_id if shared.by == "hardware_id" else name
    if shared.pattern is None:
        return (said, name) if is_name(said) else None
    match = shared.pattern.fullmatch(said) if len(said) <= SEARCHED else None
    if match is None or not is_name(match["robot"] or ""):
        return None
    return match["robot"], match.groupdict().get("component") or name
