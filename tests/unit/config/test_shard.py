"""Several exporters share one fleet.yml: which robots are whose, and what each has of the file."""

from collections import Counter

import pytest

from ros_diagnostics_exporter.config.errors import ConfigError
from ros_diagnostics_exporter.config.load import load
from ros_diagnostics_exporter.config.shard import Shard, parse
from ros_diagnostics_exporter.model import Topic
from support.configs import load_text

NAMES = [f"robot_{number}" for number in range(10_000)]
HALL = """
fleet: hall
robots:
  - {name: ap, source: queries}
  - {name: r1, namespace: /r1, labels: {uplink: ap}}
  - {name: r2, namespace: /r2, domain_id: 7}
  - {name: r3, namespace: /r3}
  - {name: r4, namespace: /r4, domain_id: 8}
"""
CAPABLE = """
fleet: hall
capabilities: {lifting: {at_least: {k: 1, of: {can: lift}}}}
profiles: {default: {capabilities: {lift: Lift}}}
"""


def owners(count: int) -> dict[str, int]:
    shards = [Shard(number, count) for number in range(1, count + 1)]
    found = {name: [each.number for each in shards if each.has(name)] for name in NAMES}
    assert all(len(numbers) == 1 for numbers in found.values())
    return {name: number for name, [number] in found.items()}


def test_a_shard_is_written_as_number_and_count():
    assert [parse(each) for each in ("1/1", "2/4", "999/999")] == [
        Shard(1, 1),
        Shard(2, 4),
        Shard(999, 999),
    ]
    assert str(parse("2/4")) == "2/4"


@pytest.mark.parametrize("text", ["5/4", "0/4", "x", "", "2", "2/", "1/0", "-1/4", "1/1000", "٢/4"])
def test_what_is_no_shard_is_named(text):
    with pytest.raises(ValueError, match="is not a shard such as 2/4") as raised:
        parse(text)
    assert repr(text) in str(raised.value)


def test_each_robot_is_of_one_shard_and_the_shards_are_about_as_large():
    for count in (1, 2, 3, 4, 8):
        sizes = Counter(owners(count).values())
        assert len(sizes) == count
        assert max(sizes.values()) < 1.1 * len(NAMES) / count


def test_a_robot_is_of_the_same_shard_on_every_machine_and_in_every_version():
    assert [owners(4)[f"robot_{number}"] for number in range(12)] == [
        *(1, 3, 2, 2, 2, 4),
        *(4, 1, 1, 1, 1, 4),
    ]


@pytest.mark.parametrize("count", [1, 2, 3, 7])
def test_with_one_shard_more_robots_move_to_that_one_only(count):
    before, after = owners(count), owners(count + 1)
    moved = [name for name in NAMES if before[name] != after[name]]
    assert {after[name] for name in moved} == {count + 1}
    assert len(moved) == pytest.approx(len(NAMES) / (count + 1), rel=0.1)


def test_each_exporter_has_its_robots_and_all_uplinks_and_only_their_domains(tmp_path):
    whole = load_text(tmp_path, HALL)
    parts = [load(tmp_path / "fleet.yml", Shard(number, 2)) for number in (1, 2)]
    names = [[each.name for each in part.robots] for part in parts]
    assert [sorted({*each} - {"ap"}) for each in names] == [["r1", "r3"], ["r2", "r4"]]
    assert all("ap" in each for each in names)
    assert [part.domain_ids for part in parts] == [(0,), (7, 8)]
    assert (whole.domain_ids, whole.has("anybody")) == ((0, 7, 8), True)


def test_an_exporter_knows_the_topics_of_robots_that_are_elsewhere_by_their_names(tmp_path):
    load_text(tmp_path, HALL)
    part = load(tmp_path / "fleet.yml", Shard(1, 2))
    assert part.shard.elsewhere >= {Topic(7, "/r2/diagnostics"), Topic(7, "/r2/diagnostics_agg")}
    assert not any("/r3/" in each.name for each in part.shard.elsewhere)


def test_the_limit_of_robots_is_that_of_one_exporter(tmp_path):
    path = tmp_path / "fleet.yml"
    path.write_text(f"{HALL}\nlimits: {{robots: 3}}")
    assert len(load(path, Shard(1, 2)).robots) == 3
    with pytest.raises(ConfigError, match="5 robots are declared, above the limit of 3"):
        load(path)


@pytest.mark.parametrize(
    ("given", "own", "together"), [("", "shard-2", "shard"), ("berlin", "berlin-2", "berlin")]
)
def test_an_exporter_is_named_by_its_number_whatever_the_count_is(tmp_path, given, own, together):
    load_text(tmp_path, f"{HALL}\nexporter: {given!r}")
    for count in (2, 3):
        part = load(tmp_path / "fleet.yml", Shard(2, count))
        assert (part.exporter, part.together) == (own, together)
    assert load(tmp_path / "fleet.yml").together == given


def test_a_silent_robot_is_confirmed_after_the_others_have_told_what_they_count(tmp_path):
    path = tmp_path / "fleet.yml"
    load_text(tmp_path, f"{HALL}\nprofiles: {{default: {{confirm_after: 2s}}}}")
    with pytest.raises(
        ConfigError, match=r"confirm_after.* is 2s, .*--shard.*make it 8s"
    ) as raised:
        load(path, Shard(1, 2))
    assert f"{path}:{len(path.read_text().splitlines())}" in str(raised.value)
    quick = "components: [{match: Motor, confirm_after: 0s}]"
    load_text(tmp_path, f"{HALL}\nprofiles: {{default: {{confirm_after: 8s, {quick}}}}}")
    assert load(path, Shard(1, 2)).shard.number == 1


def test_capabilities_of_a_fleet_need_all_its_robots(tmp_path):
    load_text(tmp_path, CAPABLE)
    with pytest.raises(ConfigError, match=r"capabilities.*--shard.*run one exporter") as raised:
        load(tmp_path / "fleet.yml", Shard(1, 2))
    assert "fleet.yml:3" in str(raised.value)
