"""Files of a diagnostic graph become a profile and a report in which no unit is missing."""

import json
from pathlib import Path

import pytest
import yaml

from ros_diagnostics_exporter.config.load import load
from ros_diagnostics_tools.autoware.convert import convert
from ros_diagnostics_tools.autoware.graph import GraphError, read
from ros_diagnostics_tools.autoware.names import names_of
from support.configs import load_text

IMPORT = ("import", "autoware")
CART = {
    "main.yaml": """
files:
  - { path: $(dirname)/drive.yaml }
  - { path: $(find-pkg-share cart_arm)/config/arm.yaml }
edits:
  - { type: remove, path: /cart/drive/brake }
  - { type: remove, regex: "/cart/arm/c.*" }
units:
  - path: /cart/modes/tour
    type: and
    list:
      - { type: link, link: /cart/drive }
      - { type: link, link: /cart/arm }
      - { type: ok }
  - { path: /cart/modes/park, type: ok }
""",
    "drive.yaml": """
units:
  - path: /cart/drive
    type: and
    latch: 2.0
    list:
      - { type: link, link: /cart/drive/motor }
      - { type: link, link: /cart/drive/brake }
      - type: warn-to-ok
        item: { type: diag, node: laser, name: "scan (front)", timeout: 0.5, hysteresis: 0.2 }
  - { path: /cart/drive/motor, type: diag, node: base, name: motor, timeout: 3 }
  - { path: /cart/drive/brake, type: diag, node: base, name: brake }
""",
    "cart_arm/config/arm.yaml": """
units:
  - path: /cart/arm
    type: or
    dependent: /cart/drive
    list:
      - { path: /cart/arm/left, type: diag, node: "", name: left arm }
      - { path: /cart/arm/right, type: diag, node: arm, name: right }
      - { path: /cart/arm/camera, type: diag, node: arm, name: camera }
""",
}
PROFILE = {
    "stale_is_critical": True,
    "capabilities": {
        "tour": [{"capability": "drive"}, {"capability": "arm"}],
        "drive": [
            {"regex": "^base: motor$"},
            {"degraded_is_ok": [{"regex": r"^laser: scan \(front\)$"}]},
        ],
        "arm": {"any": [{"regex": "^left arm$"}, {"regex": "^arm: right$"}]},
    },
    "components": [
        {"match": {"regex": "^base: motor$"}, "stale_after": "3s"},
        {"match": {"regex": r"^laser: scan \(front\)$"}, "stale_after": "500ms"},
    ],
}
LATCH = "without latch: a fault ends when its parts are received better; nothing has to be reset"
HYSTERESIS = "a problem is a fault after confirm_after of its component or profile"
DEPENDENT = (
    "without dependent: it marks a unit for displays and changes no level; here parts that failed "
    "are suppressed under one capability"
)


@pytest.fixture
def cart(tmp_path) -> Path:
    for name, text in CART.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    return tmp_path


def graph(folder: Path, text: str):
    (folder / "graph.yaml").write_text(text)
    return read([folder / "graph.yaml"], {})


def outcomes(folder: Path, text: str) -> dict[str, str]:
    """What became of each unit, by what is behind its line number."""
    made = convert(graph(folder, text), "f", "p")
    load_text(folder, made.text)
    return {each.where.split(": ", 1)[1]: each.text for each in made.rows}


@pytest.fixture
def imported(cart, run):
    """A function: what the import prints; 1, as latch, dependent and hysteresis stay behind."""
    command = (*IMPORT, str(cart / "main.yaml"), "--package", f"cart_arm={cart}/cart_arm")
    return lambda *more: run(*command, *more, code=1)


def test_a_graph_of_several_files_becomes_a_profile(cart, imported, run):
    printed = imported().out
    assert yaml.safe_load(printed) == {"fleet": "autoware", "profiles": {"autoware": PROFILE}}
    (cart / "fleet.yml").write_text(printed)
    run("check-config", str(cart / "fleet.yml"))


