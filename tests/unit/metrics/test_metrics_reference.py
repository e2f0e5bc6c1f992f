"""docs/metrics.md and its reference agree with the families and with the reasons of the state."""

from __future__ import annotations

import re
from typing import get_args

import pytest

from metrics_reference import PAGE as REFERENCE
from ros_diagnostics_exporter.metrics.families import ROBOT_SILENT_REASON
from ros_diagnostics_exporter.robots.rejections import (
    OVER_LIMIT,
    FleetRejectionReason,
    RejectionReason,
    SilentReason,
)

DOCUMENT = REFERENCE.parents[1] / "metrics.md"


@pytest.mark.parametrize(
    ("table", "reasons"),
    [
        ("`robot_silent_reason` says", {*get_args(SilentReason), OVER_LIMIT}),
        ("`robot_rejected_total` counts", set(get_args(RejectionReason))),
        ("`exporter_rejected_total` counts", set(get_args(FleetRejectionReason))),
    ],
)
def test_every_reason_is_explained_and_no_other(table, reasons):
    """That the state uses no reason beyond these is checked by their types."""
    _, _, after = DOCUMENT.read_text("utf-8").partition(f"\n{table}")
    rows = re.search(r"(\n\|.*)+", after)[0].splitlines()
    cells = [row.split("|")[1] for row in rows if row.startswith("| `")]
    assert {word for cell in cells for word in re.findall(r"`(\w+)`", cell)} == reasons


def test_the_help_of_silence_names_every_reason():
    named = ROBOT_SILENT_REASON.help.partition("(")[2]
    assert set(re.findall(r"\w+", named)) == {*get_args(SilentReason), OVER_LIMIT}
