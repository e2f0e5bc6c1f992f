"""lab/mutation: mutants of `except` clauses, and what `./run mutate` leaves out."""

from __future__ import annotations

import pytest
import yaml

from mutation import handlers
from testbed.configuration import CHECKOUT

PACKAGES = CHECKOUT / "exporter" / "ros_diagnostics_exporter"
SURVIVORS = yaml.safe_load((CHECKOUT / "lab/mutation/survivors.yml").read_text())


@pytest.mark.parametrize("survivor", SURVIVORS, ids=lambda survivor: survivor["now"])
def test_a_mutant_that_does_not_count_is_of_a_line_that_is_there(survivor):
    lines = [line.strip() for line in (PACKAGES / survivor["file"]).read_text().splitlines()]

    assert survivor["was"] in lines
    assert survivor["now"] not in lines
    assert survivor["why"]


def test_each_class_that_is_caught_is_replaced_alone():
    text = "try: go()\nexcept (OSError, sqlite3.Error) as error: pass\nexcept a.B: pass\n"
    found = [handlers.replaced(text, each) for each in range(len(handlers.positions(text)))]
    assert found == [
        text.replace(caught, "CosmicRayTestingException")
        for caught in ("OSError", "sqlite3.Error", "a.B")
    ]
    assert handlers.positions("try: go()\nexcept: pass\n") == []
