"""Single values: durations as Prometheus writes them, names, hosts, numbers of YAML 1.2."""

import pytest

from ros_diagnostics_exporter.config.errors import ConfigError
from ros_diagnostics_exporter.config.queries import MAX_EXPRESSION, expression
from ros_diagnostics_exporter.config.scalars import address, duration, name
from ros_diagnostics_exporter.config.yaml_file import read


@pytest.mark.parametrize(
    ("given", "seconds"),
    [
        (5, 5.0),
        (0.5, 0.5),
        (0, 0.0),
        ("5s", 5.0),
        ("1m30s", 90.0),
        ("24h", 86_400.0),
        ("250ms", 0.25),
        ("1w2d3h4m5s6ms", 788_645.006),
        ("90s", 90.0),
        ("1.5s", 1.5),
    ],
)
def test_duration_is_seconds(given, seconds):
    assert duration(given) == seconds


@pytest.mark.parametrize("given", ["", "5", "5 s", "-5s", True, None])
def test_other_text_is_no_duration(given):
    with pytest.raises(ValueError, match=r"is not a duration; write seconds or .* 5s, 1m30s, 24h"):
        duration(given)


@pytest.mark.parametrize("given", ["x", "x" * MAX_EXPRESSION])
def test_expression_has_one_to_as_many_characters_as_the_schema_says(given):
    assert expression(given) == given
    with pytest.raises(ValueError, match="is empty or longer than 4096 characters"):
        expression(given * MAX_EXPRESSION + given)


@pytest.mark.parametrize("given", ["10.0.0.1", "robot-1.lan", "r", "fe80::1", "::1", "my_host"])
def test_host_is_a_name_or_an_address(given):
    assert address(given) == given


@pytest.mark.parametrize("given", ["", "a b", "http://a", "-a", "a/b", "a" * 254, "[::1]", 7])
def test_other_text_is_no_host(given):
    with pytest.raises(ValueError, match=r"is not (a host|text)"):
        address(given)


@pytest.mark.parametrize("given", ["r", "Roboter Nr. 1", "ロボット", "a" * 128])
def test_name_may_be_what_people_call_it(given):
    assert name(given) == given


@pytest.mark.parametrize("given", ["", " a", "a ", "a/b", "a\nb", "a" * 129, "a\ud800", "a\x85b"])
def test_name_that_cannot_be_a_label_is_rejected(given):
    with pytest.raises(ValueError, match=r"cannot be a name|unpaired surrogate"):
        name(given)


@pytest.mark.parametrize(
    ("given", "means"),
    [
        *(("on", "on"), ("no", "no"), ("1:30", "1:30"), ("2026-03-01", "2026-03-01")),
        *(("012", 12), ("0o17", 15), ("0x1F", 31), ("-7", -7), ("1_000", "1_000"), ("+3", 3)),
        *(("1e3", 1000.0), (".5", 0.5), ("-.inf", float("-inf")), ("1.", 1.0), ("9" * 30, 1e30)),
        *(("true", True), ("FALSE", False), ("~", None), ("null", None), ("", None)),
        *(("None", "None"), ("'5'", "5"), ("!!str 5", "5"), ("!!float 5", 5.0)),
    ],
)
def test_scalars_are_read_as_by_yaml_1_2(tmp_path, given, means):
    path = tmp_path / "a.yml"
    path.write_text(f"a: {given}")
    document, problems = read(path)
    assert (document.data, problems) == ({"a": means}, [])
    assert type(document.data["a"]) is type(means)


def test_merged_keys_stand_behind_own_ones(tmp_path):
    path = tmp_path / "a.yml"
    path.write_text("a: &a {x: 1, y: 1}\nb: &b {y: 2, z: 2}\nc: {<<: [*a, *b], x: 3}")
    document, problems = read(path)
    assert (document.data["c"], problems) == ({"x": 3, "y": 1, "z": 2}, [])


def test_byte_order_mark_is_no_content(fleet_of):
    assert fleet_of("\ufefffleet: demo").name == "demo"


def test_error_is_one_printable_line_for_each_problem(fleet_of):
    with pytest.raises(ConfigError) as caught:
        fleet_of('fleet: demo\n"a\\nb\\x1b[31m": 1\nprofiles: {default: {stale_after: "\\u202e"}}')
    lines = str(caught.value).splitlines()
    assert len(lines) == 2
    assert all(line.isprintable() for line in lines)
