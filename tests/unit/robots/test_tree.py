"""Aggregated arrays give back the components as their drivers published them."""

import pytest

from ros_diagnostics_exporter.config.fleet import Source
from ros_diagnostics_exporter.model import Status
from ros_diagnostics_exporter.robots.tree import TreeReader
from support.recordings import CASES, aggregated, expected_names
from support.state_driver import ERROR, OK, StateDriver, tree

WITHOUT_ARRAYS = {"int_pub_rate", "int_timeout", "new_string_publish_values"}


def header(name, *children, message="OK"):
    return Status(0, name, message, "", tuple((child, "OK") for child in children))


def leaves(reader, *statuses):
    return {(leaf.group, leaf.component) for leaf in reader.read(statuses).leaves}


@pytest.mark.parametrize("case", sorted(set(CASES) - WITHOUT_ARRAYS))
def test_a_recording_gives_exactly_the_published_names(case):
    reader, twice = TreeReader(), TreeReader()

    found, groups = set(), set()
    for _t, array in aggregated(case):
        structure = reader.read(array.statuses)
        twice.read(array.statuses)
        assert twice.read(array.statuses) == structure
        found.update(leaf.component for leaf in structure.leaves)
        groups.update(path for _row, path in structure.groups)
        shown = {array.statuses[row].name for leaf in structure.leaves for row in leaf.rows}
        assert not shown & groups

    assert found == expected_names(case)


def test_the_first_array_after_a_start_has_no_components():
    stale = [Status(3, f"/{name}", "Stale") for name in ("Motor", "Laser")]

    assert leaves(TreeReader(), *stale) == set()


def test_slashes_and_cut_prefixes_come_back_from_the_headers_keys():
    found = leaves(
        TreeReader(),
        header("/Arms", "/arms/left/motor", "driver: elbow"),
        Status(0, "/Arms/ arms left motor", "OK"),
        Status(0, "/Arms/elbow", "OK"),
    )

    assert found == {("/Arms", "/arms/left/motor"), ("/Arms", "driver: elbow")}


def test_a_component_in_two_groups_is_one_and_belongs_to_the_first_in_byte_order():
    structure = TreeReader().read(
        [
            header("/b", "Motor"),
            Status(0, "/b/Motor", "OK"),
            header("/B", "Motor"),
            Status(0, "/B/Motor", "OK"),
        ]
    )

    assert [(leaf.component, leaf.group, leaf.rows) for leaf in structure.leaves] == [
        ("Motor", "/B", (1, 3))
    ]


def test_an_analyzer_groups_header_after_its_children_makes_none_of_them_a_leaf():
    found = leaves(
        TreeReader(),
        header("/R/Motor", "Motor 1"),
        Status(0, "/R/Motor/Motor 1", "OK"),
        Status(3, "/R/Camera", "Stale"),
        header("/R", "Camera", "Motor"),
        header("/R/Other", "Foo: bar"),
        Status(0, "/R/Other/Foo: bar", "OK"),
    )

    assert found == {("/R/Motor", "Motor 1"), ("/R/Other", "Foo: bar")}


def test_without_values_the_leafs_own_name_and_its_group_are_the_identity():
    structure = TreeReader().read(
        [
            Status(0, "/Motor", "OK"),
            Status(0, "/Motor/Motor 1", "OK"),
            Status(3, "/Camera", "Stale"),
            Status(0, "/Power", "OK"),
            Status(0, "/Power/Battery", "OK", "bat-7"),
        ]
    )

    assert [(leaf.group, leaf.component, leaf.exact) for leaf in structure.leaves] == [
        ("/Motor", "Motor 1", False),
        ("/Power", "Battery", False),
    ]


def test_what_was_a_group_once_is_never_a_leaf_again():
    reader = TreeReader()
    reader.read([header("/Base"), Status(0, "/Base/Drive", "fine", "hw", (("a", "1"),))])

    assert leaves(reader, Status(1, "/Base", "custom text", "hw")) == set()
    assert leaves(reader, Status(0, "/Base/Drive", "fine", "hw")) == {("/Base", "Drive")}


def test_the_structure_is_read_anew_when_only_a_headers_keys_change():
    reader = TreeReader()
    reader.read([header("/A", "x/y"), Status(0, "/A/x y", "OK")])

    assert leaves(reader, header("/A", "x y"), Status(0, "/A/x y", "OK")) == {("/A", "x y")}


def test_the_structure_is_read_anew_when_a_header_shows_to_be_none():
    reader, rows = TreeReader(), (header("/A", "x"), Status(0, "/A/x", "OK"))

    assert leaves(reader, *rows, Status(0, "/B", "OK")) == {("/A", "x")}
    assert leaves(reader, *rows, Status(0, "/B", "fine")) == {("/A", "x"), ("", "B")}


def test_empty_and_blank_names_are_components_of_their_own():
    found = leaves(
        TreeReader(),
        header("/Other", "", "   "),
        Status(1, "/Other/", ""),
        Status(0, "/Other/   ", "OK"),
    )

    assert found == {("/Other", ""), ("/Other", "   ")}


def test_what_changed_is_received_behind_what_did_not():
    motor = Status(OK, "Motor", "OK", "", (("U", "1"),))
    driver = StateDriver(Source.AGG)
    array = tree(Arms=(motor, Status(OK, "Laser", "OK")))
    driver.agg(*array)
    assert driver.agg(*array[:2], array[2]._replace(level=ERROR)).level("Laser") == ERROR
