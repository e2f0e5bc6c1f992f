"""The texts of an identity, as events and the API have them, give it again."""

import pytest

from ros_diagnostics_exporter.config.fleet import Fleet
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