def test_the_report_has_a_line_for_each_unit_and_each_edit(cart, imported):
    assert imported().err.replace(f"{cart}/", "").splitlines() == [
        '  main.yaml:9: /cart/modes/tour (and): capability "tour"',
        "  main.yaml:12: -> /cart/drive (link): followed",
        "  main.yaml:13: -> /cart/arm (link): followed",
        "  main.yaml:14: (no path) (ok): always OK: no capability, and left out of others",
        "  main.yaml:15: /cart/modes/park (ok): always OK: no capability, and left out of others",
        f'! drive.yaml:3: /cart/drive (and): capability "drive"; {LATCH}',
        "  drive.yaml:7: -> /cart/drive/motor (link): followed",
        "  drive.yaml:8: -> /cart/drive/brake (link): its unit is removed",
        "  drive.yaml:9: (no path) (warn-to-ok): inside of another",
        f"! drive.yaml:10: (no path) (diag): component of drive; without hysteresis: {HYSTERESIS}",
        "  drive.yaml:11: /cart/drive/motor (diag): component of drive",
        "  drive.yaml:12: /cart/drive/brake (diag): removed by main.yaml:6",
        f'! cart_arm/config/arm.yaml:3: /cart/arm (or): capability "arm"; {DEPENDENT}',
        "  cart_arm/config/arm.yaml:7: /cart/arm/left (diag): component of arm",
        "  cart_arm/config/arm.yaml:8: /cart/arm/right (diag): component of arm",
        "  cart_arm/config/arm.yaml:9: /cart/arm/camera (diag): removed by main.yaml:7",
        "  main.yaml:6: /cart/drive/brake (edit): removes 1 unit",
        "  main.yaml:7: /cart/arm/c.* (edit): removes 1 unit",
        "18 units and edits: 3 capabilities; 3 not imported, or not with all that they say (!)",
    ]


def test_the_file_is_written_once_and_overwritten_by_force_only(cart, imported):
    target = cart / "fleet.yml"
    written = ("--output-file", str(target))
    assert not imported(*written, "--fleet", "carts", "--profile", "cart").out
    assert load(target).profiles["cart"].capabilities.keys() == PROFILE["capabilities"].keys()
    assert "exists; choose another" in imported(*written).err
    imported(*written, "--force")
    assert load(target).name == "autoware"


def test_programs_are_given_both_as_json(imported):
    found = json.loads(imported("--output", "json", "--unit", "/cart/arm").out)
    assert [*found["fleet"]["profiles"]["autoware"]["capabilities"]] == ["arm"]
    texts = [each["text"] for each in found["report"] if each["is_whole"]]
    assert "not asked for" in texts
    assert len(found["report"]) == 18


def test_all_that_is_asked_for_being_imported_is_0(cart, run):
    run(*IMPORT, str(cart / "cart_arm/config/arm.yaml"), code=1)
    (cart / "one.yaml").write_text("units: [{path: /a, type: diag, node: n, name: x}]")
    run(*IMPORT, str(cart / "one.yaml"))


def test_packages_of_sourced_workspaces_are_found(cart, monkeypatch, run):
    share = cart / "install/share"
    share.mkdir(parents=True)
    (cart / "cart_arm").rename(share / "cart_arm")
    arguments = (*IMPORT, str(cart / "main.yaml"))
    assert "where is the package cart_arm? Source its workspace" in run(*arguments, code=2).err
    (cart / "underlay/share/cart_arm").mkdir(parents=True)  # empty: the overlay's is read
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{cart / 'install'}:{cart / 'underlay'}")
    run(*arguments, code=1)


DIAG = "{type: diag, node: n, name: x}"
MOTOR = "  - {path: /motor, type: diag, node: n, name: motor}\n"


