"""Domains are joined and worked on beside each other: one that hangs stops no other."""

import re
import sys
import threading
import time
import urllib.request
from itertools import pairwise

import pytest

from ros_diagnostics_exporter.config.fleet import Fleet, Limits, Profile, Query, Robot, Source
from ros_diagnostics_exporter.config.load import load
from ros_diagnostics_exporter.fleet.state import FleetState
from ros_diagnostics_exporter.loops import read_clocks
from ros_diagnostics_exporter.model import Status
from ros_diagnostics_exporter.sources import dds as ros
from ros_diagnostics_exporter.sources import reception
from ros_diagnostics_exporter.sources.listener import Listener
from support.ros_publisher import publisher
from testbed import domains
from testbed.polling import until

COOL = Status(0, "Motor", "OK")
QUICK = Profile(stale_after=1.0)


def robot(name: str, domain_id: int) -> Robot:
    topic = f"/{name}/diagnostics"
    return Robot(name, domain_id, topic_raw=topic, source=Source.RAW, profile=QUICK)


@pytest.fixture
def other_domain():
    with domains.lease() as domain_id:
        yield domain_id


@pytest.fixture
def hang(monkeypatch, other_domain):
    """Joining the other domain hangs until this event is set."""
    event, create = threading.Event(), ros._make_node

    def create_node(*arguments, context, **more):
        if context.get_domain_id() == other_domain:
            event.wait(120)
        return create(*arguments, context=context, **more)

    monkeypatch.setattr(ros, "_make_node", create_node)
    yield event
    event.set()


def test_a_domain_whose_join_hangs_stops_nothing_and_is_joined_when_it_goes_on(  # noqa: PLR0917
    ros_domain, other_domain, robots, run_exporter, hang, tmp_path, monkeypatch
):
    path = tmp_path / "fleet.yml"
    text = "".join(
        f"  - {{name: {name}, domain_id: {domain_id}, topic: /{name}/diagnostics, source: raw}}\n"
        for name, domain_id in (("here", ros_domain), ("there", other_domain))
    )
    path.write_text(f"fleet: f\nprofiles: {{default: {{stale_after: 1s}}}}\nrobots:\n{text}")
    running = run_exporter(load(path))
    service = running.service
    robots.offer("/here/diagnostics")
    robots.wait_for_listeners()

    robots.send("/here/diagnostics", COOL)
    running.wait_for("robot_up", 1, robot="here")
    running.wait_for("robot_up", 0, robot="here")  # silence is found
    service.reload()
    assert running.sample("exporter_domain_up", domain_id=str(ros_domain)) == 1
    assert running.sample("exporter_domain_up", domain_id=str(other_domain)) == 0
    assert service.not_ready_reason() is not None
    monkeypatch.setattr(service._joining, "_join_at", 0.0)  # half a minute has passed
    running.wait_for("robot_silent_reason", 1, robot="there", reason="domain_unreachable")

    hang.set()
    running.wait_for("exporter_domain_up", 1, domain_id=str(other_domain))
    with publisher(other_domain) as others:
        others.offer("/there/diagnostics")
        others.wait_for_listeners()
        others.send("/there/diagnostics", COOL)
        running.wait_for("robot_up", 1, robot="there")
    until(lambda: service.not_ready_reason() is None, "the exporter is ready")


def test_when_a_reload_ends_the_sources_follow_it(ros_domain, other_domain, run_exporter):
    running = run_exporter(Fleet("f", (robot("here", ros_domain),)))
    running.wait_for("exporter_domain_up", 1, domain_id=str(ros_domain))
    service = running.service
    ping = Query("ping", "up", "ping")

    service.reloader.configure(Fleet("f", (robot("there", other_domain),), queries=(ping,)))

    assert [each.query.name for each in service.outcomes()] == [ping.name]
    assert running.sample("exporter_domain_up", domain_id=str(ros_domain)) is None
    assert set(service.listener.troubles) == {other_domain}
    assert service.listener.domain_ids in ((), (other_domain,))
    running.wait_for("exporter_domain_up", 1, domain_id=str(other_domain))


