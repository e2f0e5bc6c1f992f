"""The settings of the thesis' robot: exact numbers of faults, reproducible, read again."""

import itertools
from collections import Counter
from pathlib import Path

import pytest

from support.simulated_fleet import fleet_of, of
from virtual_robots.model import ERROR, OK, WARN
from virtual_robots.schema.documents import DocumentError
from virtual_robots.schema.thesis import load_settings
from virtual_robots.simulation.components import Fault
from virtual_robots.simulation.outputs import Message, Topic


def settings(folder: Path, **values: float) -> Path:
    path = folder / "robot.yaml"
    path.write_text("".join(f"{key}: {value}\n" for key, value in values.items()) or "{}\n")
    return path


def levels(message: Message) -> Counter[int]:
    return Counter(s.level for s in message.statuses if "Battery" not in s.name)


@pytest.mark.parametrize(("errors", "warnings"), [(0, 0), (1, 0), (2, 3), (8, 0), (3, 5)])
def test_after_each_refresh_exactly_the_asked_numbers_are_faulty(tmp_path, errors, warnings):
    path = settings(tmp_path, total_errors=errors, total_warnings=warnings, refresh_interval=5)
    raw = of(fleet_of(settings=path).advance(100.0), Topic.RAW)[1:]
    expected = {OK: 8 - errors - warnings, WARN: warnings, ERROR: errors}
    assert all(levels(m) == Counter(expected) for m in raw)


def test_each_refresh_draws_anew_and_holds_in_between(tmp_path: Path) -> None:
    path = settings(tmp_path, total_errors=2, refresh_interval=10)
    raw = of(fleet_of(settings=path).advance(200.0), Topic.RAW)[1:]
    faulty = [tuple(s.name for s in m.statuses if s.level == ERROR) for m in raw]
    changes = sum(a != b for a, b in itertools.pairwise(faulty))
    assert 10 <= changes <= 19


def test_the_draw_depends_on_the_seed_alone(tmp_path: Path) -> None:
    path = settings(tmp_path, total_errors=2, refresh_interval=10)
    outputs = [list(fleet_of(seed=s, settings=path).advance(60.0)) for s in (1, 1, 2)]
    assert outputs[0] == outputs[1]
    assert outputs[0] != outputs[2]


def test_the_numbers_of_components_are_the_settings(tmp_path: Path) -> None:
    path = settings(
        tmp_path, number_of_motors=5, number_of_sensors=0, number_of_lasers=1, number_of_cameras=2
    )
    last = of(fleet_of(settings=path).advance(3.0), Topic.RAW)[-1]
    assert Counter(s.name.split()[0] for s in last.statuses) == {
        "Motor": 5, "Laser": 1, "Cam": 2, "Robot": 1, "Laptop": 1,
    }  # fmt: skip


@pytest.mark.parametrize(("charge", "level"), [(80, OK), (25, WARN), (10, ERROR)])
def test_the_battery_is_judged_by_the_settings_levels(tmp_path, charge, level):
    path = settings(
        tmp_path, initial_battery_level=charge, warn_battery_level=40, error_battery_level=20
    )
    last = of(fleet_of(settings=path).advance(3.0), Topic.RAW)[-1]
    assert {s.level for s in last.statuses if "Battery" in s.name} == {level}


def test_a_changed_file_is_read_again_and_the_rest_goes_on(tmp_path: Path) -> None:
    path = settings(tmp_path, total_errors=0)
    fleet = fleet_of(settings=path)
    before = of(fleet.advance(3.0), Topic.RAW)[-1]
    fleet.inject("robot_1", "Laser 1", Fault("warn", fleet.now, "mine"))
    settings(tmp_path, total_errors=2, number_of_motors=4, number_of_lasers=1)
    fleet.reload(path)
    after = of(fleet.advance(6.0), Topic.RAW)[-1]
    assert levels(before)[ERROR] == 0
    assert levels(after)[ERROR] == 2
    assert sum("Motor" in s.name for s in after.statuses) == 4
    level = {s.name: dict(s.values).get("Level") for s in (*before.statuses, *after.statuses)}
    assert float(level["Robot Battery"] or 0) == pytest.approx(90, abs=0.5)


@pytest.mark.parametrize(
    ("values", "what"),
    [
        (
            {"total_errors": 9},
            "total_errors + total_warnings is 9, but there are only 8 components",
        ),
        ({"total_errors": -1}, "total_errors: Input should be greater than or equal to 0 (is -1)"),
        ({"refresh_interval": 0}, "refresh_interval: Input should be greater than 0 (is 0)"),
        ({"motors": 3}, "motors: is no key that is known here"),
        ({"error_battery_level": 60}, "error_battery_level must not be above warn_battery_level"),
    ],
)
def test_wrong_settings_name_file_key_and_remedy(tmp_path, values, what):
    path = settings(tmp_path, **values)
    with pytest.raises(DocumentError) as caught:
        load_settings(path)
    assert str(caught.value).startswith(f"{path}: {what}")


def test_settings_for_another_kind_are_rejected(tmp_path: Path) -> None:
    with pytest.raises(DocumentError, match="settings are for the kind thesis"):
        fleet_of("kobuki", settings=settings(tmp_path))
