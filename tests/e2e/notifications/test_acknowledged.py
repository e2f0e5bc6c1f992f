"""An acknowledgement from the command through Alertmanager and exporter to the dashboard."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from ros_diagnostics_tools.main import main
from support.committed_dashboards import filled, queries
from testbed.configuration import Clocks
from testbed.polling import until
from testbed.site import Site
from testbed.stack import Plan, running

PROBLEMS = {
    question.ref: filled(question.expr)
    for question in queries()
    if (question.board, question.place) == ("ros-diagnostics-fleet", "Problems")
}
MOTOR = ("robot_1", "Motor 1")


@pytest.fixture
def stack(tmp_path: Path) -> Iterator[Site]:
    with running(tmp_path, Plan(robots=1, clocks=Clocks(confirm_after=2))) as stack:
        yield stack


def care(stack: Site) -> dict[tuple[str, str], str]:
    """Robot and component of each row of the table: what its column Care says."""
    found = [sample.labels for sample in stack.query(PROBLEMS["C"])]
    problems = [each for each in found if "robot" in each]  # without any: a row that says so
    return {(each["robot"], each["component"]): each["care"] for each in problems}


@pytest.mark.slow
def test_the_table_of_problems_names_the_acknowledgement_of_this_fault_only(stack: Site):
    url = f"http://{stack.addresses.alertmanager}"
    arguments = ["ack", "robot_1", "--author", "ann", "--comment", "spare part ordered"]
    arguments += ["--alertmanager", url]
    up = "ros_diagnostics_exporter_alertmanager_up == 1"
    until(lambda: stack.query(up), "the exporter reads acknowledgements", 60)

    stack.fault("robot_1", "Motor 1", "error")
    until(lambda: main(arguments) == 0, "the fault is acknowledged", 60, every=0.5)
    ann = "ann: spare part ordered"
    until(lambda: care(stack) == {MOTOR: ann}, lambda: f"the cell: {care(stack)}", 60)

    stack.fault("robot_1", "Motor 1", "ok")
    until(lambda: care(stack) == {}, "it is repaired", 60)

    stack.fault("robot_1", "Motor 1", "error")
    until(
        lambda: care(stack).get(MOTOR) not in (None, "not confirmed"), "the next fault is there", 60
    )
    assert care(stack)[MOTOR] != ann
