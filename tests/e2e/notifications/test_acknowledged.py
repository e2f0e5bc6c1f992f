"""An acknowledgement from the command through Alertmanager and exporter to the dashboard."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from ros_diagnostics_exporter.cli import ack
from support.committed_dashboards import filled, queries
from testbed.configuration import Clocks
from testbed.mail import Inbox
from testbed.polling import until
from testbed.stack import Plan, Stack, running

PROBLEMS = {
    question.ref: filled(question.expr)
    for question in queries()
    if (question.board, question.place) == ("ros-diagnostics-fleet", "Problems")
}
MOTOR = {"fleet": "demo", "robot": "robot_1", "component": "Motor 1"}


@pytest.fixture
def stack(tmp_path: Path) -> Iterator[Stack]:
    with running(tmp_path, Plan(robots=1, clocks=Clocks(confirm_after=2)), Inbox()) as stack:
        yield stack


def cells(stack: Stack, ref: str) -> list[dict[str, str]]:
    """The labels of a column of the problems table, without the group."""
    return [
        {name: value for name, value in sample.labels.items() if name not in {"group", "__name__"}}
        for sample in stack.query(PROBLEMS[ref])
    ]


def test_the_table_of_problems_names_the_acknowledgement_of_this_fault_only(stack: Stack):
    url = f"http://{stack.addresses.alertmanager}"
    arguments = ["robot_1", "--author", "ann", "--comment", "spare part ordered", "--url", url]
    up = stack.query("ros_diagnostics_exporter_alertmanager_up")
    assert [sample.value for sample in up] == [1]

    stack.fault("robot_1", "Motor 1", "error")
    until(lambda: ack.main(arguments) == 0, "the fault is acknowledged", 60, every=0.5)
    acknowledged = [MOTOR | {"acknowledged": "ann: spare part ordered"}]
    until(lambda: cells(stack, "G") == acknowledged, lambda: f"the cell: {cells(stack, 'G')}", 30)
    assert cells(stack, "A") == [MOTOR]

    stack.fault("robot_1", "Motor 1", "ok")
    until(lambda: cells(stack, "A") == [], "it is repaired", 30)
    assert cells(stack, "G") == []

    stack.fault("robot_1", "Motor 1", "error")
    until(lambda: cells(stack, "D") == [MOTOR], "the next fault is confirmed", 60)
    assert stack.query("ros_diagnostics_acknowledged_timestamp_seconds"), "it is still in force"
    assert cells(stack, "G") == []
