"""docs/metrics.md says what metrics.py and the state say."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import ros_diagnostics_exporter
from ros_diagnostics_exporter.metrics import ALL_FAMILIES
from ros_diagnostics_exporter.metrics_reference import main, renewed

DOCUMENT = Path(__file__).parents[3] / "docs" / "metrics.md"
STATE = Path(ros_diagnostics_exporter.__file__).parent / "state"


def test_the_tables_are_what_the_code_says():
    """If not: python -m ros_diagnostics_exporter.metrics_reference docs/metrics.md."""
    text = DOCUMENT.read_text("utf-8")
    assert renewed(text) == text
    assert all(f"| `{family.name}` |" in text for family in ALL_FAMILIES)


def test_the_command_renews_a_document(tmp_path):
    path = tmp_path / "metrics.md"
    text = DOCUMENT.read_text("utf-8")
    path.write_text(re.sub(r"^\| `ros_diagnostics_robot_up` .*\n", "", text, flags=re.MULTILINE))
    main([str(path)])
    assert path.read_text("utf-8") == text


def test_a_document_without_a_table_is_refused():
    with pytest.raises(ValueError, match="not for"):
        renewed("<!-- families of rockets -->\n<!-- end -->")


def test_every_reason_of_the_state_is_explained_and_no_other():
    code = "\n".join(path.read_text("utf-8") for path in STATE.glob("*.py"))
    counted = set(re.findall(r"reject\(\s*\"(\w+)\"", code))
    counted |= set(re.findall(r"rejected\[\"(\w+)\"\]", code))
    assert len(counted) >= 6
    text = DOCUMENT.read_text("utf-8")
    rows = [row.split("|")[1] for row in text.splitlines() if re.match(r"\| `[a-z_]+`", row)]
    explained = {word for row in rows for word in re.findall(r"`([a-z_]+)`", row)}
    assert counted <= explained
    reasons = {word for word in explained if not word.startswith("ros_diagnostics_")}
    assert all(f'"{reason}"' in code for reason in reasons)
