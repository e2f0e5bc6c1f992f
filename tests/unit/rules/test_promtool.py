"""Each promtool test of prometheus/tests is one pytest test, which can be run and named alone.

Without pytest: `promtool test rules prometheus/tests/*.yml`.
"""

import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from ros_diagnostics_exporter.metrics.families import FAULT_FAMILIES, FLEET_FAMILIES, PREFIX
from ros_diagnostics_exporter.metrics.self_metrics import EXPORTER_FAMILIES
from support.shipped_rules import PROMETHEUS, PROMTOOL_TESTS, read_yaml, run_tool


def promtool_tests() -> list[Any]:
    return [
        pytest.param(file, number, id=f"{file.stem.removesuffix('_test')}: {test['name']}")
        for file in PROMTOOL_TESTS
        for number, test in enumerate(read_yaml(file)["tests"])
    ]


@pytest.mark.parametrize(("file", "number"), promtool_tests())
def test_rules(file: Path, number: int, tmp_path: Path):
    """Because promtool 2.42 cannot run one test of a file, each is written to its own file."""
    whole = read_yaml(file)
    names = [str(file.parent / name) for name in whole["rule_files"]]
    document = {**whole, "tests": [whole["tests"][number]], "rule_files": names}
    alone = tmp_path / file.name
    alone.write_text(yaml.safe_dump(document, allow_unicode=True))

    run_tool("promtool", "test", "rules", alone)


def test_names_are_unique():
    names = [test["name"] for file in PROMTOOL_TESTS for test in read_yaml(file)["tests"]]

    assert len(names) == len(set(names))


def test_the_exporters_families_that_are_fed_exist():
    served = {each.name for each in (*FLEET_FAMILIES, *FAULT_FAMILIES, *EXPORTER_FAMILIES)}
    fed = {
        re.match(r"\w+", each["series"])[0]
        for file in PROMTOOL_TESTS
        for test in read_yaml(file)["tests"]
        for each in test.get("input_series") or ()
        if each["series"].startswith(PREFIX)
    }

    assert len(fed) > 15
    assert fed <= served


def test_promtool_accepts_rules_and_configuration():
    run_tool("promtool", "check", "rules", *sorted((PROMETHEUS / "rules").glob("*.yml")))
    run_tool("promtool", "check", "config", PROMETHEUS / "prometheus.yml")
