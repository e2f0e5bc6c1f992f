"""Whatever a file says: each unit and each edit has a row, and fleet.yml is valid."""

from pathlib import Path

import yaml
from hypothesis import given
from hypothesis import strategies as st

from ros_diagnostics_tools.autoware.convert import convert
from ros_diagnostics_tools.autoware.graph import GraphError, read
from support.configs import load_text

TYPES = ("and", "or", "diag", "link", "ok", "warn", "warn-to-ok", "warn-to-error", "x", 7, None)
TEXTS = st.sampled_from(["", "Ä ö", "^(", "x" * 60])
PATHS = st.sampled_from([f"/{area}/{part}" for area in "abcd" for part in "wxyz"])
SCALARS = st.one_of(TEXTS, st.sampled_from([None, 0, -1, 0.5, True, float("inf")]))
MORE = ("timeout", "latch", "dependent", "colour")


def units(inner):
    """Most of them as they should be, some with anything in a key."""
    fixed = {"type": st.sampled_from(TYPES)}
    optional = {
        **dict.fromkeys(("node", "name"), st.one_of(PATHS, TEXTS, TEXTS, SCALARS)),
        **dict.fromkeys(("path", "link"), st.one_of(PATHS, PATHS, SCALARS)),
        **dict.fromkeys(MORE, SCALARS),
        "list": st.one_of(st.lists(inner, max_size=3), SCALARS),
        "item": inner,
    }
    made = st.fixed_dictionaries(fixed, optional=optional)
    diag = st.fixed_dictionaries({"type": st.just("diag"), "node": PATHS, "name": PATHS})
    named = st.fixed_dictionaries(
        {"type": st.sampled_from(["and", "or"]), "path": PATHS, "list": st.lists(diag, max_size=3)}
    )
    return st.one_of(made, diag, named)


UNIT = st.recursive(st.one_of(SCALARS, units(SCALARS)), units, max_leaves=8)
EDIT = st.one_of(
    SCALARS,
    st.fixed_dictionaries({"type": SCALARS}, optional={"path": SCALARS}),
    st.fixed_dictionaries({"type": st.just("remove"), "path": PATHS}),
)


@given(found=st.lists(UNIT, max_size=5), edits=st.lists(EDIT, max_size=2))
def test_every_unit_has_a_row_and_the_fleet_is_valid(tmp_path_factory, found, edits):
    folder: Path = tmp_path_factory.mktemp("g")
    path = folder / "graph.yaml"
    path.write_text(yaml.safe_dump({"units": found, "edits": edits}), encoding="utf-8")
    try:
        graph = read([path], {})
    except GraphError as error:
        assert str(path) in str(error)  # noqa: PT017 - either is right, and this is how it must be
        return
    made = convert(graph, "f", "p")

    assert len(made.rows) == len(graph.units) + len(edits)
    assert len(graph.units) >= len(found)
    assert all(each.text for each in made.rows)
    load_text(folder, made.text)
