"""The JSON Schema for editors agrees with the models and is never stricter than the loader."""

import json
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from jsonschema import Draft7Validator

from config_schema import SCHEMAS, schema
from ros_diagnostics_exporter.config.errors import ConfigError
from ros_diagnostics_exporter.config.fleet import Fleet
from ros_diagnostics_exporter.config.load import load
from ros_diagnostics_exporter.config.yaml_file import read

CONFIGS = Path(__file__).parents[2] / "data/configs"
FLEET = schema(Fleet)
VALIDATOR = Draft7Validator(FLEET)

# The required keys of each kind of entry, and its place in fleet.yml.
DOWNTIME = {"name": "x", "comment": "x", "selector": {"robot": "*"}}
PROFILE = {"default": {}, "turtlebot4": {}, "wheeled": {}, "arm": {}}
LIFTING = {"default": {"capabilities": {"lifting": ["Lift"]}}}


def default(**keys):
    return {"profiles": {"default": keys}}


def needed(entry, needs, *keys):
    """What an entry needs that has none of these keys."""
    return {} if {*keys} & {*entry} else needs


def condition(entry):
    limits = {"equals", "below", "above"} & {*entry}
    return {
        **needed(entry, {"component": "x"}, "key"),
        **({"key": "x"} if limits else {}),
        **({"equals": "x"} if "key" in entry else {}),
        **needed(entry, {"level": "OK"}, "key", "equals", "below", "above"),
        **entry,
    }


WHOLE = {
    "Fleet": lambda entry: entry,
    "Robot": lambda entry: {"robots": [{"name": "r", **entry}]},
    "Discovery": lambda entry: {"discovery": [entry]},
    "Shared": lambda entry: {"shared": [{"topic": "/diagnostics", **entry}]},
    "Profile": lambda entry: {"profiles": {**PROFILE, "x": entry}},
    "Check": lambda entry: default(checks={"x": entry}),
    "ComponentRule": lambda entry: default(
        components=[
            {"match": "x", **({"reports": "on_change"} if "ends_after" in entry else {}), **entry}
        ]
    ),
    "Condition": lambda entry: default(components=[{"match": "x", "unless": condition(entry)}]),
    "ValueRule": lambda entry: default(
        values=[{**({"thresholds": {}} if {"when", "unless"} & {*entry} else {}), **entry}]
    ),
    "TopicEntry": lambda entry: default(
        topics=[
            {
                "topic": "t",
                "component": "c",
                **needed(entry, {"field": "data"}, "field", "fields"),
                **({"field": "data"} if {"levels", "error_when"} & {*entry} else {}),
                **entry,
            }
        ]
    ),
    "Capability": lambda entry: default(
        capabilities={
            "front view": ["Camera"],
            "x": {**needed(entry, {"all": "Motor"}, "all", "any", "at_least"), **entry},
        }
    ),
    "FleetCapability": lambda entry: {
        "profiles": LIFTING,
        "capabilities": {
            "x": {**needed(entry, {"all": [{"can": "lifting"}]}, "all", "any", "at_least"), **entry}
        },
    },
    "Thresholds": lambda entry: default(values=[{"thresholds": entry}]),
    "Bound": lambda entry: default(values=[{"thresholds": {"low": entry}}]),
    "FaultSettings": lambda entry: {"faults": entry},
    "Flapping": lambda entry: {"faults": {"flapping": entry}},
    "Intermittent": lambda entry: {"faults": {"intermittent": entry}},
    "RecordingSettings": lambda entry: {"recordings": entry},
    "Falling": lambda entry: {"faults": {"falling": entry}},
    "Many": lambda entry: {"faults": {"many": entry}},
    "Site": lambda entry: {"faults": {"site": entry}},
    "Common": lambda entry: {"faults": {"common": entry}},
    "WarningHours": lambda entry: {
        "faults": {"warning_hours": {"weekly": ["daily 06:00-18:00"], **entry}}
    },
    "Graph": lambda entry: default(graph=entry),
    "Watched": lambda entry: default(graph={"watch": entry}),
    "ActionRule": lambda entry: default(actions=[{"match": "x", **entry}]),
    "TooMany": lambda entry: default(
        actions=[{"match": "x", "started": {**needed(entry, {"critical": 9}, "critical"), **entry}}]
    ),
    "Modes": lambda entry: default(
        modes={"component": "x", "key": "x", "autonomous": "x", **entry}
    ),
    "Limits": lambda entry: {"limits": entry},
    "Query": lambda entry: {"queries": [{"expr": "up", "component": "c", **entry}]},
    "Zenoh": lambda entry: {
        "zenoh": {
            "routers": ["tcp/a:7447"],
            **({"password_file": "/x"} if "user" in entry else {}),
            **({"user": "x"} if "password_file" in entry else {}),
            **({"key_file": "/x"} if "cert_file" in entry else {}),
            **({"cert_file": "/x"} if "key_file" in entry else {}),
            **entry,
        }
    },
    "Maintenance": lambda entry: {
        "maintenance": [{**DOWNTIME, **needed(entry, {"start": "2026-01-01"}, "end"), **entry}]
    },
}
DEFINITIONS = {"Fleet": FLEET, **FLEET["definitions"]}
PROPERTIES = [
    (name, key) for name, definition in DEFINITIONS.items() for key in definition["properties"]
]


def whole(name, entry):
    if name == "Discovery" and "type" not in entry:
        entry = {"topic": "/x" if "zenoh" in entry else "/{robot}/diagnostics", **entry}
    made = {"fleet": "x", **WHOLE[name](entry)}
    if name == "Fleet" and "capabilities" in entry and "profiles" not in entry:
        made["profiles"] = LIFTING
    if name in {"Robot", "Discovery", "Shared"} and "zenoh" in entry:
        made["zenoh"] = {"routers": ["tcp/a:7447"]}
    if "profiles" not in made:
        made["profiles"] = PROFILE
    return made


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
