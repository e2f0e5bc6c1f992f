"""The table of families follows Prometheus' naming rules."""

from __future__ import annotations

import re

from ros_diagnostics_exporter.metrics import families as metrics
from ros_diagnostics_exporter.metrics.self_metrics import ALL_FAMILIES, EXPORTER_FAMILIES


def test_every_family_has_a_name_of_its_own():
    names = [family.name for family in ALL_FAMILIES]

    assert len(names) == len(set(names))


def test_names_follow_the_rules_of_their_type():
    for family in ALL_FAMILIES:
        assert re.fullmatch(r"ros_diagnostics_[a-z][a-z0-9_]*", family.name)
        assert family.name.endswith("_total") == (family.type == "counter")
        assert family.help.endswith(".")


def test_every_series_says_its_fleet_and_robot():
    for family in metrics.FLEET_FAMILIES:
        assert family.labels[:2] == ("fleet", "robot")
    for family in EXPORTER_FAMILIES:
        assert family.labels[0] == "fleet"
