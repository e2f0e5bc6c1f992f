"""An acknowledgement from the command through Alertmanager and exporter to the dashboard."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from ros_diagnostics_tools.commands import ack
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
MOTOR = ("robot_1", "Motor 1")


@pytest.fixture
def stack(tmp_path: Path) -> Iterator[Stack]:
    with running(tmp_path, Plan(robots=1, clocks=Clocks(confirm_after=2)), Inbox()) as stack:
        yield stack


def rows(stack: Stack) -> dict[tuple[str, str], str]:
    """Robot and component of each row of the table: whether it is confirmed."""
    found = [sample.labels for sample in stack.query(PROBLEMS["A"])]
    problems = [each for each in found if "robot" in each]  # without any: a row that says so
    return {(each["robot"], each["component"]): each["confirmed"] for each in problems}


def acknowledged(stack: Stack) -> set[str]:
    """The texts of the column that says who acknowledged."""
    return {sample.labels.get("acknowledged", "") for sample in stack.query(PROBLEMS["E"])} - {""}


@pytest.mark.slow
def test_the_table_of_problems_names_the_acknowledgement_of_this_fault_only(stack: Stack):
    url = f"http://{stack.addresses.alertmanager}"
    arguments = ["robot_1", "--author", "ann", "--comment", "spare part ordered", "--url", url]
    up = "ros_diagnostics_exporter_alertmanager_up == 1"
    until(lambda: stack.query(up), "the exporter reads acknowledgements", 60)

    stack.fault("robot_1", "Motor 1", "error")
    until(lambda: ack.main(arguments) == 0, "the fault is acknowledged", 60, every=0.5)
    texts = {"ann: spare part ordered"}
    until(lambda: acknowledged(stack) == texts, lambda: f"the cell: {acknowledged(stack)}", 60)
    assert rows(stack) == {MOTOR: "yes"}

    stack.fault("robot_1", "Motor 1", "ok")
    until(lambda: rows(stack) == {}, "it is repaired", 60)

    stack.fault("robot_1", "Motor 1", "error")
    until(lambda: rows(stack) == {MOTOR: "yes"}, "the next fault is confirmed", 60)
    assert not acknowledged(stack) & texts
