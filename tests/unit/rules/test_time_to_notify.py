"""From a confirmed fault to its mail: what the shipped clocks take together, at most.

How long it takes on real servers, beside this sum: `./run bench notify`.
"""

from collections.abc import Iterator, Mapping
from typing import Any

import pytest
import yaml

from support.shipped_rules import ALERTMANAGER, PROMETHEUS, seconds_to_notify

LIMIT = 10.0  # seconds beyond confirm_after
FAULTS = yaml.safe_load((PROMETHEUS / "rules" / "faults.yml").read_text())["groups"]
ROUTE = yaml.safe_load((ALERTMANAGER / "alertmanager.yml").read_text())["route"]


def test_the_steps_together_are_short():
    assert sum(seconds_to_notify().values()) <= LIMIT


@pytest.mark.parametrize(
    "alert",
    [rule for group in FAULTS for rule in group["rules"] if "alert" in rule],
    ids=lambda rule: rule["alert"],
)
def test_an_alert_of_a_fault_fires_at_the_first_evaluation(alert: dict[str, Any]):
    assert "for" not in alert  # the exporter has confirmed it already


def test_no_route_of_single_notifications_waits_longer():
    assert [each["group_wait"] for each in _routes(ROUTE) if "group_wait" in each] == ["1s"]


def _routes(route: Mapping[str, Any]) -> Iterator[Mapping[str, Any]]:
    yield route
    for each in route.get("routes", []):
        yield from _routes(each)
