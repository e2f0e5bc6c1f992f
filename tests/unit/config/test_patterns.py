"""Regular expressions: no text that a robot publishes takes long to search."""

import pytest

from ros_diagnostics_exporter.config.patterns import expression, split, wildcard, word


@pytest.mark.parametrize(
    ("source", "found", "not_found"),
    [
        ("^/Arm/.*joint [1-6]$", "/Arm/left joint 3", "/Arm/left joint 7"),
        ("(left|right) wheel", "the left wheel", "the front wheel"),
        ("(?i)motor", "MOTOR", "Laser"),
        (r"\pL+ä", "größä", "ä"),
        ("a.b", "a\u20acb", "a\nb"),
        ("[]a]b", "]b", "[b"),
    ],
)
def test_expression_is_searched_as_it_is(source, found, not_found):
    pattern = expression(source)
    assert pattern.search(found)
    assert not pattern.search(not_found)


@pytest.mark.parametrize(
    "source",
    [
        *("(.{1,7}){1,7}" * 3 + "!", "(a+)+$", r"(\w+\s?)+$", ".*.*.*.*.*.*!", "(a?){30}!"),
        *("((a{1,9}){1,9}){1,9}!", "(a|a|a)*!"),
    ],
)
def test_expression_that_is_slow_in_a_backtracking_engine_is_harmless(source):
    """Python's re takes seconds for 20 characters of the first: the test would time out."""
    hostile = "a" * 256
    assert not expression(source + "b").search(hostile)
    assert expression(source + "b").fullmatch(hostile) is None


@pytest.mark.parametrize(
    ("source", "text"),
    [
        ("[a-", r"missing \]: \[a-"),
        ("a)", r"unexpected \): a\)"),
        ("*a", r"no argument for repetition operator: \*"),
        ("a{1001}", r"invalid repetition size: \{1001\}"),
        ("(?=a)b", r"of RE2, Prometheus' dialect \(invalid perl operator: \(\?=\)"),
        ("(?<!a)b", "RE2 has no lookaround and no backreferences"),
        (r"(a)\1", r"invalid escape sequence: \\1"),
        ("(?x)a # (", r"invalid perl operator: \(\?x"),
        (r"(\pL{100}){10}", "pattern too large"),
        ("a" * 501, "has 501 characters"),
    ],
)
def test_invalid_expression_is_rejected_with_the_reason(source, text, capfd):
    with pytest.raises(ValueError, match=text):
        expression(source)
    assert capfd.readouterr().err == ""  # where RE2 would log it


def test_word_ignores_case_and_means_itself():
    assert word("motor (Ä)").search("Left MOTOR (ä) 1")
    assert not word("a.c").search("abc")


def test_wildcard_is_anything_however_many_there_are():
    assert wildcard("a*b*c*d*e").fullmatch("a1b\n2c3d4e")
    assert wildcard("a*b*c*d*e").fullmatch("a1b2c3d4ef") is None


def test_unpaired_surrogates_are_searched_as_well():
    assert expression("Motor").search("Motor \ud800")
    assert expression("Motor .").fullmatch("Motor \ud800")


def test_patterns_of_two_reads_of_a_config_are_equal():
    """Or a reload would treat every robot as changed."""
    assert expression("a+") == expression("a+")
    assert word("a") == word("a") != word("b")
    assert word("a") != expression("a")


def test_the_name_of_a_robot_is_followed_by_that_of_its_component_whatever_that_has():
    found = split("{robot}/{component}").fullmatch("r1/Motor\n2")
    assert found is not None
    assert (found["robot"], found["component"]) == ("r1", "Motor\n2")
