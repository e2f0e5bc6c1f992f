"""The committed tables are those of the committed measurements."""

from __future__ import annotations

import importlib
import shutil

import pytest

from experiments.machine import CHECKOUT
from experiments.results import Results

FOLDER = CHECKOUT / "docs" / "experiments"
NAMES = sorted(path.stem for path in FOLDER.glob("*.csv") if path.stem != "soak")


@pytest.mark.parametrize("name", NAMES)
def test_a_report_is_made_from_the_measurements_alone(tmp_path, name):
    pytest.importorskip("matplotlib", reason="./run experiment installs it")
    for path in FOLDER.glob("*.[cj]s*"):  # some read the results of others too
        shutil.copy(path, tmp_path)

    text = importlib.import_module(f"experiments.{name}").render(Results(tmp_path, name))

    assert text == (FOLDER / f"{name}.md").read_text()
