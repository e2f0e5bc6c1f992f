"""Regular expressions: those that a robot's text could hold up are refused, others are not."""

import re

import pytest

from ros_diagnostics_exporter.config.patterns import expression


@pytest.mark.parametrize(
    "source",
    [
        *("Motor", "^/Arm/.*joint [1-6]$", "(left|right) wheel", "(ab)+", "[()*+]+", r"\(\d+\)*"),
        *("(?i)motor", "(?:a|b)?", "(a|b){2}", "(?P<robot>[a-z]+)_.*", "[]a]*", "[^]a]*", "a{0,7}"),
        *("(?=a*)b", "x{3}", "(?#a comment)a+", "(?i:a)+", r"a\+", r"[a\[b]", "a--b", "{", "a{,5}"),
    ],
)
def test_harmless_expression_is_taken_as_it_is(source):
    assert expression(source) == re.compile(source)


@pytest.mark.parametrize(
    "source",
    [
        *(
            "(a+)+",
            "(a*)*b",
            "(?:a+b?)*",
            "((a+)b)+",
            "(a|a)*",
            "(a|b){8}",
            "(a?){30}",
            "(a{2,3})+",
        ),
        *("([a-z]+)*$", r"(\w+\s?)+$", "(?P<robot>a+)+", "(a+){2,9}", "(?i)(a+)+", "(a+)*?"),
        *("(a*){8,}", "((?:a|b)c)+", "(?#a comment)(a+)+", "[)](a+)+", r"\)(a+)+", "(a{,3})+"),
    ],
)
def test_group_that_repeats_a_choice_is_refused(source):
    with pytest.raises(ValueError, match="repeats a group that can match one text in several ways"):
        expression(source)


@pytest.mark.parametrize("source", [".*.*.*.*", r"\w+\w+\w+\w+", "a{2,}b*c+d{0,8}"])
def test_more_than_three_repetitions_are_refused(source):
    with pytest.raises(ValueError, match="has more than 3 repetitions"):
        expression(source)


@pytest.mark.parametrize(
    ("source", "text"),
    [
        ("[a-", "unterminated character set at character 1"),
        ("a)", r"unbalanced parenthesis at character 2"),
        ("*a", "nothing to repeat at character 1"),
        ("a{99999999999}", "repetition number is too large"),
        ("[[a]", r"has a set of signs with \[, --, &&, ~~ or \|\| in it"),
        ("[a--b]", "has a set of signs"),
        ("a" * 501, "has 501 characters"),
        ("(?x)a # (", r"uses \(\?x\)"),
    ],
)
def test_invalid_expression_is_refused_with_its_position(source, text):
    with pytest.raises(ValueError, match=text):
        expression(source)
