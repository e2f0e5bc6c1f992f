"""Components in no capability, and capabilities that nothing feeds."""

import pytest

from ros_diagnostics_exporter.config.load import load
from ros_diagnostics_exporter.fleet.unmatched import KnownRobot
from ros_diagnostics_tools.capability_notes import capability_notes

NAMES = ("Motor 1", "Laser 1", "Speaker 1")


def robot(*names: str) -> KnownRobot:
    return KnownRobot("r", {}, 0, "", "default", tuple(("", name, ()) for name in names))


@pytest.mark.parametrize(
    ("capabilities", "expected"),
    [
        ("{drive: Motor, view: [Laser], talk: {any: Speaker}}", []),
        ("{drive: Motor}", ["2 components in no capability: Laser 1, Speaker 1"]),
        ("{drive: [{check: motors}], tour: [{capability: drive}, {any: [Laser, Speaker]}]}", []),
        (
            "{drive: [Motor, Laser, Speaker], fly: Wing, soar: [{capability: fly}]}",
            [f"nothing that was received feeds capability {name}" for name in ("fly", "soar")],
        ),
    ],
)
def test_what_may_be_forgotten_is_noted(tmp_path, capabilities, expected):
    (tmp_path / "fleet.yml").write_text(
        f"fleet: f\nprofiles: {{default: {{checks: {{motors: {{match: Motor, expect: 1}}}}, "
        f"capabilities: {capabilities}}}}}\nrobots: [{{name: r, topic: /d, source: raw}}]\n"
    )
    found = capability_notes(load(tmp_path / "fleet.yml"), [robot(*NAMES)])
    assert found == [f"profile default: {each}" for each in expected]


def test_without_capabilities_or_components_there_is_nothing_to_note(tmp_path):
    for of_profile, names in (("{}", NAMES), ("{capabilities: {fly: Wing}}", ())):
        (tmp_path / "fleet.yml").write_text(
            f"fleet: f\nprofiles: {{default: {of_profile}}}\n"
            "robots: [{name: r, topic: /d, source: raw}]\n"
        )
        assert capability_notes(load(tmp_path / "fleet.yml"), [robot(*names)]) == []


def test_of_many_the_first_are_named(tmp_path):
    (tmp_path / "fleet.yml").write_text(
        "fleet: f\nprofiles: {default: {capabilities: {fly: Wing}}}\n"
        "robots: [{name: r, topic: /d, source: raw}]\n"
    )
    names = [f"Part {number}" for number in range(12)]
    (note,) = capability_notes(load(tmp_path / "fleet.yml"), [robot("Wing", *names)])
    assert note.startswith("profile default: 12 components in no capability: Part 0, Part 1, ")
    assert note.endswith(" and 2 more")
