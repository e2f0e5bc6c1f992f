"""The keys of fleet.yml are the described fields of what the exporter reads, and no others."""

import pytest

from ros_diagnostics_exporter.config.fleet import Check, Profile
from ros_diagnostics_exporter.config.keys import Entry


@pytest.mark.parametrize(
    ("entry", "error"),
    [
        ("robots: [{name: r, topic_agg: /a}]", "robots[r].topic_agg: is not a key"),
        ("shared: [{topic: /a, raw: true}]", "shared[0].raw: is not a key"),
        ("discovery: [{template: /a}]", "discovery[0].template: is not a key"),
        ("profiles: {a: {name: b}}", "profiles.a.name: is not a key"),
        ("warnings: []", "warnings: is not a key"),
    ],
)
def test_what_is_made_of_keys_is_no_key(errors_of, entry, error):
    line = next(each for each in errors_of(f"fleet: x\n{entry}\n") if error in each)
    assert line.startswith(f"fleet.yml:2: {error}; ")


def test_a_profiles_key_at_the_top_names_its_place(errors_of):
    errors = errors_of("fleet: x\nvalues: [{key: Level}]\n")
    assert errors == ["fleet.yml:2: values: is a key of profiles; write it in profiles.default"]


def test_key_without_a_value_is_as_if_it_were_not_given(fleet_of):
    text = """
        fleet: x
        robots: [{name: r, namespace: %s, domain_id: %s, labels: %s, profile: %s}]
        profiles: {default: {stale_after: %s, checks: %s, components: %s}}
        faults: {flapping: %s, many: %s}
        limits: %s
    """
    fleet = fleet_of(text.replace("%s", "null"))
    assert fleet == fleet_of("fleet: x\nrobots: [{name: r}]")
    assert fleet.profiles["default"] == Profile(checks=(Check("all"),))


def test_condition_is_checked_wherever_it_stands(errors_of):
    """`when` and `unless`, of components and of values, refer to one description of it."""
    wrong = "{component: Dock}"
    found = errors_of(f"""
        fleet: x
        profiles:
          default:
            components:
              - {{match: a, when: {wrong}, unless: {wrong}}}
            values:
              - {{key: a, thresholds: {{}}, when: {wrong}, unless: [{wrong}]}}
    """)
    assert [line.partition(": ")[2].partition(":")[0] for line in found] == [
        "profiles.default.components[0].unless[0]",
        "profiles.default.components[0].when[0]",
        "profiles.default.values[0].unless[0]",
        "profiles.default.values[0].when[0]",
    ]
    assert all("has neither level nor key; give one" in line for line in found)


def test_threshold_is_checked_wherever_it_stands(errors_of):
    found = errors_of("""
        fleet: x
        profiles:
          default:
            values:
              - thresholds: {low: {warning: 1, colour: red}, high: {critical: 2, colour: red}}
    """)
    assert len(found) == 2
    assert all(line.endswith("is not a key; use one of warning, critical") for line in found)


def test_an_entry_whose_types_are_texts_is_not_made():
    """An unknown key inside of such a type would have no suggestion."""
    with pytest.raises(TypeError, match=r"Typo\.name has a type as text"):
        type("Typo", (Entry,), {"__annotations__": {"name": "str"}})
