"""Which action servers are subscribed, and which of them another process runs than before."""

from ros_diagnostics_exporter.sources.action_servers import (
    MOST_UNNAMED,
    ActionServer,
    ActionServers,
    ServerChange,
)
from ros_diagnostics_exporter.sources.graph_topics import Peer, TopicView


def servers(robots: int, *, is_named: bool) -> dict[str, ActionServer]:
    """Ten of each robot."""
    return {
        f"/r{robot:03}/a{number}_{is_named}": ActionServer(f"r{robot:03}", f"a{number}", is_named)
        for robot in range(robots)
        for number in range(10)
    }


def test_of_a_large_fleet_those_without_an_entry_are_limited():
    many = servers(30, is_named=False)
    chosen = ActionServers().choose(0, many | servers(30, is_named=True))

    unnamed = {each for each in chosen if each.endswith("False")}
    assert len(unnamed) == MOST_UNNAMED
    assert len(chosen - unnamed) == 300
    assert {each[:5] for each in unnamed} == {f"/r{number:03}" for number in range(20)}


def test_what_comes_and_goes_is_told_once():
    known, found = ActionServers(), servers(1, is_named=True)
    known.choose(0, found)
    assert {each.what for each in known.take_changes()} == {"came"}
    known.choose(0, found)
    assert known.take_changes() == []
    known.choose(0, {})
    assert [each.what for each in known.take_changes()] == ["went"] * 10


def test_a_server_that_another_process_runs_was_restarted_since_it_was_seen_last():
    known, [(topic, server)] = ActionServers(), list(servers(1, is_named=True).items())[:1]
    known.choose(0, {topic: server})
    assert known.take_changes() == [ServerChange(server, "came")]
    first, second = (Peer("/r/dock", process * 24 + "00" * 4) for process in "12")
    other = TopicView((first,), ())
    for mono, publishers in (
        (100.0, (first,)),
        (200.0, (first,)),
        (300.0, ()),
        (400.0, (first, second)),  # as one that was killed is still known
        (500.0, (second,)),
        (600.0, (second,)),
    ):
        known.see_topics(0, [("/chatter", other), (topic, TopicView(publishers, ()))], mono)
    assert known.take_changes() == [ServerChange(server, "restarted", 200.0)]
