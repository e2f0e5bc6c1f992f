"""The dashboards' variables. A name means the same on all dashboards, so links can pass them."""

from __future__ import annotations

from grafana_foundation_sdk.builders import dashboard as builders
from grafana_foundation_sdk.models import dashboard

from fleet_dashboards.lib import palette

DATASOURCE = dashboard.DataSourceRef(type_val="prometheus", uid="${datasource}")
_ROBOT = "robot:ros_diagnostics:info"
_COMPONENT = "component:ros_diagnostics_state:rank"
_VALUE = "ros_diagnostics_component_value"


def datasource() -> builders.DatasourceVariable:
    """The Prometheus to query."""
    return builders.DatasourceVariable("datasource").label("Prometheus").type("prometheus")


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
    return _several("robot", "Robot", f'label_values({_ROBOT}{{fleet=~"$fleet"}}, robot)')


def components() -> builders.QueryVariable:
    """Components of one robot, all or some."""
    query = f'label_values({_COMPONENT}{{fleet=~"$fleet", robot="$robot"}}, component)'
    return _several("component", "Component", query)


def component() -> builders.QueryVariable:
    """One component's name, of the whole fleet."""
    query = f'label_values({_COMPONENT}{{fleet=~"$fleet"}}, component)'
    return _one("component", "Component", query)


def key() -> builders.QueryVariable:
    """One key of a component's key-values."""
    query = f'label_values({_VALUE}{{fleet=~"$fleet", component="$component"}}, key)'
    return _one("key", "Key", query)


def unit() -> builders.QueryVariable:
    """Units of one robot's values, except for temperatures; a panel is repeated for each."""
    query = f'label_values({_VALUE}{{fleet=~"$fleet", robot="$robot"}}, unit)'
    variable = _several("unit", "Unit", query).regex(r"/^(?!(?:degC|degF|K)$).+/")
    return variable.hide(dashboard.VariableHide.HIDE_VARIABLE)


def state() -> builders.CustomVariable:
    """A state to filter by. The value is a comparison, because a rank is no label."""
    choices = {"All": ">= -1", "Not OK": "!= 0"}
    choices |= {each.word: f"== {each.rank}" for each in palette.WORST_FIRST}
    return _choice("state", "State", choices)


def problems() -> builders.CustomVariable:
    """Whether to leave out acknowledged and planned problems; the value is a comparison, too."""
    return _choice("problems", "Problems", {"All": "== 0", "Unhandled": "== 1"})


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


def _filled(variable: builders.QueryVariable, label: str, query: str) -> builders.QueryVariable:
    return (
        variable.label(label)
        .datasource(DATASOURCE)
        .query(query)
        .refresh(dashboard.VariableRefresh.ON_TIME_RANGE_CHANGED)
        .sort(dashboard.VariableSort.NATURAL_ASC)
    )