def test_sigterm_ends_a_program_whose_join_hangs(
    ros_domain, dds_environment, start_process, free_port, tmp_path
):
    (tmp_path / "fleet.yml").write_text(
        f"fleet: f\nrobots: [{{name: r, domain_id: {ros_domain}, topic: /r/diagnostics}}]\n"
    )
    port = free_port()
    program = (
        "import sys, threading\n"
        "from ros_diagnostics_exporter.cli import main as cli\n"
        "from ros_diagnostics_exporter.sources import dds as ros\n"
        "def hang(*_arguments, **_more):\n"
        "    print('hanging', flush=True)\n"
        "    threading.Event().wait()\n"
        "ros._make_node = hang\n"
        "sys.exit(cli.main(sys.argv[1:]))\n"
    )
    exporter = start_process(
        "exporter",
        [
            sys.executable, "-c", program, "--config.file", tmp_path / "fleet.yml",
            "--web.listen-address", f"127.0.0.1:{port}",
            "--storage.path", tmp_path / "exporter.db",
        ],
        dds_environment,
    )  # fmt: skip
    exporter.wait_for_output("hanging")
    exporter.wait_for_output("serving fleet f")
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=30) as answer:
        assert re.search(rb"domain_up{.*} 0.0", answer.read())

    assert exporter.stop(grace=30) == 0
    assert f"domain {ros_domain} is not left yet" in exporter.output()


def test_a_domain_whose_node_cannot_be_made_leaves_no_context_behind(
    ros_domain, run_exporter, monkeypatch
):
    contexts, create = [], ros._make_node

    def create_node(*arguments, context, **more):
        contexts.append(context)
        if len(contexts) == 1:
            raise RuntimeError("no node today")
        return create(*arguments, context=context, **more)

    monkeypatch.setattr(ros, "_make_node", create_node)
    running = run_exporter(Fleet("f", (robot("r", ros_domain),)))
    running.wait_for("robot_silent_reason", 1, robot="r", reason="domain_unreachable")
    assert not contexts[0].ok()

    running.service.listener.join()
    running.wait_for("exporter_domain_up", 1, domain_id=str(ros_domain))
    assert contexts[1].ok()


def test_a_domain_whose_thread_stands_still_is_not_ready(
    ros_domain, other_domain, robots, run_exporter, monkeypatch
):
    running = run_exporter(Fleet("f", (robot("here", ros_domain), robot("there", other_domain))))
    service = running.service
    monkeypatch.setattr("ros_diagnostics_exporter.sources.listener.STALLED", 2.0)
    ready = service.not_ready_reason
    robots.offer("/here/diagnostics")
    robots.wait_for_listeners()
    until(lambda: ready() is None, "the exporter is ready")
    looks = running.samples("exporter_discovery_last_run_timestamp_seconds")
    assert {dict(labels)["domain_id"] for labels in looks} == {str(ros_domain), str(other_domain)}
    assert time.time() - min(looks.values()) < 30

    stuck, go_on = threading.Event(), threading.Event()
    receive = service.state.receive

    def hang(*arguments):
        stuck.set()
        go_on.wait(60)
        receive(*arguments)

    monkeypatch.setattr(service.state, "receive", hang)
    robots.send("/here/diagnostics", COOL)
    assert stuck.wait(30)
    until(lambda: ready() == f"no message was taken for 2 s in domain {ros_domain}", "not ready")
    go_on.set()
    until(lambda: ready() is None, "the exporter is ready again")


