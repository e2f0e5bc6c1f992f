"""The JSON Schema for editors agrees with the models and is never stricter than the loader."""

import json
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from jsonschema import Draft7Validator

from config_schema import SCHEMAS, schema
from ros_diagnostics_exporter.config.errors import ConfigError
from ros_diagnostics_exporter.config.load import load
from ros_diagnostics_exporter.config.yaml_file import read
from support.config_examples import DEFINITIONS, FLEET, PROPERTIES, whole

CONFIGS = Path(__file__).parents[2] / "data/configs"
VALIDATOR = Draft7Validator(FLEET)


@pytest.fixture
def load_data(tmp_path):
    for folder in ("robots", "maintenance", "queries"):
        (tmp_path / f"{folder}.d").mkdir()
        (tmp_path / "fleet" / folder).mkdir(parents=True)

    def loaded(data):
        path = tmp_path / "fleet.yml"
        path.write_text(json.dumps(data), encoding="utf-8")
        return load(path)

    return loaded


@pytest.mark.parametrize("name", SCHEMAS)
def test_schema_is_one_of_draft_7(name):
    Draft7Validator.check_schema(schema(SCHEMAS[name]))


@pytest.mark.parametrize(("name", "key"), PROPERTIES)
def test_every_key_has_a_description_and_an_example_that_loads(load_data, name, key):
    described = DEFINITIONS[name]["properties"][key]
    assert described["description"].endswith(".")
    for example in described["examples"]:
        data = whole(name, {key: example})
        VALIDATOR.validate(data)
        load_data(data)


@pytest.mark.parametrize("name", DEFINITIONS)
def test_default_in_the_schema_applies_to_a_missing_key(load_data, name):
    keys = DEFINITIONS[name]["properties"]
    defaults = {key: each["default"] for key, each in keys.items() if "default" in each}
    assert load_data(whole(name, defaults)) == load_data(whole(name, {}))


def test_the_schema_has_defaults_as_they_are_written_and_none_where_there_is_none():
    profile = DEFINITIONS["Profile"]["properties"]
    assert profile["stale_after"]["default"] == "10s"
    assert "default" not in FLEET["properties"]["fleet"]


# Wrong only together with the rest of the file.
BETWEEN_ENTRIES = {
    *("one-topic", "duplicate-robots", "profiles", "limits", "faults-order", "uplinks"),
    "fleet-capability-names",
}


@pytest.mark.parametrize("path", sorted(CONFIGS.glob("bad-*.yml")), ids=lambda path: path.stem)
def test_bad_file_is_invalid_in_an_editor_unless_the_problem_is_between_entries(path):
    document, problems = read(path)
    if not problems:  # else YAML itself is wrong
        between = path.stem.removeprefix("bad-") in BETWEEN_ENTRIES
        assert VALIDATOR.is_valid(document.data) is between


ENTRIES = st.one_of(
    *(
        st.dictionaries(
            st.sampled_from(sorted(definition["properties"])),
            st.one_of(
                *(st.none(), st.booleans(), st.integers(-1, 300), st.floats(-1, 1e9)),
                st.text(max_size=6),
                st.sampled_from(
                    [
                        example
                        for each in definition["properties"].values()
                        for example in each["examples"]
                    ]
                ),
                st.sampled_from(["5s", "0s", "/", "agg", "raw", "name", "Mon 00:00-24:00", [], {}]),
            ),
            max_size=4,
        ).map(lambda entry, name=name: (name, entry))
        for name, definition in DEFINITIONS.items()
    )
)


@settings(max_examples=200, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(entry=ENTRIES)
def test_schema_accepts_whatever_loads(load_data, entry):
    data = whole(*entry)
    try:
        load_data(data)
    except ConfigError:
        return
    VALIDATOR.validate(data)


def test_a_default_is_as_it_is_written_in_the_file_or_not_there():
    assert DEFINITIONS["Discovery"]["properties"]["domain_ids"]["default"] == [0]
    assert "default" not in DEFINITIONS["Profile"]["properties"]["stale_is_critical"]
