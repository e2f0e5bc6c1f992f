"""The API's description has the words that events have: those that the code records."""

import ast
from pathlib import Path
from typing import get_args, get_type_hints

import ros_diagnostics_exporter
from ros_diagnostics_exporter.events import KINDS
from ros_diagnostics_exporter.model import Level
from ros_diagnostics_exporter.notifications import Message
from ros_diagnostics_exporter.web.app import openapi

PACKAGE = Path(ros_diagnostics_exporter.__file__).parent
DESCRIBED = openapi("/metrics")["components"]["schemas"]["Event"]["properties"]
FORWARDERS = {"record", "_record_level", "_action"}  # make an event of a word that they get


def literals(node: ast.expr | None) -> set[str]:
    """The texts that an expression may be, as far as they are written in it."""
    if isinstance(node, ast.IfExp):
        return literals(node.body) | literals(node.orelse)
    if isinstance(node, ast.BoolOp):
        return set().union(*map(literals, node.values))
    is_text = isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value
    return {node.value} if is_text else set()


def recorded() -> tuple[set[str], set[str]]:
    """(the kinds, the words of ``after``) that are written where events are made."""
    kinds, after = set(), set()
    trees = [ast.parse(path.read_text()) for path in PACKAGE.rglob("*.py")]
    calls = [each for tree in trees for each in ast.walk(tree) if isinstance(each, ast.Call)]
    for call in calls:
        given = {each.arg: each.value for each in call.keywords}
        if isinstance(call.func, ast.Name) and call.func.id == "Event":
            kinds |= literals(call.args[1] if len(call.args) > 1 else given["kind"])
            after |= literals(given.get("after"))
        elif getattr(call.func, "attr", getattr(call.func, "id", "")) in FORWARDERS:
            after |= set().union(*map(literals, call.args))
    return kinds, after


def test_every_kind_that_is_recorded_is_described_and_no_other():
    kinds, _after = recorded()

    assert kinds == set(KINDS) == set(DESCRIBED["kind"]["enum"])


def test_every_word_for_what_came_after_is_described_and_no_other():
    _kinds, after = recorded()
    alert = get_args(get_type_hints(Message)["alerts"])[0]
    statuses = set(get_args(get_type_hints(alert)["status"]))  # of what Alertmanager posts
    levels = {level.name for level in Level}

    assert after | levels | statuses == set(DESCRIBED["after"]["enum"])
