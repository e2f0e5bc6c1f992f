"""Which rule of fleet.yml applies to a component or a value, and which checks select a component.

Rules are looked up once for a component or a key, when it is first seen, not for every message.
Strings of robots are cut before they are searched: see `patterns`.
"""

from __future__ import annotations

from ros_diagnostics_exporter.config.fleet import Check, ComponentRule, Profile, ValueRule
from ros_diagnostics_exporter.regex import Pattern

SEARCHED = 256  # characters of a robot's string; what is beyond cannot match


def component_rule(profile: Profile, name: str) -> ComponentRule | None:
    """The first rule whose pattern is found in the component's name."""
    name = name[:SEARCHED]
    return next((rule for rule in profile.components if rule.pattern.search(name)), None)


def value_rule(profile: Profile, component: str, key: str) -> ValueRule | None:
    """The first rule that matches."""
    return next((rule for rule in profile.values if value_matches(rule, component, key)), None)


def value_matches(rule: ValueRule, component: str, key: str) -> bool:
    """Whether the rule selects the component and matches the whole key.

    Drivers of both updaters write keys like ``Received packets:``; a rule need not.
    """
    if not selects_component(rule, component):
        return False
    return rule.key is None or key_matches(rule.key, key)


def selects_component(rule: ValueRule, component: str) -> bool:
    """Whether the rule may match values of the component."""
    return rule.component is None or bool(rule.component.search(component[:SEARCHED]))


def key_matches(pattern: Pattern, key: str) -> bool:
    """Whether it matches the whole key, with or without the colon at its end."""
    key = key[:SEARCHED]
    return pattern.fullmatch(key) is not None or pattern.fullmatch(key.rstrip(": ")) is not None


def check_matches(check: Check, group: str, component: str) -> bool:
    """Whether the check selects the component; patterns are searched in ``group/component``."""
    path = f"{group[:SEARCHED]}/{component[:SEARCHED]}"
    return not check.patterns or any(pattern.search(path) for pattern in check.patterns)