@pytest.mark.parametrize(
    ("units", "path", "expected"),
    [
        ("  - {path: /a}", "/a", "not imported: it has no type, and Autoware does not load it"),
        ("  - {path: /a, type: nor}", "/a",
         'not imported: "nor" is no type of Autoware\'s, and Autoware does not load it'),
        ("  - {path: /a, type: diag, node: n}", "/a",
         "not imported: it has no name, and Autoware does not load it"),
        ("  - {path: /a, type: and, list: x}", "/a",
         "not imported: list is not a list, and Autoware does not load it"),
        ("  - {path: /a, type: warn-to-ok, item: []}", "/a",
         "not imported: item is not a unit, and Autoware does not load it"),
        ("  - 7", "(no path)", "not imported: 7 is no unit, and Autoware does not load it"),
        (f"  - {DIAG}", "(no path)", "not imported: it has no path, and nothing rests on it"),
        ("  - {path: /a, type: link, link: /b}", "/a", "not imported: no file has this path"),
        (f"{MOTOR}  - {{path: /a, type: link, link: /motor}}", "/a", "followed"),
        ("  - {path: /a, type: or}", "/a", "always OK: no capability, and left out of others"),
        ("  - {path: /a, type: and, list: [{type: stale}, {type: warn}]}", "/a",
         "always ERROR: no capability, and left out of others"),
        (f"  - {{path: /a, type: or, list: [{{type: ok}}, {DIAG}]}}", "(no path)",
         "left out: what rests on it always has the same level"),
        (f"  - {{path: /a, type: or, list: [{{type: warn}}, {DIAG}]}}", "/a",
         'capability "a"; without a unit inside of it, which is always WARN'),
        (f"  - {{path: /a, type: and, list: [{{type: link, link: /b}}, {DIAG}]}}", "/a",
         'capability "a"; without /b, which is in none of the files'),
        ("  - {path: /a, type: and, list: [{type: link, link: /b}]}", "/a",
         "not imported: without /b, which is in none of the files"),
        (f"  - {{path: /a, type: and, list: [{{path: /b, type: and, list: [7, {DIAG}]}}]}}", "/a",
         'capability "a"; /b is imported in part'),
        (f"  - {{path: /a, type: and, list: [{DIAG}], latch: 1, colour: red}}", "/a",
         f'capability "a"; {LATCH}; without colour: it is no key of Autoware'),
        ("  - {path: /a, type: diag, node: n, name: x, timeout: soon}", "/a",
         'capability "a"; without timeout: "soon" is no time'),
    ],
)  # fmt: skip
def test_what_has_no_equivalent_is_said_with_the_reason(tmp_path, units, path, expected):
    assert outcomes(tmp_path, f"units:\n{units}\n")[path] == expected


def test_an_edit_that_removes_nothing_is_said(tmp_path):
    text = f"units:\n{MOTOR}edits: [{{type: remove, path: /x}}, {{type: add, path: /y}}]\n"
    found = outcomes(tmp_path, text)
    reason = "not imported: it is no edit of type remove, or removes nothing"
    assert (found["/x"], found["/y"]) == (reason, reason)


def test_an_edit_that_removes_nothing_is_not_imported_whole(tmp_path):
    made = convert(graph(tmp_path, f"units:\n{MOTOR}edits: [{{type: remove, path: /x}}]"), "f", "p")
    assert [each.is_whole for each in made.rows] == [True, False]


def test_an_expression_of_an_edit_matches_whole_paths(tmp_path):
    other = "  - {path: /motor_2, type: diag, node: n, name: motor 2}\n"
    found = graph(tmp_path, f"units:\n{MOTOR}{other}edits: [{{type: remove, regex: /motor}}]")
    assert [each.path for each in found.units if each.removed] == ["/motor"]


def test_a_path_in_two_files_is_an_error_that_names_both(tmp_path):
    paths = [tmp_path / "a.yaml", tmp_path / "b.yaml"]
    for each in paths:
        each.write_text(f"units:\n{MOTOR}")
    with pytest.raises(GraphError, match=r"b\.yaml:2: /motor: is in .*a\.yaml:2, too"):
        read(paths, {})


@pytest.mark.parametrize("written", [".inf", "true", "0", "-1"])
def test_what_is_no_time_is_no_timeout(tmp_path, written):
    unit = f"{{path: /a, type: diag, node: n, name: x, timeout: {written}}}"
    made = convert(graph(tmp_path, f"units: [{unit}]"), "f", "p")
    assert "components" not in made.content["profiles"]["p"]
    assert made.rows[0].text.endswith("is no time")


