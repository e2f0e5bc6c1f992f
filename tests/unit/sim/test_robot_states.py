"""Every event in every state of a robot: only what is in the graph publishes, nothing raises."""

from collections.abc import Iterable, Iterator

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from support.simulated_fleet import fleet_of, of
from virtual_robots.simulation.components import Fault
from virtual_robots.simulation.fleet import Fleet
from virtual_robots.simulation.kinds import kind_path
from virtual_robots.simulation.outputs import Message, Output, Presence, Topic
from virtual_robots.simulation.robot_events import EVENTS, RobotEvent, trigger
from virtual_robots.simulation.robots import RobotSpec

LONG = 60.0  # seconds, more than a reboot and than a lease

# The events before, and so the state in which the event comes.
BEFORE = {
    "running": (),
    "paused": ("hang",),
    "left": ("leave",),
    "crashed": ("crash",),
    "rebooting": ("reboot",),
    "offline": ("network_loss",),
    "paused offline": ("hang", "network_loss"),
    "paused, long offline": ("hang", "network_loss", ""),
}
# What the robot does a minute after the event: it publishes, is silent in the graph, or gone.
TABLE = """
state                | join | leave | reboot | crash | hang | resume | network_loss | network_back | flap | clock_jump | flood
running              | pub  | gone  | pub    | gone  | mute | pub    | gone         | pub          | pub  | pub        | pub
paused               | pub  | gone  | pub    | gone  | mute | pub    | gone         | mute         | mute | mute       | mute
left                 | pub  | gone  | pub    | gone  | gone | gone   | gone         | gone         | gone | gone       | gone
crashed              | pub  | gone  | pub    | gone  | gone | gone   | gone         | gone         | gone | gone       | gone
rebooting            | pub  | gone  | pub    | gone  | pub  | pub    | gone         | pub          | pub  | pub        | pub
offline              | gone | gone  | gone   | gone  | gone | gone   | gone         | pub          | pub  | gone       | gone
paused offline       | gone | gone  | gone   | gone  | gone | gone   | gone         | mute         | mute | gone       | gone
paused, long offline | gone | gone  | gone   | gone  | gone | gone   | gone         | mute         | mute | gone       | gone
"""  # noqa: E501 - a table
TITLES, *ROWS = [[cell.strip() for cell in row.split("|")] for row in TABLE.strip().splitlines()]
CASES = [
    (row[0], command, expected)
    for row in ROWS
    for command, expected in zip(TITLES[1:], row[1:], strict=True)
]


class Graph:
    """The robots in the ROS graph, as the transport would have them."""

    def __init__(self, fleet: Fleet) -> None:
        self.robots = {name for name, robot in fleet.robots.items() if not robot.spec.absent}

    def checked(self, outputs: Iterable[Output]) -> Iterator[Output]:
        for output in outputs:
            if isinstance(output, Presence):
                assert output.present is (output.robot not in self.robots), output
                (self.robots.add if output.present else self.robots.remove)(output.robot)
            elif isinstance(output, Message):
                assert output.robot in self.robots, f"{output.robot} is not in the graph"
            yield output


def outcome(fleet: Fleet, graph: Graph) -> str:
    list(graph.checked(fleet.advance(fleet.now + LONG)))
    if of(graph.checked(fleet.advance(fleet.now + 3.0)), Topic.RAW):
        return "pub"
    return "mute" if "robot_1" in graph.robots else "gone"


def test_the_table_has_every_event_in_every_state() -> None:
    assert TITLES[1:] == list(EVENTS)
    assert [row[0] for row in ROWS] == list(BEFORE)


@pytest.mark.parametrize(("state", "command", "expected"), CASES)
def test_every_event_in_every_state(state: str, command: str, expected: str) -> None:
    fleet = fleet_of()
    graph = Graph(fleet)
    list(graph.checked(fleet.advance(10.0)))
    for before in BEFORE[state]:
        if before:
            list(graph.checked(trigger(fleet, "robot_1", RobotEvent(before))))
        list(graph.checked(fleet.advance(fleet.now + (2.0 if before else LONG))))
    list(graph.checked(trigger(fleet, "robot_1", RobotEvent(command))))
    assert outcome(fleet, graph) == expected


@pytest.mark.parametrize("command", EVENTS)
def test_every_event_of_a_robot_that_has_not_joined(command: str) -> None:
    fleet = Fleet([RobotSpec("robot_1", kind_path("thesis"), absent=True)])
    graph = Graph(fleet)
    list(graph.checked(trigger(fleet, "robot_1", RobotEvent(command))))
    assert outcome(fleet, graph) == ("pub" if command in {"join", "reboot"} else "gone")


@pytest.mark.parametrize("between", [0.0, 30.0])
def test_a_robot_that_hangs_before_its_first_message_goes_on_whole(between: float) -> None:
    fleet = fleet_of()
    list(trigger(fleet, "robot_1", RobotEvent("hang")))
    assert list(fleet.advance(between)) == []
    list(trigger(fleet, "robot_1", RobotEvent("resume")))
    outputs = list(fleet.advance(between + 3.0))
    assert of(outputs, Topic.RAW)
    assert of(outputs, Topic.AGGREGATED)


def test_a_crashed_robot_that_is_back_and_hangs_stays_in_the_graph() -> None:
    fleet = fleet_of()
    graph = Graph(fleet)
    list(graph.checked(fleet.advance(10.0)))
    for command in ("crash", "join", "hang"):
        list(graph.checked(trigger(fleet, "robot_1", RobotEvent(command))))
        list(graph.checked(fleet.advance(fleet.now + 2.0)))
    assert outcome(fleet, graph) == "mute"


ROBOT_EVENTS = st.tuples(
    st.sampled_from(sorted(EVENTS)),
    st.sampled_from([0.0, 0.5, 7.0, 25.0]),  # how long it lasts
    st.sampled_from([0.5, 5.0]),  # of a flapping network
)
FAULTS = st.sampled_from(["ok", "warn", "error", "stale", "silent", "flap", "overheating"])
HISTORIES = st.lists(
    st.tuples(st.sampled_from([0.0, 0.1, 3.0, 9.9, 19.5, 30.0]), st.one_of(ROBOT_EVENTS, FAULTS)),
    max_size=12,
)


@settings(max_examples=60)
@given(HISTORIES, st.booleans())
def test_no_sequence_of_events_raises_or_publishes_outside_the_graph(history, absent):
    fleet = Fleet([RobotSpec("robot_1", kind_path("thesis"), absent=absent)])
    graph = Graph(fleet)
    for gap, wanted in history:
        list(graph.checked(fleet.advance(fleet.now + gap)))
        if isinstance(wanted, str):
            fault = None if wanted == "ok" else Fault(wanted, fleet.now)
            fleet.inject("robot_1", "Motor 2", fault)
        else:
            what, length, period = wanted
            todo = RobotEvent(what, length, rate=20.0, period=period)
            list(graph.checked(trigger(fleet, "robot_1", todo)))
    list(graph.checked(fleet.advance(fleet.now + LONG)))
