"""The texts of an identity, as events and the API have them, give it again."""

from __future__ import annotations

import pytest

from ros_diagnostics_exporter.faults.model import Identity, Scope, State, as_texts, identity_of


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
def test_the_texts_of_an_identity_give_it_again(identity):
    assert identity_of(as_texts(identity, {"site": "yard"})) == identity
