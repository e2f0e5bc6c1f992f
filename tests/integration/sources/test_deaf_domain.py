"""A participant that has become deaf to one robot, on real DDS."""

from ros_diagnostics_exporter import comparing, joining
from ros_diagnostics_exporter.config.fleet import Fleet, Profile, Robot, Source
from ros_diagnostics_exporter.model import Status
from support.ros_publisher import repeating
from testbed.polling import until

COOL = Status(0, "Motor", "OK")
QUICK = Profile(stale_after=2.0, confirm_after=30.0)
TOPICS = ("/a/diagnostics", "/b/diagnostics")


def test_a_domain_that_is_deaf_to_one_robot_is_joined_anew(
    ros_domain, robots, run_exporter, monkeypatch
):
    monkeypatch.setattr(comparing, "REST", 1.0)
    monkeypatch.setattr(comparing, "CONFIRM", 1.0)
    monkeypatch.setattr(joining, "LEAST", 1.0)
    fleet = tuple(
        Robot(topic[1], ros_domain, topic_raw=topic, source=Source.RAW, profile=QUICK)
        for topic in TOPICS
    )
    running = run_exporter(Fleet("f", fleet))
    listener = running.service.listener
    for topic in TOPICS:
        robots.offer(topic)
    robots.wait_for_listeners()

    with repeating(lambda _turn: [robots.send(topic, COOL) for topic in TOPICS], 0.2):
        for robot in ("a", "b"):
            running.wait_for("robot_up", 1, robot=robot)
        joined_at = listener.joined_at[ros_domain]
        deaf_to = listener._domains[ros_domain].topics["/a/diagnostics"]
        deaf_to.take = lambda: None
        running.wait_for("robot_up", 0, robot="a")
        running.wait_for("robot_silent_reason", 1, robot="a", reason="domain_unreachable")
        running.wait_for("robot_up", 1, robot="a")
        assert listener.joined_at[ros_domain] > joined_at
        until(lambda: running.sample("robot_up", robot="b") == 1, "the other one is received")
    assert not running.service.state.faults()


def test_a_second_participant_names_what_it_finds_and_its_end_is_awaited(ros_domain, robots):
    robots.offer("/a/diagnostics")
    with repeating(lambda _turn: robots.send("/a/diagnostics", COOL), 0.2):
        name = "node /robots"
        wanted = ["/a/diagnostics", "/b/diagnostics", name, "node /a/gone"]
        second = comparing.Second(ros_domain, wanted, ())
        until(lambda: not second.listens, "it has listened", 60)
        assert second.stop() == {"/a/diagnostics", name}
