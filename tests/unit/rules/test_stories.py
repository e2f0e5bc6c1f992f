"""Each story of prometheus/tests is one test, so that a failure and a reference can name it.

`promtool test rules prometheus/tests/*.yml` runs the same files by hand.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from support.shipped_rules import PROMETHEUS, STORY_FILES, run_tool


def stories() -> list[Any]:
    return [
        pytest.param(file, number, id=f"{file.stem.removesuffix('_test')}: {story['name']}")
        for file in STORY_FILES
        for number, story in enumerate(yaml.safe_load(file.read_text())["tests"])
    ]


@pytest.mark.parametrize(("file", "number"), stories())
def test_story(file: Path, number: int, tmp_path: Path):
    """Of 2.42, promtool cannot run one story of a file, so each gets a file of its own."""
    document = yaml.safe_load(file.read_text())
    document["tests"] = [document["tests"][number]]
    document["rule_files"] = [str(file.parent / name) for name in document["rule_files"]]
    alone = tmp_path / file.name
    alone.write_text(yaml.safe_dump(document, allow_unicode=True))

    run_tool("promtool", "test", "rules", alone)


def test_every_story_has_a_name_of_its_own():
    names = [story["name"] for f in STORY_FILES for story in yaml.safe_load(f.read_text())["tests"]]

    assert len(names) == len(set(names))


def test_rules_and_configuration_pass_promtool():
    run_tool("promtool", "check", "rules", *sorted((PROMETHEUS / "rules").glob("*.yml")))
    run_tool("promtool", "check", "config", PROMETHEUS / "prometheus.yml")
