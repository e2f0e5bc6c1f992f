"""Whatever stands in the file, it is a Fleet or a ConfigError: nothing else comes out."""

import json

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from config_schema import schema
from ros_diagnostics_exporter.config.errors import ConfigError
from ros_diagnostics_exporter.config.fleet import Fleet
from ros_diagnostics_exporter.config.load import load

FLEET = schema(Fleet)
ENTRIES = (FLEET, *FLEET["definitions"].values())
KEYS = sorted({key for entry in ENTRIES for key in entry["properties"]} | {"regex", "default"})
WORDS = ["/{robot}/diagnostics_agg", "/r", "5s", "Mon 22:00-06:00", "2026-03-01", "UTC", "a*", "r"]

LEAVES = st.one_of(
    *(st.none(), st.booleans(), st.integers(), st.floats(), st.text()), st.sampled_from(WORDS)
)
DATA = st.recursive(
    LEAVES,
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(st.sampled_from(KEYS) | st.text(max_size=5), inner, max_size=6)
    ),
    max_leaves=30,
)


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return tmp_path_factory.mktemp("fuzz") / "fleet.yml"


def outcome(path):
    try:
        assert isinstance(load(path), Fleet)
    except ConfigError as error:
        assert error.problems  # noqa: PT017 - a Fleet is as good
        for problem in error.problems:
            assert str(problem).isprintable()


@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(content=st.binary() | st.text().map(str.encode))
def test_any_bytes_are_a_fleet_or_an_error(path, content):
    path.write_bytes(content)
    outcome(path)


@settings(max_examples=150, suppress_health_check=[HealthCheck.too_slow])
@given(data=st.dictionaries(st.sampled_from([*Fleet.keys]), DATA))
def test_any_values_of_known_keys_are_a_fleet_or_an_error(path, data):
    path.write_text(json.dumps({"fleet": "x", **data}), encoding="utf-8")
    outcome(path)
