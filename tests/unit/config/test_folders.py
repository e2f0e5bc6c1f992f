"""robots.d and maintenance.d: robots and downtimes as files of their own."""

from ros_diagnostics_exporter.config import yaml_file
from ros_diagnostics_exporter.config.load import load
from ros_diagnostics_exporter.robots.maintenance import lasting

A = "fleet: demo\nrobots: [{name: a, domain_id: 1}]\n"


def test_files_of_a_folder_hold_one_robot_or_several(fleet_of):
    fleet = fleet_of(
        A,
        **{
            "robots.d/b.yml": "{name: b, domain_id: 2, profile: default}",
            "robots.d/c.yaml": "[{name: c, domain_id: 3}, {name: d, domain_id: 4}]",
        },
    )
    assert [robot.name for robot in fleet.robots] == ["a", "b", "c", "d"]


def test_other_and_hidden_files_are_ignored(fleet_of):
    others = ("robots.d/.b.yml", "robots.d/b.yml~", "robots.d/README.md", "robots.d/b.yml.swp")
    fleet = fleet_of(A, **dict.fromkeys(others, "{name: b"))
    assert [robot.name for robot in fleet.robots] == ["a"]


def test_robot_that_leaves_the_folder_is_gone_at_the_next_load(fleet_of, tmp_path):
    before = fleet_of(A, **{"robots.d/b.yml": "{name: b, domain_id: 2}"})
    assert before.sources == (
        tmp_path / "fleet.yml",
        tmp_path / "robots.d",
        tmp_path / "robots.d/b.yml",
        tmp_path / "maintenance.d",
        tmp_path / "queries.d",
    )
    (tmp_path / "robots.d/b.yml").unlink()
    after = load(tmp_path / "fleet.yml")
    assert [robot.name for robot in after.robots] == ["a"]
    assert tmp_path / "robots.d/b.yml" not in after.sources


def test_robot_that_leaves_while_the_folder_is_read_is_gone(fleet_of, monkeypatch, tmp_path):
    def read_late(path):
        if path.name == "b.yml":
            path.unlink()
        return yaml_file.read(path)

    monkeypatch.setattr("ros_diagnostics_exporter.config.load.read", read_late)
    files = {f"robots.d/{name}.yml": f"{{name: {name}, domain_id: 2}}" for name in "bc"}
    fleet = fleet_of(A, **files)
    assert [robot.name for robot in fleet.robots] == ["a", "c"]
    assert tmp_path / "robots.d/b.yml" not in fleet.sources


def test_broken_link_is_an_error(errors_of, tmp_path):
    (tmp_path / "robots.d").mkdir()
    (tmp_path / "robots.d/b.yml").symlink_to("nowhere")
    assert errors_of(A) == [
        (
            "robots.d/b.yml: cannot be read (No such file or directory); "
            "name a file that exists and that this user may read"
        )
    ]


def test_another_folder_may_be_named(fleet_of):
    fleet = fleet_of(A + "robots_folder: more", **{"more/b.yml": "{name: b, domain_id: 2}"})
    assert [robot.name for robot in fleet.robots] == ["a", "b"]


def test_downtimes_of_the_folder_are_active(fleet_of):
    fleet = fleet_of(
        A,
        **{
            "maintenance.d/a.yml": """
                name: repair of a
                selector: {robot: a}
                comment: new gripper
                start: 2026-01-01T00:00Z
            """
        },
    )
    assert lasting(fleet, {"robot": "a"}, 1_800_000_000)
    assert not lasting(fleet, {"robot": "b"}, 1_800_000_000)


def test_errors_name_the_file_of_the_folder(errors_of):
    assert errors_of(
        A,
        **{
            "robots.d/b.yml": "name: b\ndomain_id: 2\nprofile: none",
            "robots.d/c.yml": "- name: a\n  domain_id: 3\n- {name: d, domain_id: 1}\n- {nam: e}",
            "robots.d/d.yml": "[",
            "robots.d/e.yml": "",
            "maintenance.d/a.yml": "name: x",
        },
    ) == [
        "maintenance.d/a.yml:1: comment: is missing; add comment: ...",
        "maintenance.d/a.yml:1: selector: is missing; add selector: ...",
        'robots.d/b.yml:3: profile: there is no profile "none"; use default',
        (
            'robots.d/c.yml:1: [a].name: the name "a" is already used by the robot in fleet.yml:2; '
            "give each robot a name of its own"
        ),
        (
            "robots.d/c.yml:3: [d]: topic /diagnostics_agg of domain 1 is that of robot "
            '"a" in fleet.yml:2; give it a namespace or domain_id of its own, '
            "or list the topic in shared and name it as topic"
        ),
        "robots.d/c.yml:4: [2].nam: is not a key; did you mean name?",
        "robots.d/c.yml:4: [2].name: is missing; add name: ...",
        (
            "robots.d/d.yml:1: is not valid YAML (expected the node content, "
            "but found '<stream end>'); indent with spaces, and put text with special characters "
            "in quotes"
        ),
        "robots.d/e.yml:1: nothing is not a mapping; write it as key: value",
    ]


def test_folder_that_is_a_file_is_an_error(errors_of):
    assert errors_of(A, **{"robots.d": "x"}) == [
        "robots.d: cannot be read (Not a directory); let this user read the folder"
    ]
