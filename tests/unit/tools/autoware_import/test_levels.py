"""Any diagnostic graph: its capabilities have the levels that Autoware publishes of its units."""

from pathlib import Path
from typing import Any

import yaml
from hypothesis import given
from hypothesis import strategies as st

from ros_diagnostics_exporter.api.snapshot import fleet_snapshot
from ros_diagnostics_exporter.config.load import load
from ros_diagnostics_exporter.model import Status
from ros_diagnostics_tools.autoware.convert import Imported, convert
from ros_diagnostics_tools.autoware.graph import read
from support.state_driver import ERROR, OK, STALE, WARN, StateDriver

JOIN = {"and": max, "or": min}
REMAPPED = {
    "warn-to-ok": {OK: OK, WARN: OK, ERROR: ERROR},
    "warn-to-error": {OK: OK, WARN: ERROR, ERROR: ERROR},
}
CONSTANTS = {"ok": OK, "warn": WARN, "error": ERROR, "stale": ERROR}
# Some are part of another, or have characters that mean something in a regular expression.
DIAGS = (
    *(("drive", "motor"), ("drive", "motor 2"), ("a.b", "(c)"), ("axb", "(c)"), ("", "Laser [x]")),
    *(("/adapi/node", "state"), ("Drive", "motor")),
)
AS_AUTOWARE = {"ok": OK, "no_reserve": OK, "degraded": WARN, "lost": ERROR, "unknown": ERROR}
ALWAYS = {"always OK": OK, "always WARN": WARN, "always ERROR": ERROR}
ROBOTS = "\nrobots: [{name: r, topic: /r/diagnostics, source: raw, profile: autoware}]\n"

Data = dict[str, Any]


# -- the published semantics, as they are written --------------------------------------------------


class Published:
    """The levels of a graph's units by autoware_diagnostic_graph_aggregator, doc/format/unit.

    STALE is treated as ERROR, and what was never received is STALE. Of no units an `or` is OK: so
    is its code, against its page. None: rests on a remapping whose item an edit removes.
    """

    def __init__(self, units: list[Data], removed: set[str]) -> None:
        self._removed = removed
        self._by_path: dict[str, Data] = {}
        for unit in units:
            self._index(unit)

    def _index(self, unit: Data) -> None:
        if "path" in unit:
            self._by_path[unit["path"]] = unit
        for each in inputs(unit):
            self._index(each)

    def levels(self, received: dict[str, int]) -> dict[str, int | None]:
        """The level of each unit with a path."""
        self._received = received
        paths = self._by_path.keys() - self._removed
        return {path: self._level(self._resolved(self._by_path[path])) for path in paths}

    def _resolved(self, unit: Data) -> Data:
        return self._resolved(self._by_path[unit["link"]]) if unit["type"] == "link" else unit

    def _level(self, unit: Data) -> int | None:
        kind = unit["type"]
        if kind in CONSTANTS:
            return CONSTANTS[kind]
        if kind == "diag":
            return min(self._received.get(full_name(unit), STALE), ERROR)
        units = [self._resolved(each) for each in inputs(unit)]
        found = [self._level(each) for each in units if each.get("path") not in self._removed]
        if None in found or (kind in REMAPPED and not found):
            return None
        return REMAPPED[kind][found[0]] if kind in REMAPPED else JOIN[kind](found, default=OK)


def inputs(unit: Data) -> list[Data]:
    """The units inside of one."""
    return unit.get("list", [unit["item"]] if "item" in unit else [])


def full_name(unit: Data) -> str:
    return unit["name"] if not unit["node"] else f"{unit['node']}: {unit['name']}"


# -- graphs ----------------------------------------------------------------------------------------


