"""A bound of an attack that does not hold fails the bench."""

import math
from dataclasses import fields, replace

from bench.attacks import ATTACKS, Bound
from bench.hostile import CALM, Result, print_bounds

CALM_RESULT = Result(
    **{each.name: 1.0 for each in fields(Result)} | {"up": 20.0, "memory": 100.0, "kept": math.nan}
)


def played(capsys, **seen: float) -> tuple[bool, str]:
    results = {"no attack": CALM_RESULT, "newcomers": replace(CALM_RESULT, **seen)}
    attacks = {"no attack": CALM, "newcomers": ATTACKS["newcomers"]}
    return print_bounds(results, attacks), capsys.readouterr().out


def test_all_that_holds_is_printed(capsys):
    holds, text = played(capsys, memory=190.0, faults_p99=499.0)
    assert holds
    assert "FAILED" not in text
    assert "memory at most 2 times that without an attack: 1.9" in text
    assert "faults_p99 at most 500: 499" in text


def test_one_that_does_not_hold_fails(capsys):
    for seen in ({"memory": 201.0}, {"faults_p99": 501.0}, {"up": 19.0}, {"up": math.nan}):
        holds, text = played(capsys, **seen)
        assert not holds
        assert text.count("FAILED") == 1


def test_a_bound_says_what_it_is():
    assert str(Bound("kept", at_least=0.95)) == "kept at least 0.95"
    assert str(Bound("up", at_least=1, at_most=2)) == "up at most 2 and at least 1"
