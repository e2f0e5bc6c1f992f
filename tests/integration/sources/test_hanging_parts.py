"""A part of a running exporter hangs or fails: it is named, and the others go on."""

import os
import threading

import pytest

from ros_diagnostics_exporter.alertmanager import Alertmanager
from ros_diagnostics_exporter.config.fleet import Fleet, Profile, Robot, Source
from ros_diagnostics_exporter.model import Status
from ros_diagnostics_exporter.service import Service
from testbed.polling import until

COOL = Status(0, "Motor", "OK")


@pytest.fixture
def fleet(ros_domain) -> Fleet:
    profile = Profile(stale_after=1.0)
    robot = Robot("r", ros_domain, topic_raw="/r/diagnostics", source=Source.RAW, profile=profile)
    return Fleet("f", (robot,))


@pytest.fixture
def held():
    """What waits for it hangs until the test ends."""
    event = threading.Event()
    yield event
    event.set()


def test_judging_that_hangs_is_unhealthy_until_it_goes_on(fleet, run_exporter, held, monkeypatch):
    monkeypatch.setattr(Service, "HANGING", 0.2)
    service = run_exporter(fleet).service
    until(lambda: service.hanging_reason() is None, "nothing hangs")
    monkeypatch.setattr(service.state, "tick", lambda _now: held.wait(60))

    until(service.hanging_reason, "it hangs")
    assert "loop tick has hung" in service.hanging_reason()
    held.set()
    until(lambda: service.hanging_reason() is None, "it goes on")


def test_judging_that_fails_is_counted_and_goes_on(fleet, run_exporter, robots, monkeypatch):
    running = run_exporter(fleet)
    with monkeypatch.context() as patch:
        patch.setattr(running.service.state, "tick", lambda _now: 1 / 0)
        until(lambda: running.sample("exporter_loop_errors_total", loop="tick"), "a turn fails")
    robots.offer("/r/diagnostics")
    robots.wait_for_listeners()
    robots.send("/r/diagnostics", COOL)
    running.wait_for("robot_up", 1)
    running.wait_for("robot_up", 0)  # silence is found


def test_alertmanager_and_what_it_needs_may_hang(fleet, tmp_path, robots, monkeypatch, caplog):
    """The password file is a FIFO that nobody writes to: the start and the rest go on."""
    monkeypatch.setattr(Service, "ASKED", 0.2)
    password = tmp_path / "password"
    os.mkfifo(password)
    asked = Alertmanager(["http://127.0.0.1:1"], user="ann", password_file=password)
    service = Service(fleet, tmp_path / "fleet.yml", None, alertmanager=asked)
    service.start()
    try:
        assert "Alertmanager has not answered yet" in caplog.text
        until(lambda: service.not_ready_reason() is None, "the domain is joined")
        last = {each.name: each.last_turn for each in service.loops()}
        until(
            lambda: all(
                each.last_turn > last[each.name]
                for each in service.loops()
                if each.name not in {"alertmanager", "unmatched", "week"}
            ),
            "all others go on",
        )
        assert last["alertmanager"] == 0
        assert service.hanging_reason() is None
    finally:
        service.stop()
        password.write_text("secret")


def test_why_a_domain_is_not_joined_is_known_where_one_looks(fleet, run_exporter, monkeypatch):
    def fail(*_arguments, **_more):
        raise RuntimeError("no log folder,\nnowhere")

    monkeypatch.setattr("ros_diagnostics_exporter.sources.dds.rclpy.init", fail)
    running = run_exporter(fleet)
    [domain] = map(str, fleet.domain_ids)
    until(
        lambda: (
            running.service.not_ready_reason()
            == f"cannot join domain {domain}: no log folder, nowhere"
        ),
        "the reason is known",
    )
    reason = {"domain_id": domain, "reason": "no log folder, nowhere"}
    assert running.sample("exporter_domain_error_info", **reason) == 1
    assert running.sample("exporter_domain_up", domain_id=domain) == 0
