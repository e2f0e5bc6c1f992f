"""Aborted goals of a real action server, from the robot to the mails; restarts in the middle."""

from __future__ import annotations

import pytest

from support.orders import Orders
from testbed.polling import until
from testbed.site import Site

LASER = "turtlebot4_diagnostics: /scan topic status"
FLEET = """
fleet: hall
robots: [{{name: tb_1, namespace: /tb_1, domain_id: {domain}}}]
profiles:
  default:
    confirm_after: 3s
    actions: [{{match: navigate_to_pose, aborted: {{warning: 2, within: 10m}}}}]
faults: {{restart_grace: 10s}}
"""
SCENARIO = "robots: [{kind: turtlebot4, name: tb_1}]"
RESULTS = "ros_diagnostics_goals_total"
ENDED = "** RECOVERY ** hall/tb_1 {} is no longer {}"
BEGAN = "** PROBLEM ** hall/tb_1 {} is {}"


@pytest.fixture
def stack(site: Site) -> Site:
    """The robot, exporter and all servers; Prometheus has a goal that succeeded."""
    site.start_mail_server()
    site.start_robots(scenario=site.write("scenario.yaml", SCENARIO))
    site.start_exporter(site.write("fleet.yml", FLEET.format(domain=site.domain_id)))
    site.start_prometheus(interval=1)
    site.start_alertmanager(edit=lambda it: it["route"].update(group_interval="1s"))
    site.wait_until_ready(lambda: "" if goals(site).get("succeeded") else "a goal")
    return site


def goals(site: Site) -> dict[str, float]:
    """How many goals ended in which way, as Prometheus has it."""
    return {each.labels["result"]: each.value for each in site.query(RESULTS) if each.value}


def running(site: Site) -> float:
    return sum(each.value for each in site.query("ros_diagnostics_goals_running"))


def wait_for_mails(site: Site, *expected: str) -> None:
    """Exactly these, as far as they are no reminders."""

    def found() -> list[str]:
        return [each for each in site.inbox.subjects() if "UNACKNOWLEDGED" not in each]

    until(lambda: set(found()) >= set(expected), lambda: f"{expected}: {found()}", 120)
    assert sorted(found()) == sorted(expected)


def test_two_aborted_goals_are_a_mail_and_restarts_change_no_count(stack: Site):
    orders = stack.use(Orders(stack.domain_id))
    orders.give([(f"tb_1/{LASER}", "silent")])
    problems = BEGAN.format(LASER, "STALE"), BEGAN.format("navigate_to_pose", "WARNING")
    wait_for_mails(stack, *problems)
    (text,) = [each.text for each in stack.inbox.mails() if each.subject == problems[1]]
    assert "aborted 2 of the last " in text
    assert f"also faulty: {LASER} STALE" in text

    orders.give([("tb_1/navigate_to_pose", "hang"), (f"tb_1/{LASER}", "ok")])
    until(lambda: running(stack) == 1, lambda: f"a goal that runs: {running(stack)}", 60)
    before = goals(stack)
    assert before["aborted"] == 2
    stack.exporter.restart()
    stack.prometheus.restart()
    until(lambda: goals(stack) == before, lambda: f"{before}: {goals(stack)}", 60)
    until(lambda: running(stack) == 1, lambda: f"the goal still runs: {running(stack)}", 60)

    orders.give([("tb_1/navigate_to_pose", "ok")])
    recoveries = ENDED.format(LASER, "STALE"), ENDED.format("navigate_to_pose", "WARNING")
    wait_for_mails(stack, *problems, *recoveries)
    after = goals(stack)
    assert after.keys() == {"succeeded", "aborted"}  # nobody knows of none how it ended
    assert after["aborted"] == 2
    assert after["succeeded"] >= before["succeeded"] + 2
    assert [each.value for each in stack.query(f"sum(resets({RESULTS}[10m]))")] == [0]
