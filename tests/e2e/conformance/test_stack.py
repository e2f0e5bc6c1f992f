"""The shipped rules and routes, on real servers, notify as the distribution's Nagios does."""

import pytest

from conformance import nagios, stack
from conformance.histories import HOSTS, LEVELS, SEVERAL, SOFT_AND_HARD

LONGEST = 12  # ticks, so that it takes minutes only
HISTORIES = [
    each
    for each in (*SOFT_AND_HARD, *LEVELS, *HOSTS, *SEVERAL)
    if each.ticks <= LONGEST and not each.flapping
]

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]


def test_alertmanager_sends_what_nagios_notifies(tmp_path):
    (tmp_path / "stack").mkdir()
    theirs = nagios.Nagios(tmp_path / "nagios", HISTORIES).play()
    ours = stack.notifications(tmp_path / "stack", HISTORIES)
    differing = [
        f"{history.name}: Nagios {expected}, here {found}"
        for history, expected, found in zip(
            HISTORIES, map(stack.by_object, theirs), map(stack.by_object, ours), strict=True
        )
        if expected != found and not history.reason
    ]

    assert len(HISTORIES) >= 40
    assert not differing, "\n".join(differing)
