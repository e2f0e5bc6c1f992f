"""docs/configuration.md and its reference agree with the models."""

from config_reference import PAGE as REFERENCE
from ros_diagnostics_exporter.config import patterns, scalars, yaml_file
from ros_diagnostics_exporter.config.scalars import RESERVED_LABEL_PREFIXES, RESERVED_LABELS
from ros_diagnostics_exporter.robots.rules import SEARCHED

DOCUMENT = REFERENCE.parents[1] / "configuration.md"


def test_prose_names_the_limits_and_reserved_labels():
    text = " ".join(DOCUMENT.read_text(encoding="utf-8").split())
    assert f"a file may have {yaml_file.MAX_BYTES // 2**20} mib" in text.lower()
    assert f"{yaml_file.MAX_VALUES:,} keys and values" in text
    assert f"{yaml_file.MAX_DEPTH} levels" in text
    assert f"up to {patterns.MAX_PATTERN} characters" in text
    assert f"first {SEARCHED} characters" in text
    assert f"0 to {scalars.MAX_DOMAIN_ID}" in text
    for label in {*RESERVED_LABELS, *RESERVED_LABEL_PREFIXES}:
        assert f"`{label}`" in text
