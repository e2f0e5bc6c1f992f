"""Names that rclpy cannot read, which anybody in a domain can make: the others are received."""

from ros_diagnostics_exporter.config.fleet import Discovery, Fleet, Profile, Robot, Source
from ros_diagnostics_exporter.config.graph import Graph
from ros_diagnostics_exporter.config.keys import validated
from ros_diagnostics_exporter.model import Status
from support.cyclone_robot import CONFIG, CONFIG_VARIABLE, cyclone_robot
from support.odd_names import unreadable_topic
from support.ros_publisher import Publisher
from testbed.polling import until

OK = Status(0, "Motor", "OK")


def fleet(domain_id: int) -> Fleet:
    profile = Profile(graph=Graph(mode="on"))
    raw = {"topic": "/{robot}/diagnostics", "domain_ids": [domain_id], "source": "raw"}
    return Fleet("f", discoveries=(validated(Discovery, raw, {"default": profile}),))


def is_received(running, robots: Publisher, name: str) -> None:
    robots.offer(f"/{name}/diagnostics")

    def up() -> bool:
        robots.send(f"/{name}/diagnostics", OK)
        return running.sample("robot_up", robot=name) == 1

    until(up, f"{name} is up", 30)


def odd(running, domain_id: int) -> str:
    return running.service.listener.oddities[domain_id]


def test_a_topic_whose_name_is_no_utf_8_hides_no_new_robot(ros_domain, robots, run_exporter):
    running = run_exporter(fleet(ros_domain))
    is_received(running, robots, "r1")
    with unreadable_topic(ros_domain):
        until(lambda: odd(running, ros_domain), "the name is left out", 30)
        shown = "1 topics have a name that is no UTF-8: /evil\\xff/diagnostics"
        assert odd(running, ros_domain) == shown
        is_received(running, robots, "r2")
        assert running.service.not_ready_reason() is None
    until(lambda: not odd(running, ros_domain), "it is gone", 30)


def test_a_node_without_a_name_hides_no_other(ros_domain, robots, run_exporter, monkeypatch):
    monkeypatch.setenv(CONFIG_VARIABLE, CONFIG)
    running = run_exporter(fleet(ros_domain))
    is_received(running, robots, "r1")
    with cyclone_robot(ros_domain, "/r1", ""), cyclone_robot(ros_domain, "/r1", "driver"):
        until(lambda: odd(running, ros_domain), "the node is left out", 30)
        assert odd(running, ros_domain) == "1 nodes have no name, or none that is UTF-8"
        until(lambda: running.sample("robot_expected_nodes", robot="r1") == 0, "it is seen", 30)


def test_what_is_wanted_is_subscribed_although_the_graph_cannot_be_listed(
    ros_domain, robots, run_exporter, monkeypatch
):
    def fail(_node) -> None:
        raise RuntimeError("the middleware cannot list its graph")

    monkeypatch.setattr("ros_diagnostics_exporter.sources.dds.list_topics", fail)
    monkeypatch.setattr("ros_diagnostics_exporter.sources.reception.NOT_LOOKED", 2.0)
    robot = Robot("r1", ros_domain, topic_raw="/r1/diagnostics", source=Source.RAW)
    running = run_exporter(Fleet("f", (robot,)))
    is_received(running, robots, "r1")
    listener = running.service.listener
    until(lambda: listener.troubles[ros_domain], "it is not looked at", 30)
    why = "its ROS graph was not looked at for more than 2 s: the middleware cannot list its graph"
    assert listener.troubles[ros_domain] == why
    assert running.service.not_ready_reason() is not None
