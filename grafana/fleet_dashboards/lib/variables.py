"""The dashboards' variables. One name means the same everywhere, so that links can carry them."""

from __future__ import annotations

from grafana_foundation_sdk.builders import dashboard as builders
from grafana_foundation_sdk.models import dashboard

from fleet_dashboards.lib import palette
from fleet_dashboards.queries import variables as queries

DATASOURCE = dashboard.DataSourceRef(type_val="prometheus", uid="${datasource}")


def datasource() -> builders.DatasourceVariable:
    """Which Prometheus."""
    return builders.DatasourceVariable("datasource").label("Prometheus").type("prometheus")


def fleet() -> builders.QueryVariable:
    """Fleets, all or some."""
    return _several("fleet", "Fleet", queries.FLEETS)


def site() -> builders.QueryVariable:
    """Sites, all or some; robots without the label belong to All."""
    return _several("site", "Site", queries.SITES)


def robot_group() -> builders.QueryVariable:
    """Groups of robots, all or some."""
    return _several("robot_group", "Group", queries.ROBOT_GROUPS)


def robot() -> builders.QueryVariable:
    """One robot."""
    return _one("robot", "Robot", queries.ROBOTS)


def robots() -> builders.QueryVariable:
    """Robots, all or some."""
    return _several("robot", "Robot", queries.ROBOTS)


def components() -> builders.QueryVariable:
    """Components of one robot, all or some."""
    return _several("component", "Component", queries.COMPONENTS_OF_ROBOT)


def component() -> builders.QueryVariable:
    """One component's name, of the whole fleet."""
    return _one("component", "Component", queries.COMPONENTS_OF_FLEET)


def key() -> builders.QueryVariable:
    """One key of a component's key-values."""
    return _one("key", "Key", queries.KEYS)


def unit() -> builders.QueryVariable:
    """Units that one robot's values have and no panel of their own: panels repeat over it."""
    variable = _several("unit", "Unit", queries.UNITS).hide(dashboard.VariableHide.HIDE_VARIABLE)
    return variable.regex(queries.UNITS_WITHOUT_PANEL)


def state() -> builders.CustomVariable:
    """A state to look at. Its value is a comparison: a rank is a number, not a label."""
    choices = {"All": ">= -1", "Not OK": "!= 0"}
    choices |= {each.word: f"== {each.rank}" for each in palette.WORST_FIRST}
    return _choice("state", "State", choices)


def problems() -> builders.CustomVariable:
    """Whether to leave out what is being taken care of; the value is a comparison, as above."""
    return _choice("problems", "Problems", {"All": "== 0", "Unhandled": "== 1"})


def _choice(name: str, label: str, choices: dict[str, str]) -> builders.CustomVariable:
    values = ", ".join(f"{text} : {value}" for text, value in choices.items())
    options = [dashboard.VariableOption(False, text, value) for text, value in choices.items()]
    options[0].selected = True
    variable = builders.CustomVariable(name).label(label).values(values)
    return variable.current(options[0]).options(options).allow_custom_value(False)


class _Several(builders.QueryVariable):
    """All may be chosen, also what lacks the label: the SDK has no word for that value."""

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
