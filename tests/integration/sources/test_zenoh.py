"""Robots behind bridges and a router: what is received, and why nothing is."""

from ros_diagnostics_exporter.config.fleet import Discovery, Fleet, Profile, Robot, Zenoh
from ros_diagnostics_exporter.config.keys import validated
from ros_diagnostics_exporter.model import Status
from support.zenoh_robots import Bridge
from testbed.polling import until

OK, HOT = Status(0, "Motor", "OK"), Status(2, "Motor", "Hot")
QUICK = Profile(stale_after=1.0)


def robot(name: str, prefix: str = "/", **more) -> Robot:
    made = {"name": name, "zenoh": prefix, "namespace": f"/{name}", "source": "raw", **more}
    return validated(Robot, made, {"default": QUICK})


def fleet_at(router, *robots: Robot, **more) -> Fleet:
    return Fleet("f", robots, zenoh=Zenoh((router.locator,)), **more)


def reason(running, name: str) -> str | None:
    found = running.samples("robot_silent_reason").items()
    now = [dict(labels)["reason"] for labels, value in found if value and ("robot", name) in labels]
    assert len(now) <= 1
    return now[0] if now else None


def wait_for_reason(running, name: str, wanted: str | None) -> None:
    until(lambda: reason(running, name) == wanted, f"{name} is silent: {wanted}", 30)


def is_up(running, bridge, topic: str, name: str) -> None:
    """Send until the robot is up."""

    def up() -> bool:
        bridge.send(topic, HOT)
        return running.sample("robot_up", robot=name) == 1

    until(up, f"{name} is up")


def test_a_robot_behind_a_bridge_is_found_by_its_key_and_received(router, bridge, run_exporter):
    found = validated(
        Discovery,
        {"zenoh": "customer/{robot}", "topic": "/diagnostics", "source": "raw"},
        {"default": QUICK},
    )
    running = run_exporter(fleet_at(router, discoveries=(found,)))
    bridge.offer("/customer/amr-1/diagnostics")
    bridge.offer("/other/amr-2/diagnostics")
    bridge.offer("/customer/amr-3/diagnostics", kind="std_msgs/msg/String")

    is_up(running, bridge, "/customer/amr-1/diagnostics", "amr-1")

    running.wait_for("exporter_rejected_total", 1, reason="wrong_type")
    assert running.sample("component_level", robot="amr-1", component="Motor") == 2
    assert running.sample("robot_info", robot="amr-1", domain_id="zenoh") == 1
    assert set(running.service.state.robots) == {"amr-1"}
    assert running.service.not_ready_reason() is None


def test_a_robot_whose_bridge_has_gone_is_unreachable_until_it_is_back(router, run_exporter):
    running = run_exporter(fleet_at(router, robot("away")))
    bridge = Bridge(router.locator)
    bridge.offer("/away/diagnostics")
    is_up(running, bridge, "/away/diagnostics", "away")
    bridge.close()
    wait_for_reason(running, "away", "unreachable")

    again = Bridge(router.locator)
    again.offer("/away/diagnostics")
    wait_for_reason(running, "away", "mute")
    is_up(running, again, "/away/diagnostics", "away")
    again.close()


def test_a_router_that_is_away_is_one_reason_and_its_return_brings_all_back(
    router, bridge, run_exporter
):
    running = run_exporter(fleet_at(router, robot("a"), robot("b")))
    for name in ("a", "b"):
        bridge.offer(f"/{name}/diagnostics")
        is_up(running, bridge, f"/{name}/diagnostics", name)

    router.stop()

    running.wait_for("exporter_domain_up", 0, domain_id="zenoh")
    for name in ("a", "b"):
        wait_for_reason(running, name, "domain_unreachable")
    [(labels, _one)] = running.samples("exporter_domain_error_info").items()
    assert router.locator in dict(labels)["reason"]

    router.start()

    running.wait_for("exporter_domain_up", 1, domain_id="zenoh")
    for name in ("a", "b"):
        is_up(running, bridge, f"/{name}/diagnostics", name)
    assert running.samples("exporter_domain_error_info") == {}


def test_a_router_that_is_there_later_is_found(router, run_exporter):
    router.stop()
    running = run_exporter(fleet_at(router, robot("a")))
    wait_for_reason(running, "a", "domain_unreachable")
    assert "no router answers at" in running.service.not_ready_reason()

    router.start()

    running.wait_for("exporter_domain_up", 1, domain_id="zenoh")
    until(lambda: running.service.not_ready_reason() is None, "ready", 30)
    bridge = Bridge(router.locator)
    bridge.offer("/a/diagnostics")
    is_up(running, bridge, "/a/diagnostics", "a")
    bridge.close()


def test_in_mode_peer_the_exporter_connects_to_each_bridge(free_port, run_exporter):
    first, second = (f"tcp/127.0.0.1:{free_port()}" for _ in range(2))
    bridge = Bridge(listen=first)
    bridge.offer("/a/diagnostics")
    settings = Zenoh((first, second), mode="peer")
    running = run_exporter(Fleet("f", (robot("a"), robot("b")), zenoh=settings))
    is_up(running, bridge, "/a/diagnostics", "a")
    wait_for_reason(running, "b", "never_seen")

    other = Bridge(listen=second)
    other.offer("/b/diagnostics")
    is_up(running, other, "/b/diagnostics", "b")
    bridge.close()

    wait_for_reason(running, "a", "unreachable")
    is_up(running, other, "/b/diagnostics", "b")
    other.close()
    running.wait_for("exporter_domain_up", 0, domain_id="zenoh")


def test_a_robot_beyond_the_limit_of_tokens_is_found_once_others_have_gone(
    router, bridge, run_exporter, monkeypatch
):
    monkeypatch.setattr("ros_diagnostics_exporter.sources.zenoh.MAX_PUBLISHERS", 3)
    crowd = Bridge(router.locator)
    for number in range(3):
        crowd.offer(f"/other/r{number}/diagnostics")
    found = validated(
        Discovery,
        {"zenoh": "customer/{robot}", "topic": "/diagnostics", "source": "raw"},
        {"default": QUICK},
    )
    running = run_exporter(fleet_at(router, discoveries=(found,)))
    until(lambda: running.service.state.unclaimed, "the crowd is noted", 20)
    bridge.offer("/customer/amr-1/diagnostics")
    crowd.close()
    is_up(running, bridge, "/customer/amr-1/diagnostics", "amr-1")
