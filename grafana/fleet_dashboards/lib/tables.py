"""Tables: rows joined from several queries, columns with units, colours and links.

Grafana joins the rows (transformation "merge"): those become one whose common labels are equal.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from grafana_foundation_sdk.builders import common as common_builders
from grafana_foundation_sdk.builders import prometheus, table
from grafana_foundation_sdk.models import common, dashboard
from grafana_foundation_sdk.models.prometheus import PromQueryFormat

from fleet_dashboards.lib import links, palette
from fleet_dashboards.lib.panels import WIDTH, at_end, by_thresholds, tidy
from fleet_dashboards.lib.variables import DATASOURCE


class Column(NamedTuple):
    """A column of a table: ``field`` is a label, or "A", "B", ... for the value of that query."""

    field: str
    title: str
    unit: str = ""
    mappings: list[dashboard.ValueMapping] | None = None
    link: str = ""  # of the cells
    width: int = 0  # pixels; 0 = what is left
    hidden: bool = False  # there only for links of other columns

    def is_value(self) -> bool:
        """Return whether it shows a query's value, not a label."""
        return len(self.field) == 1


STATE = Column("A", "State", mappings=palette.state_mappings(), width=110)
FLEET = Column("fleet", "Fleet", width=110)
ROBOT = Column("robot", "Robot", link=links.TO_ROBOT)


def joined(
    title: str,
    description: str,
    empty: str,
    queries: dict[str, str],
    columns: Sequence[Column],
    *,
    by: str = "fleet, robot, group, component",
    sort: str = "State",
    descending: bool = True,
) -> table.Panel:
    """Return a table of rows joined from instant queries on the labels ``by``.

    The first query decides which rows there are: the others are restricted to its rows in PromQL,
    because Grafana cannot filter by a field that is missing when the first query finds nothing.
    ``empty`` is shown then.
    """
    first = next(iter(queries.values()))
    restricted = {
        ref: expr if expr == first else f"(\n{tidy(expr)}\n)\nand on ({by})\n(\n{tidy(first)}\n)"
        for ref, expr in queries.items()
    }
    panel = _table(title, description, columns, empty)
    order = common_builders.TableSortByFieldState().display_name(sort).desc(descending)
    return (
        panel.targets([_rows(expr, ref) for ref, expr in restricted.items()])
        .transformations(_merged(list(queries), columns))
        .sort_by([order])
    )


def pivot(
    title: str,
    description: str,
    empty: str,
    expr: str,
    columns: Sequence[Column],
    *,
    label: str,
    sort: str,
) -> table.Panel:
    """Return a table from one instant query whose ``label`` is the column of a value."""
    order = common_builders.TableSortByFieldState().display_name(sort).desc(False)
    return (
        _table(title, description, columns, empty)
        .targets([at_end(expr)])
        .transformations(
            [
                _step("labelsToFields", mode="columns", valueLabel=label),
                _step("merge"),
                *_selected({column.field: column.title for column in columns}),
            ]
        )
        .sort_by([order])
    )


def _table(title: str, description: str, columns: Sequence[Column], empty: str) -> table.Panel:
    panel = (
        table.Panel()
        .title(title)
        .description(description)
        .datasource(DATASOURCE)
        .color_scheme(by_thresholds())
        .filterable(True)
        .no_value(empty)
        .height(10)
        .span(WIDTH)
    )
    for column in columns:
        panel = panel.override_by_name(column.title, _look(column))
    return panel


def _rows(expr: str, ref: str) -> prometheus.Dataquery:
    return at_end(expr, ref=ref).format(PromQueryFormat.TABLE)


def _merged(
    refs: Sequence[str], columns: Sequence[Column]
) -> list[dashboard.DataTransformerConfig]:
    titles: dict[str, str] = {}
    for column in columns:
        if column.is_value():
            titles[f"Value #{column.field}"] = column.title
        else:
            titles[column.field] = column.title
        if column.field == refs[0]:
            titles["Value"] = column.title  # its name if no other query returns rows
    return [_step("merge"), *_selected(titles)]


def _selected(titles: dict[str, str]) -> list[dashboard.DataTransformerConfig]:
    """Keep only these fields, in this order, with these titles."""
    order = {field: index for index, field in enumerate(titles)}
    return [
        _step("filterFieldsByName", include={"names": list(titles)}),
        _step("organize", excludeByName={}, indexByName=order, renameByName=titles),
    ]


def _step(identity: str, **options: object) -> dashboard.DataTransformerConfig:
    return dashboard.DataTransformerConfig(identity, options=options)


def _look(column: Column) -> list[dashboard.DynamicConfigValue]:
    look: dict[str, object] = {"noValue": ""}  # for a cell; the table's is for no rows
    if column.unit:
        look["unit"] = column.unit
    if column.width:
        look["custom.width"] = column.width
    if column.hidden:
        look["custom.hidden"] = True
    if column.mappings:
        look["mappings"] = column.mappings
        look["custom.cellOptions"] = common.TableColoredBackgroundCellOptions(
            common.TableCellBackgroundDisplayMode.BASIC
        )
    if column.link:
        look["links"] = [{"title": f"Open this {column.title.lower()}", "url": column.link}]
    return [dashboard.DynamicConfigValue(key, value) for key, value in look.items()]
