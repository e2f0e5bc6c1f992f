"""lab/mutation/survivors.yml: what `./run mutate` leaves out is still in the code."""

from __future__ import annotations

import pytest
import yaml

from testbed.configuration import CHECKOUT

PACKAGES = CHECKOUT / "exporter" / "ros_diagnostics_exporter"
SURVIVORS = yaml.safe_load((CHECKOUT / "lab/mutation/survivors.yml").read_text())


@pytest.mark.parametrize("survivor", SURVIVORS, ids=lambda survivor: survivor["now"])
def test_a_mutant_that_does_not_count_is_of_a_line_that_is_there(survivor):
    lines = [line.strip() for line in (PACKAGES / survivor["file"]).read_text().splitlines()]

    assert survivor["was"] in lines
    assert survivor["now"] not in lines
    assert survivor["why"]
