"""The texts of an identity, as events and the API have them, give it again."""

import pytest

from ros_diagnostics_exporter.config.fleet import Fleet
from ros_diagnostics_exporter.config.shard import Shard
from ros_diagnostics_exporter.faults.model import (
    Identity,
    Scope,
    State,
    as_texts,
    fault_id,
    fault_of,
)

FLEET = Fleet("f", exporter="x")


@pytest.mark.parametrize(
    "identity",
    [
        Identity(Scope.COMPONENT, State.CRITICAL, robot="r", group="/g", component="c"),
        Identity(Scope.VALUE, State.WARNING, robot="r", component="c", key="k", bound="high"),
        Identity(Scope.CHECK, State.CRITICAL, robot="r", check="c"),
        Identity(Scope.CAPABILITY, State.LOST, robot="r", check="c"),
        Identity(Scope.ROBOT, State.SILENT, robot="r"),
        Identity(Scope.ROBOT, State.MANY, robot="r", severity="warning"),
        Identity(Scope.FLAPPING, State.FLAPPING, robot="r", component="c"),
        Identity(Scope.SITE, State.SILENT, site="hall"),
        Identity(Scope.COMMON, State.CRITICAL, component="c"),
    ],
    ids=str,
)
def test_the_texts_of_an_identity_give_its_id(identity):
    texts = as_texts(identity, {"site": "yard"})
    assert fault_of(FLEET, texts) == fault_id(FLEET, identity)
    without_empty = {name: text for name, text in texts.items() if text}
    assert fault_of(FLEET, without_empty) == fault_id(FLEET, identity)


@pytest.mark.parametrize("texts", [{}, {"scope": "rocket", "state": "critical"}])
def test_texts_of_another_version_have_no_id(texts):
    with pytest.raises((LookupError, ValueError)):
        fault_of(FLEET, texts)


def test_the_id_of_a_fault_is_the_same_for_ever():
    """It is in links of mails, and in acknowledgements that Alertmanager has."""
    a, b = (Fleet("f", exporter=each) for each in "ab")
    of_robot = Identity(Scope.COMPONENT, State.CRITICAL, robot="r", group="/g", component="c")
    of_site = Identity(Scope.SITE, State.SILENT, site="hall")

    assert fault_id(a, of_robot) == fault_id(b, of_robot) == "91014e685cc2"
    assert [fault_id(each, of_site) for each in (a, b)] == ["8e030bfacb59", "a0afa3224c46"]


def test_what_shards_judge_alike_has_one_id_and_what_is_wrong_with_each_another():
    shards = [Fleet("f").part(Shard(number, 2)) for number in (1, 2)]
    more = Fleet("f").part(Shard(1, 3))
    for of, number in (
        (Identity(Scope.SITE, State.SILENT, site="hall"), 1),
        (Identity(Scope.COMMON, State.CRITICAL, component="c"), 1),
        (Identity(Scope.COMPONENT, State.CRITICAL, robot="r", component="c"), 1),
        (Identity(Scope.EXPORTER, State.WARNING, component="database"), 2),
    ):
        assert len({fault_id(each, of) for each in shards}) == number
        assert fault_id(more, of) == fault_id(shards[0], of)
