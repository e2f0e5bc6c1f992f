"""Names of nodes that the middleware has forgotten, by the ids of their endpoints."""

from ros_diagnostics_exporter.sources import endpoint_names
from ros_diagnostics_exporter.sources.endpoint_names import NO_NODE, EndpointNames
from ros_diagnostics_exporter.sources.graph_topics import Peer

NAMELESS = f"_NODE_NAMESPACE_UNKNOWN_/{NO_NODE}"
ONE, OTHER = "0a" * 12, "0b" * 12  # processes
AMCL, LIDAR, ROOT = Peer("/r/amcl", f"{ONE}01"), Peer("/r/lidar", f"{ONE}02"), Peer("/n", OTHER)


def test_a_node_is_there_while_any_of_its_endpoints_is_although_nobody_has_its_name():
    names = EndpointNames()
    assert names.named("/a", [AMCL, LIDAR]) == [AMCL, LIDAR]
    names.named("/b", [ROOT, AMCL])
    assert names.complete([("amcl", "/r")], 0) == [("amcl", "/r")]

    names.named("/a", [])
    names.named("/b", [])
    assert names.complete([], 1) == []
    assert names.complete([], 26) == []

    names.named("/a", [AMCL._replace(node=NAMELESS)])  # lidar has not come back
    again = [each._replace(node=NAMELESS) for each in (ROOT, AMCL)]
    assert names.named("/b", again) == [ROOT, AMCL]
    assert names.complete([], 27) == [("amcl", "/r"), ("n", "/")]
    both = [("amcl", "/r"), ("x", "/")]
    assert names.complete(both, 28) == [*both, ("n", "/")]

    names.named("/b", [])
    assert names.complete([], 29) == [("amcl", "/r")]
    names.named("/a", [AMCL])
    assert names.complete([], 30) == []


def test_an_endpoint_that_is_left_of_a_process_that_ended_shows_no_node_until_its_lease_is_over():
    names = EndpointNames()
    names.named("/a", [AMCL, LIDAR])
    names.complete([("amcl", "/r"), ("lidar", "/r")], 0)
    left = [each._replace(node=NAMELESS) for each in (AMCL, LIDAR)]

    assert names.complete([("lidar", "/r")], 5) == [("lidar", "/r")]
    assert names.complete([], 10) == []
    assert names.named("/a", left) == left
    names.complete([], 29.9)
    assert names.named("/a", left) == left
    names.complete([], 30)
    assert names.named("/a", left) == [AMCL, left[1]]
    assert names.complete([("amcl", "/r")], 34) == [("amcl", "/r")]
    names.complete([], 35)  # amcl left again
    assert names.named("/a", left) == [left[0], LIDAR]


def test_an_endpoint_of_which_nothing_was_ever_known_has_no_name():
    names = EndpointNames()
    names.named("/a", [AMCL])
    new = [Peer(NAMELESS, f"{ONE}03"), Peer(NAMELESS, f"{OTHER}01")]
    assert names.named("/a", new) == new
    assert names.complete([], 0) == []


def test_an_endpoint_that_its_node_has_given_up_while_it_goes_on_has_no_name():
    names = EndpointNames()
    names.named("/a", [AMCL])
    names.complete([("amcl", "/r")], 0)
    nameless = AMCL._replace(node=NAMELESS)
    assert names.named("/a", [nameless]) == [nameless]
    names.complete([], 1)
    names.complete([], 26)
    assert names.named("/a", [nameless]) == [AMCL]


def test_of_too_many_processes_those_are_forgotten_that_were_not_there_for_longest(monkeypatch):
    monkeypatch.setattr(endpoint_names, "MOST", 2)
    names = EndpointNames()
    names.named("/a", [AMCL])
    names.named("/b", [ROOT])
    names.named("/a", [AMCL])
    names.named("/c", [Peer("/r/new", "0c" * 12)])
    nameless = [each._replace(node=NAMELESS) for each in (AMCL, ROOT)]
    assert names.named("/a", nameless) == [AMCL, nameless[1]]


def test_of_too_many_endpoints_of_one_process_the_first_are_forgotten(monkeypatch):
    monkeypatch.setattr(endpoint_names, "MOST_ENDPOINTS", 1)
    names = EndpointNames()
    names.named("/a", [AMCL, LIDAR])
    nameless = [each._replace(node=NAMELESS) for each in (AMCL, LIDAR)]
    assert names.named("/a", nameless) == [nameless[0], LIDAR]