def test_a_component_whose_units_have_different_timeouts_has_the_first(tmp_path):
    one = "{path: /a, type: diag, node: n, name: x, timeout: 1}"
    other = "{path: /b, type: diag, node: n, name: x, timeout: 2}"
    found = outcomes(tmp_path, f"units: [{one}, {other}]")
    assert found["/a"] == 'capability "a"'
    assert found["/b"].endswith("another unit gives this component a different one")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "is no diagnostic graph: it has none of files, edits, units"),
        ("a: 1", "is no diagnostic graph: it has none of files, edits, units"),
        ("units: []\nunit: []", ":2: unit is none of files, edits, units"),
        ("units: 1", ":1: units is no list; start each entry with a dash"),
        ("files: [x]", ':1: "x" names no file; write {path: ...}'),
        ("files:\n  - {path: x.yaml}", "x.yaml: cannot be read"),
        ("files:\n  - {path: $(env HOME)/x}",
         ":2: $(env HOME) is no substitution; use $(dirname) or $(find-pkg-share NAME)"),
        (f"units:\n{MOTOR}{MOTOR}", ":2, too; import one of the files, or rename one"),
        ("units:\n  - path: /a\n    type: and\n    list: [{type: link, link: /a}]",
         "needs itself: /a -> link; remove a link"),
        ("units: []\nedits: [{type: remove, regex: '('}]", "is no regular expression of RE2"),
        ("units: [", "is not valid YAML"),
    ],
)  # fmt: skip
def test_what_is_no_graph_is_one_error_with_the_way_out(tmp_path, text, expected):
    with pytest.raises(GraphError) as found:
        graph(tmp_path, text)
    assert expected in str(found.value)


def test_files_that_include_one_another_are_read_once(tmp_path):
    (tmp_path / "a.yaml").write_text("files: [{path: $(dirname)/b.yaml}]")
    (tmp_path / "b.yaml").write_text(f"files: [{{path: $(dirname)/a.yaml}}]\nunits:\n{MOTOR}")
    found = read([tmp_path / "a.yaml", tmp_path / "b.yaml"], {})
    assert [each.path for each in found.units] == ["/motor"]


def test_more_units_than_a_profile_may_have_are_imported_in_parts(tmp_path):
    units = "".join(f"  - {{path: /u{n}, type: diag, node: n, name: x{n}}}\n" for n in range(101))
    found = graph(tmp_path, f"units:\n{units}")
    with pytest.raises(GraphError, match="101 units with a path are more than the 100"):
        convert(found, "f", "p")
    found.units.pop()
    assert len(convert(found, "f", "p").content["profiles"]["p"]["capabilities"]) == 100
    made = convert(found, "f", "p", ["/u7"])
    assert [*made.content["profiles"]["p"]["capabilities"]] == ["u7"]
    with pytest.raises(GraphError, match="--unit /x: no unit has this path"):
        convert(found, "f", "p", ["/x"])


def test_two_long_names_differ_within_40_characters():
    first, second = names_of([f"/{'long_' * 12}", f"/{'long-' * 12}"]).values()
    assert (len(first), len(second)) == (39, 36)
    assert second.endswith(" 2")


@pytest.mark.parametrize(
    ("paths", "expected"),
    [
        (["/a/modes/pull_over", "/a/map"], ["pull over", "map"]),
        (["/a/modes/local", "/a/control/local"], ["modes local", "control local"]),
        (["/a/b", "/b"], ["a b", "b"]),
        (["/x_y", "/x/y"], ["x y", "y"]),
        (["/a b", "/a-b", "a_b"], ["a b", "a b 2", "a b 3"]),
        (["/"], ["unit"]),
        (["/" + "long_" * 12], ["long long long long long long long long"]),
    ],
)
def test_names_are_the_last_words_that_no_other_has(paths, expected):
    assert list(names_of(paths).values()) == expected
    assert all(len(each) <= 40 for each in expected)