def test_large_messages_wait_in_a_shallower_queue(ros_domain, robots, run_exporter):
    """Of 3 MiB, 21 are 64 MiB: so many are kept while the domain's thread cannot take them."""
    limits = Limits(components=50, message_bytes=4 << 20)
    running = run_exporter(Fleet("f", (robot("r", ros_domain),), limits=limits))
    robots.offer("/r/diagnostics")
    robots.wait_for_listeners()
    large = COOL._replace(message="m" * (3 << 20))

    def arrived() -> float:
        rejected = running.sample("robot_rejected_total", robot="r", reason="rate") or 0.0
        return running.sample("robot_messages_total", robot="r") + rejected

    def first_arrived() -> bool:
        robots.send("/r/diagnostics", large)
        return arrived() > 0

    until(first_arrived, "the first large array")
    # The deep queue stays until the publishers know the shallow one, so that nothing is lost.
    domain = running.service.listener._domains[ros_domain]
    until(lambda: domain.topics["/r/diagnostics"].depth < 1_000, "the queue is shallower")
    until(lambda: not domain._handovers._handovers, "the deep one is gone")
    until(lambda: robots.listeners("/r/diagnostics") == 1, "the publisher knows it")
    with running.service.state._lock:
        before = arrived()
        for _ in range(120):
            robots.send("/r/diagnostics", large)
        robots.send("/r/diagnostics", Status(2, "Motor", "the last"))
    running.wait_for("component_level", 2, robot="r", component="Motor")
    # Some of those sent before arrive late, and some are taken before the thread stands still.
    assert arrived() - before < 80


def test_seconds_counted_by_several_threads_are_all_counted():
    class Slow(float):
        """A number that lets another thread in while it is added."""

        def __radd__(self, other: float) -> float:
            time.sleep(0.001)
            return other + float(self)

    listener = Listener(FleetState(Fleet("f"), read_clocks()))
    threads = [
        threading.Thread(target=lambda: [listener.count(Slow(1), Slow(2)) for _ in range(20)])
        for _ in range(4)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()

    assert (listener.decode_seconds, listener.ingest_seconds) == (80, 160)


def test_messages_are_received_while_the_look_at_a_slow_graph_is_under_way(
    ros_domain, robots, run_exporter, monkeypatch
):
    """Where there are thousands of topics, asking for one's publishers takes milliseconds."""
    count, asked = ros.Node.count_publishers, []

    def slow(node, name):
        if name.startswith("/x"):
            asked.append(name)
            time.sleep(0.05)
        return count(node, name)

    monkeypatch.setattr(ros.Node, "count_publishers", slow)
    for number in range(100):  # five seconds
        robots.offer(f"/x{number}/diagnostics")
    running = run_exporter(Fleet("f", (robot("here", ros_domain),)))
    robots.offer("/here/diagnostics")
    until(lambda: robots.listeners("/here/diagnostics"), "a subscription", 60)
    until(lambda: len(set(asked)) > 50, "the other topics are asked for", 60)

    def look() -> float:
        return running.sample("exporter_discovery_last_run_timestamp_seconds")

    def three_received_within_one_look() -> bool:
        begin = look()
        for _ in range(3):
            before = running.sample("robot_messages_total", robot="here")
            robots.send("/here/diagnostics", COOL)
            running.wait_for("robot_messages_total", before + 1, robot="here")
        return begin == look()

    until(three_received_within_one_look, "three messages received within one look", 60)


def test_looks_at_a_large_graph_that_stays_the_same_are_further_apart(
    ros_domain, robots, run_exporter, monkeypatch
):
    looks: list[float] = []
    ask = ros.Node.get_topic_names_and_types

    def noted(node):
        looks.append(time.monotonic())
        return ask(node)

    monkeypatch.setattr(ros.Node, "get_topic_names_and_types", noted)
    monkeypatch.setattr(reception, "LOOK_SHARE", 1e-9)  # so that this graph is a large one
    robots.offer("/here/diagnostics")
    running = run_exporter(Fleet("f", (robot("here", ros_domain), robot("late", ros_domain))))
    running.wait_for("robot_publishers", 1, robot="here")
    longest = 0.9 * reception.MAX_STRETCH  # intervals are a second
    until(
        lambda: any(after - before > longest for before, after in pairwise(looks)),
        lambda: f"looks at {looks}",
        60,
    )

    robots.offer("/late/diagnostics")
    running.wait_for("robot_publishers", 1, robot="late")
