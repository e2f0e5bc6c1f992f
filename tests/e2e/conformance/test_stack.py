"""The shipped rules and routes, on real servers, notify as the distribution's Nagios does."""

from __future__ import annotations

from pathlib import Path

import pytest

from conformance import nagios, stack
from conformance.histories import HOSTS, LEVELS, SEVERAL, SOFT_AND_HARD
from conformance.history import History
from testbed import short_clocks

LONGEST = 12  # ticks, so that it takes minutes only
HISTORIES = [
    each
    for each in (*SOFT_AND_HARD, *LEVELS, *HOSTS, *SEVERAL)
    if each.ticks <= LONGEST and not each.flapping
]
SOFT = "ros_diagnostics_component_problem_level == 2"

pytestmark = [pytest.mark.e2e, pytest.mark.slow, pytest.mark.timeout(900)]


def differing(folder: Path, histories: list[History], **more) -> list[str]:
    """What differs without a reason, as text."""
    (folder / "stack").mkdir()
    theirs = nagios.Nagios(folder / "nagios", histories).play()
    ours = stack.play(folder / "stack", histories, **more)
    return [
        f"{history.name}: Nagios {stack.by_object(expected)}, here {found}"
        for history, expected, found in zip(histories, theirs, ours, strict=True)
        if stack.by_object(expected) != found and not history.reason
    ]


def test_alertmanager_sends_what_nagios_notifies(tmp_path):
    found = differing(tmp_path, HISTORIES)

    assert len(HISTORIES) >= 40
    assert not found, "\n".join(found)


def notify_soft_problems(rules: Path) -> None:
    def change(document):
        (alert,) = [
            rule
            for rule in document["groups"][0]["rules"]
            if rule.get("alert") == "RosDiagnosticsComponentCritical"
        ]
        alert["expr"] = SOFT

    short_clocks.edit(rules / "faults.yml", change)


def test_a_rule_that_does_not_wait_for_the_confirmation_is_found(tmp_path):
    soft = [each for each in SOFT_AND_HARD if each.ticks <= 6]

    found = differing(tmp_path, soft, change_rules=notify_soft_problems)

    assert any(each.startswith("a recovery while soft:") for each in found), found