@st.composite
def graphs(draw, constants: tuple[str, ...] = ("ok", "error", "stale")):
    """Units, each linked to earlier ones, some inside of others, with a path or without."""
    paths: list[str] = []

    def unit(depth: int, *, has_path: bool) -> Data:
        kinds = ["diag", *constants, *["link"] * 3 * bool(paths)]
        if depth < 3:
            kinds += ["and", "or", "and", "or", "warn-to-ok", "warn-to-error"]
        kind = draw(st.sampled_from(kinds))
        made: Data = {"type": kind}
        if kind == "diag":
            node, name = draw(st.sampled_from(DIAGS))
            made |= {"node": node, "name": name}
        elif kind == "link":
            made["link"] = draw(st.sampled_from(paths))
        elif kind in ("and", "or"):
            count = draw(st.integers(0, 3))
            made["list"] = [unit(depth + 1, has_path=draw(st.booleans())) for _ in range(count)]
        elif kind.startswith("warn-to"):
            made["item"] = unit(depth + 1, has_path=draw(st.booleans()))
        if has_path:
            area = draw(st.sampled_from(["/autoware/modes", "/autoware/control", "/x_y"]))
            made["path"] = f"{area}/unit_{len(paths)}"
            paths.append(made["path"])
        return made

    units = [unit(0, has_path=True) for _ in range(draw(st.integers(1, 5)))]
    return draw(st.permutations(units))


LEVELS_OF = [full_name({"node": node, "name": name}) for node, name in DIAGS]
LEVELS = st.fixed_dictionaries(dict.fromkeys(LEVELS_OF, st.sampled_from([OK, WARN, ERROR, STALE])))
NEVER = st.sets(st.sampled_from(LEVELS_OF))


def imported(folder: Path, units: list[Data], removed: set[str] = frozenset()) -> Imported:
    edits = [{"type": "remove", "path": path} for path in sorted(removed)]
    (folder / "graph.yaml").write_text(yaml.safe_dump({"units": units, "edits": edits}))
    made = convert(read([folder / "graph.yaml"], {}), "f", "autoware")
    (folder / "fleet.yml").write_text(made.text + ROBOTS)
    return made


def judged(driver: StateDriver, levels: dict[str, int]) -> dict[str, str]:
    """The state of each capability, by its name."""
    driver.stand(3, *(Status(each, name) for name, each in levels.items()))
    (robot,) = fleet_snapshot(driver.state, driver.now)["robots"]
    return {each["capability"]: each["state"] for each in robot["capabilities"]}


def check(
    folder: Path, units: list[Data], removed: set[str], histories: list[dict[str, int]]
) -> set[str]:
    """Compare the levels after each step; the paths of the units that are imported whole."""
    made = imported(folder, units, removed)
    autoware = Published(units, removed)
    driver = StateDriver(fleet=load(folder / "fleet.yml"))
    rows = {each.where.split(": ", 1)[1]: each for each in made.rows if each.type != "edit"}
    for levels in histories:
        states = judged(driver, levels)
        if len(levels) == len(LEVELS_OF):
            assert "unknown" not in states.values()
        for path, level in autoware.levels(levels).items():
            row = rows[path]
            if not row.is_whole:
                continue
            if row.text.startswith("capability "):
                assert AS_AUTOWARE[states[row.text.split('"')[1]]] == level, (path, states)
            # What rests on a remapping without its item may have one level all the same.
            elif row.text.startswith("always ") and level is not None:
                assert ALWAYS[row.text.split(":")[0]] == level
    return {path for path, row in rows.items() if row.is_whole}


@given(units=graphs(), first=LEVELS, then=LEVELS, never=NEVER)
def test_capabilities_have_the_levels_of_autowares_units(
    tmp_path_factory, units, first, then, never
):
    histories = [{k: v for k, v in each.items() if k not in never} for each in (first, then)]
    whole = check(tmp_path_factory.mktemp("g"), units, set(), histories)
    assert whole >= Published(units, set()).levels(first).keys()


@given(data=st.data(), units=graphs(("ok", "warn", "error")), first=LEVELS, then=LEVELS)
def test_what_cannot_be_said_is_in_the_report_and_the_rest_has_autowares_levels(
    tmp_path_factory, data, units, first, then
):
    paths = sorted(Published(units, set()).levels(first))
    links = {each["path"] for each in units if each["type"] == "link"}  # no edit removes one
    removed = data.draw(st.sets(st.sampled_from(paths), max_size=2)) - links
    check(tmp_path_factory.mktemp("g"), units, removed, [first, then])
