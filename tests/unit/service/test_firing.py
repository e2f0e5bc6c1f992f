"""Alertmanager's alerts as faults: those that the shipped rules make, and no others."""

from typing import Any

import pytest

from ros_diagnostics_exporter import firing
from ros_diagnostics_exporter.config.fleet import Fleet
from ros_diagnostics_exporter.config.shard import Shard
from ros_diagnostics_exporter.faults.model import Fault, Identity, Scope, State
from ros_diagnostics_exporter.silences import Alert, valid
from support.as_listed import read_firing

MOTOR = {
    "alertname": "RosDiagnosticsComponentCritical",
    "fault": "0123456789ab",
    "fleet": "f",
    "scope": "component",
    "state": "critical",
    "severity": "critical",
    "site": "hall",
    "team": "arms",
    "robot": "r1",
    "group": "/Motor",
    "component": "Motor 1",
}
SINCE = "2026-01-01 10:00:00.5 +0000 UTC"
SITE = {"fleet": "f", "scope": "site", "state": "silent", "severity": "critical", "site": "hall"}


def alert(
    labels: dict[str, str], evidence: str = "over current", since: str = SINCE
) -> dict[str, Any]:
    annotations = {"evidence": f"since {since};\n{evidence}"}
    return {"labels": labels, "annotations": annotations, "startsAt": "2026-01-01T10:00:12.5Z"}


def test_an_alert_is_the_fault_that_it_was_made_of():
    identity = Identity(
        Scope.COMPONENT, State.CRITICAL, robot="r1", group="/Motor", component="Motor 1"
    )
    labels = {"site": "hall", "team": "arms"}
    expected = Fault(identity, 1767261600.5005, 1767261612.5, labels, "over current")
    assert read_firing([alert(MOTOR)], "f", "north") == [expected]


def test_a_fault_of_no_robot_is_that_of_the_exporter_of_its_name():
    (found,) = read_firing([alert(SITE)], "f", "")
    assert (found.identity, dict(found.labels)) == (
        Identity(Scope.SITE, State.SILENT, site="hall"),
        {},
    )
    assert read_firing([alert({**SITE, "exporter": "south"}), alert(SITE)], "f", "north") == []


def test_what_shards_judge_alike_is_the_fault_of_each_and_what_is_wrong_with_one_its_own():
    own = {**SITE, "scope": "exporter", "state": "warning", "severity": "warning", "site": ""}
    named = [{**SITE, "exporter": "shard"}, {**own, "component": "database", "exporter": "shard-1"}]
    listed = valid(Alert, list(map(alert, named)))
    shards = [Fleet("f").part(Shard(number, 2)) for number in (1, 2)]
    found = [[each.identity.scope for each in firing.read(listed, fleet)] for fleet in shards]
    assert found == [[Scope.SITE, Scope.EXPORTER], [Scope.SITE]]


@pytest.mark.parametrize(
    "wrong",
    [
        alert({**MOTOR, "fleet": "g"}),
        alert({**MOTOR, "scope": "host"}),
        alert({**MOTOR, "severity": "warning"}),
        alert({**MOTOR, "robot": ""}),
        alert({**SITE, "robot": "r1"}),
        alert({**MOTOR, "robot": "\ud800"}),
        alert({**MOTOR, **{f"l{number}": "x" for number in range(100)}}),
        alert(MOTOR, since="yesterday"),
        alert(
            MOTOR, "OK: running;\nended 2026-01-01 11:00:00 UTC, after 1h"
        ),  # on its way to resolve
        {"labels": MOTOR},
        None,
    ],
)
def test_what_the_rules_do_not_make_is_skipped(wrong):
    assert read_firing([wrong], "f", "") == []


@pytest.mark.parametrize("thousandth", ["", ".001", ".122", ".123", ".999"])
def test_what_is_adopted_is_written_by_rules_as_before(thousandth):
    """Rules cut a time off to thousandths; as a number a text may be a little earlier."""
    text = f"2023-11-14 22:14:05{thousandth} +0000 UTC"
    (found,) = read_firing([alert(MOTOR, since=text)], "f", "north")
    served = round(found.since, 4)
    milliseconds = int(served * 1e9) // 1_000_000 - 1_700_000_045_000
    assert milliseconds == int(thousandth.removeprefix(".") or 0)
