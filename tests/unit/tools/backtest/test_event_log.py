"""An exporter's database is judged as what it received would be, as far as its events say that."""

import sqlite3
from contextlib import closing
from dataclasses import replace
from math import inf

import pytest

from ros_diagnostics_exporter.config.fleet import Fleet, Robot, Source
from ros_diagnostics_exporter.events import Event
from ros_diagnostics_exporter.model import Status
from ros_diagnostics_exporter.storage.database import Changes, Database
from ros_diagnostics_exporter.storage.pruning import Bounds
from ros_diagnostics_tools.backtest.formats import RecordingError
from ros_diagnostics_tools.backtest.recordings import Recordings, RecordingSource
from ros_diagnostics_tools.backtest.replay import Replay, play
from support.bags import BEGIN, TOPIC, every_second, fleet, judged, texts, write_bag

AGGREGATED = Fleet("f", (Robot("r", topic_agg="/r/diagnostics_agg", source=Source.AGG),))


def write_log(path, events, robots=()):
    database = Database(path)
    changes = Changes(
        everything=False, robots=list(robots), gone=[], seen=[], faults={},
        events=list(enumerate(events, 1)),
    )  # fmt: skip
    database.write(changes, Bounds(0.0, inf, 1 << 30))
    database.close()
    return path


def live(fleet, bag, path):
    """What the exporter makes of a bag, and the database that it leaves."""
    events = []
    with closing(Recordings([RecordingSource(bag)])) as recordings:
        replay = Replay(fleet, recordings)
        note = replay.history.note

        def also_log(state):
            found = state.take_events()
            events.extend(found)
            state.take_events = lambda: found
            note(state)
            del state.take_events

        replay.history.note = also_log
        for _message in play(recordings, [replay]):
            pass
        result = replay.result()
        robots = [
            (robot.settings.name, robot.persist(replay._now).as_json())
            for robot in replay.state.robots.values()
        ]
    return result, write_log(path, events, robots)


def read(fleet, path, other=None):
    recordings = Recordings([RecordingSource(path, fleet=fleet)])
    replay = Replay(other or fleet, recordings)
    for _message in play(recordings, [replay]):
        pass
    recordings.close()
    return replay.result()


def tree(rows):
    """The same arrays as an aggregator publishes them."""
    for second, _topic, statuses in rows:
        header = Status(0, "/Base", "", "", tuple((each.name, "m") for each in statuses))
        leaves = (each._replace(name=f"/Base/{each.name}") for each in statuses)
        yield second, "/r/diagnostics_agg", (header, *leaves)


HISTORY = {"motor": [*range(40, 90), 100, 101], "laser": range(150, 200), "arm": []}


@pytest.mark.parametrize("aggregated", [False, True])
def test_a_log_gives_the_faults_of_the_messages_that_made_it(tmp_path, aggregated):
    rows = every_second([*range(110), *range(135, 260)], HISTORY)
    config, bag = fleet(), write_bag(tmp_path / "bag", rows)
    if aggregated:
        config, bag = AGGREGATED, write_bag(tmp_path / "agg", tree(rows))

    result, log = live(config, bag, tmp_path / "state.db")

    found = texts(read(config, log))
    assert [each.split(" ")[-2:] for each in found] == [
        ["motor", "critical"],
        ["r", "silent"],
        ["laser", "critical"],
    ]
    for one, other in zip(found, texts(result), strict=True):
        assert one.split()[-2:] == other.split()[-2:]
        for ours, theirs in zip(one.split()[:3], other.split()[:3], strict=True):
            assert float(ours) == pytest.approx(float(theirs), abs=1.3)


def test_another_confirm_after_is_judged_from_a_log(tmp_path):
    rows = every_second(range(260), HISTORY)
    _result, log = live(fleet(), write_bag(tmp_path / "bag", rows), tmp_path / "state.db")

    found = texts(read(fleet(), log, fleet(confirm_after=1.0)))

    assert [each.split()[-2:] for each in found] == [["motor", "critical"]] * 2 + [
        ["laser", "critical"]
    ]


@pytest.fixture
def backtest(tmp_path, run):
    """A function (events, words): what the command prints of a log with these events."""

    def backtest(events, *words, topic=TOPIC, code=0):
        (tmp_path / "fleet.yml").write_text(f"fleet: f\nrobots: [{{name: r, topic: {topic}}}]\n")
        paths = (str(tmp_path / "fleet.yml"), str(write_log(tmp_path / "state.db", events)))
        return run("backtest", "--config", *paths, *words, code=code)

    return backtest


def test_a_robot_that_the_config_does_not_have_is_named(backtest):
    broken = ("motor", "OK", "ERROR")
    robots = ("r", "\x1b[31mx")
    events = [Event(BEGIN + 5, "level", robot, "", *broken) for robot in robots]
    said = backtest(events, "--suggest")
    assert "of no robot of the configuration: " in said.err
    assert "\x1b" not in said.err + said.out


