"""The dashboards' variables. A name means the same on all dashboards, so links can pass them.

`robot` and `component` are one, `robots` and `components` some or all: with one name for both, a
link or the menu would pass several robots to a dashboard that shows one.
"""

from __future__ import annotations

from grafana_foundation_sdk.builders import dashboard as builders
from grafana_foundation_sdk.models import dashboard

from fleet_dashboards.lib import palette
from fleet_dashboards.lib.promql import values

DATASOURCE = dashboard.DataSourceRef(type_val="prometheus", uid="${datasource}")
_ROBOT = "robot:ros_diagnostics:info"
_LEVEL = "ros_diagnostics_component_level"
_VALUE = "ros_diagnostics_component_value"

# Matchers. A name may have quotes and backslashes: a literal regular expression in backticks.
FLEET = 'fleet=~"$fleet"'
ONE_ROBOT = 'fleet=~"$fleet", robot=~`${robot:regex}`'
OF_ONE_ROBOT = 'fleet=~"$fleet", robot=~`|${robot:regex}`'  # and what is of no single robot
ROBOTS = "robot=~`${robots:regex}`"
WORST = "robot=~`${worst:regex}`"
COMPONENT = "component=~`${component:regex}`"
COMPONENTS = "component=~`${components:regex}`"
KEY = "key=~`${key:regex}`"


def datasource() -> builders.DatasourceVariable:
    """The Prometheus to query."""
    return builders.DatasourceVariable("datasource").label("Data source").type("prometheus")


def fleet() -> builders.QueryVariable:
    """Fleets, all or some."""
    return _several("fleet", "Fleet", f"label_values({_ROBOT}, fleet)")


def site() -> builders.QueryVariable:
    """Sites, all or some; robots without the label belong to All."""
    return _several("site", "Site", f'label_values({_ROBOT}{{fleet=~"$fleet"}}, site)')


def robot_group() -> builders.QueryVariable:
    """Groups of robots, all or some."""
    return _several(
        "robot_group", "Group", f'label_values({_ROBOT}{{fleet=~"$fleet"}}, robot_group)'
    )


def robot() -> builders.QueryVariable:
    """One robot."""
    return _one("robot", "Robot", f'label_values({_ROBOT}{{fleet=~"$fleet"}}, robot)')


def robots() -> builders.QueryVariable:
    """Robots, all or some."""
    return _several("robots", "Robots", f'label_values({_ROBOT}{{fleet=~"$fleet"}}, robot)')


def components() -> builders.QueryVariable:
    """Components of one robot, all or some."""
    query = f"label_values({_LEVEL}{{{ONE_ROBOT}}}, component)"
    return _several("components", "Components", query)


def component() -> builders.QueryVariable:
    """One component's name, of the whole fleet: the worst are the first, then those with values."""
    states = f"component:ros_diagnostics_state:rank{{{FLEET}}} or {_LEVEL}{{{FLEET}}} * 0"
    with_values = f"({values(FLEET)}) * 0 + 0.5"
    expr = f"max by (component) ({states} or {with_values})"
    return _worst_first("component", "Component", expr)


def key() -> builders.QueryVariable:
    """One key of a component's key-values: those with thresholds are the first."""
    of = f'fleet=~"$fleet", {COMPONENT}'
    thresholds = f"ros_diagnostics_component_value_threshold{{{of}}} * 0 + 2"
    found = f"({thresholds}) or ({values(of)}) * 0 + 1"
    return _worst_first("key", "Key", f"max by (key) ({found})")


def unit() -> builders.QueryVariable:
    """Units of one robot's values, except for temperatures; a panel is repeated for each."""
    query = f"label_values({_VALUE}{{{ONE_ROBOT}}}, unit)"
    variable = _several("unit", "Unit", query).regex(r"/^(?!(?:degC|degF|K)$).+/")
    return variable.hide(dashboard.VariableHide.HIDE_VARIABLE)


def worst(robots: str) -> builders.QueryVariable:
    """All robots that ``robots``, PromQL, returns: chosen by no person, so it is hidden."""
    return _all_of("worst", "Worst", f"max by (robot) ({robots})", "robot")


def wall(robots: str) -> builders.QueryVariable:
    """The sites, by the label ``at`` of ``robots``, PromQL: a panel is repeated for each."""
    return _all_of("wall", "Wall", f"count by (at) ({robots})", "at")


def _all_of(name: str, title: str, expr: str, label: str) -> builders.QueryVariable:
    """A hidden variable with all values of the last label of what PromQL returns."""
    everything = dashboard.VariableOption(True, ["All"], ["$__all"])
    variable = _filled(builders.QueryVariable(name), title, f"query_result({expr})")
    variable = variable.regex(f'/{label}="(.*)"}} /').multi(True).include_all(True)
    return variable.current(everything).hide(dashboard.VariableHide.HIDE_VARIABLE)


def state() -> builders.CustomVariable:
    """A state to filter by. The value is a comparison, because a rank is no label."""
    choices = {"All": ">= -1", "Not OK": "!= 0"}
    choices |= {each.word: f"== {each.rank}" for each in palette.WORST_FIRST}
    return _choice("state", "State", choices)


def problems() -> builders.CustomVariable:
    """Whether to leave out acknowledged and planned problems; the value is a comparison, too."""
    return _choice("problems", "Problems", {"All": "== 0", "Unhandled": "== 1"})


def target() -> builders.CustomVariable:
    """The availability that is aimed at, in percent; any other may be written."""
    targets = {each: each for each in ("99", "90", "95", "98", "99.5", "99.9")}
    return _choice("target", "Target in %", targets).allow_custom_value(True)


def _choice(name: str, label: str, choices: dict[str, str]) -> builders.CustomVariable:
    values = ", ".join(f"{text} : {value}" for text, value in choices.items())
    options = [dashboard.VariableOption(False, text, value) for text, value in choices.items()]
    options[0].selected = True
    variable = builders.CustomVariable(name).label(label).values(values)
    return variable.current(options[0]).options(options).allow_custom_value(False)


class _Several(builders.QueryVariable):
    """With an All that matches series without the label; the SDK's builder cannot set it."""

    def build(self) -> dashboard.VariableModel:
        model = super().build()
        model.all_value = ".*"
        return model


def _one(name: str, label: str, query: str) -> builders.QueryVariable:
    return _filled(builders.QueryVariable(name), label, query)


def _several(name: str, label: str, query: str) -> builders.QueryVariable:
    everything = dashboard.VariableOption(True, ["All"], ["$__all"])
    variable = _filled(_Several(name), label, query)
    return variable.multi(True).include_all(True).current(everything)


def _worst_first(name: str, label: str, expr: str) -> builders.QueryVariable:
    """Return a variable with the values of the label ``name``, in the order of the series."""
    one_line = " ".join(expr.split())  # Grafana does not know the function over several lines
    variable = _one(name, label, f"query_result(sort_desc({one_line}))")
    return variable.regex(f'/{name}="(.*)"}} /').sort(dashboard.VariableSort.DISABLED)


def _filled(variable: builders.QueryVariable, label: str, query: str) -> builders.QueryVariable:
    return (
        variable.label(label)
        .datasource(DATASOURCE)
        .query(query)
        .refresh(dashboard.VariableRefresh.ON_TIME_RANGE_CHANGED)
        .sort(dashboard.VariableSort.NATURAL_ASC)
    )
