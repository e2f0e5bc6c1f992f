"""The examples of the documentation: they load without a warning and fit the schema."""

import json
import re
from pathlib import Path

import pytest
from jsonschema import Draft7Validator

from ros_diagnostics_exporter.config.load import load
from ros_diagnostics_exporter.config.yaml_file import read

EXAMPLES = Path(__file__).parents[3] / "docs" / "examples"
FILES = sorted(EXAMPLES.rglob("*.yml"))
FLEETS = [path for path in FILES if "fleet: " in path.read_text(encoding="utf-8")]


@pytest.mark.parametrize("path", FLEETS, ids=lambda path: str(path.relative_to(EXAMPLES)))
def test_example_loads_without_a_warning(path):
    fleet = load(path)
    assert fleet.robots or fleet.discoveries
    assert fleet.warnings == ()


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(EXAMPLES)))
def test_example_fits_the_schema_that_it_names(path):
    text = path.read_text(encoding="utf-8")
    named = re.search(r"^# yaml-language-server: \$schema=(.+)$", text, re.MULTILINE)
    schema = json.loads((path.parent / named[1]).read_text(encoding="utf-8"))
    document, problems = read(path)
    assert problems == []
    Draft7Validator(schema).validate(document.data)


def test_every_file_of_an_example_is_read_by_one():
    read_files = {source for path in FLEETS for source in load(path).sources}
    assert {*FILES} <= read_files