@pytest.mark.parametrize("topic", ["/r/diagnostics", "/r/diagnostics_agg"])
def test_samples_of_a_log_are_numbers(tmp_path, backtest, topic):
    events = [
        Event(BEGIN + 5, "level", "r", "/Arm", "motor", "OK", "ERROR"),
        Event(BEGIN + 90, "level", "r", "/Arm", "motor", "ERROR", "OK"),
    ]
    samples = tmp_path / "samples.om"
    backtest(events, "--openmetrics", str(samples), topic=topic)
    lines = samples.read_text().splitlines()[:-1]
    found = {line.rsplit(" ", 2)[1] for line in lines if "component_level{" in line}
    assert found == {"2"}
    for line in lines:
        float(line.rsplit(" ", 2)[1])


def test_a_log_of_no_robot_of_the_config_is_an_error(backtest):
    event = Event(BEGIN, "level", "other", "", "motor", "OK", "ERROR")
    assert "other" in backtest([event], code=1).err


def error(path):
    with pytest.raises(RecordingError) as raised:
        Recordings([RecordingSource(path, fleet=fleet())])
    return str(raised.value)


def test_a_log_that_cannot_be_judged_is_an_error_that_says_why(tmp_path):
    path = write_log(tmp_path / "state.db", [Event(BEGIN, "config", after="read")])
    assert error(path) == f"{path}: has no events of robots"

    with closing(sqlite3.connect(path)) as connection, connection:
        connection.execute("PRAGMA user_version = 9")
    assert error(path) == f"{path}: has version 9, and this program reads 4"

    path = write_log(tmp_path / "cut.db", [Event(BEGIN, "robot", "r", after="received")])
    path.write_bytes(path.read_bytes()[:5000])
    assert error(path).startswith(f"{path}: is no database of this version: ")


def test_a_robot_that_only_its_config_knows_is_judged(tmp_path):
    """It was forgotten since: the database has its events, and no longer the robot."""
    events = [
        Event(BEGIN, "robot", "r", after="received"),
        Event(BEGIN + 20, "level", "r", "", "motor", "OK", "ERROR"),
        Event(BEGIN + 60, "level", "r", "", "motor", "ERROR", "OK"),
        Event(BEGIN + 80, "robot", "r", after="forgotten"),
    ]

    found = texts(read(fleet(), write_log(tmp_path / "state.db", events)))

    assert found == ["20 30 60 motor critical"]


def test_a_wall_clock_that_was_set_back_does_not_stop_the_reading(tmp_path):
    events = [
        Event(BEGIN, "robot", "r", after="received"),
        Event(BEGIN + 40, "level", "r", "", "motor", "OK", "ERROR"),
        replace(Event(BEGIN + 10, "level", "r", "", "motor", "ERROR", "OK")),
        Event(BEGIN + 100, "level", "r", "", "arm", "OK", "ERROR"),
    ]

    assert read(fleet(), write_log(tmp_path / "state.db", events)).notifications == []


def test_a_bag_in_sqlite_is_no_log(tmp_path):
    bag = write_bag(tmp_path / "bag", every_second(range(60), {"motor": range(10, 40)}), "sqlite3")
    [file] = bag.glob("*.db3")

    assert texts(judged(fleet(), file)) == ["10 20 40 motor critical"]


def test_a_component_that_is_first_received_in_trouble_is_not_known_before(tmp_path):
    events = [
        Event(BEGIN, "robot", "r", after="received"),
        Event(BEGIN + 20, "level", "r", "", "motor", "", "ERROR"),
        Event(BEGIN + 60, "level", "r", "", "motor", "ERROR", "OK"),
    ]
    log = write_log(tmp_path / "state.db", events)

    with closing(Recordings([RecordingSource(log, fleet=fleet())])) as recordings:
        arrays = [(each.at - BEGIN, each.decode().statuses) for each in recordings.messages()]

    assert min(at for at, statuses in arrays if statuses) == 20
    assert texts(read(fleet(), log)) == ["20 30 60 motor critical"]


def test_a_log_whose_events_are_computed_is_none(tmp_path):
    path = write_log(tmp_path / "state.db", [Event(BEGIN, "robot", "r", after="received")])
    with closing(sqlite3.connect(path)) as connection:
        connection.executescript(
            "ALTER TABLE events RENAME TO old; CREATE VIEW events AS WITH RECURSIVE n(id) AS "
            "(VALUES (1) UNION ALL SELECT id + 1 FROM n) SELECT n.id, time, kind, robot, "
            "component, after, data FROM n, old;"
        )
    assert error(path) == f"{path}: has no tables robots and events"
