"""Tables: rows joined from several queries, columns with their own look.

The joining is Grafana's ("merge"): rows become one where the labels common to all are equal.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from grafana_foundation_sdk.builders import common as common_builders
from grafana_foundation_sdk.builders import prometheus, table
from grafana_foundation_sdk.models import common, dashboard
from grafana_foundation_sdk.models.prometheus import PromQueryFormat

from fleet_dashboards import palette
from fleet_dashboards.panels import WIDTH, at_end, by_thresholds
from fleet_dashboards.variables import DATASOURCE


class Column(NamedTuple):
    """A column of a table: ``field`` is a label, or "A", "B", ... for the value of that query."""

    field: str
    title: str
    unit: str = ""
    mappings: list[dashboard.ValueMapping] | None = None
    link: str = ""  # to where a click on the cell leads
    width: int = 0  # pixels; 0 = what is left

    def is_value(self) -> bool:
        """Whether it shows a query's value, not a label."""
        return len(self.field) == 1


STATE = Column("A", "State", mappings=palette.state_mappings(), width=110)


def listing(
    title: str,
    description: str,
    queries: dict[str, str],
    columns: Sequence[Column],
    *,
    sort: str = "State",
    descending: bool = True,
) -> table.Panel:
    """Rows joined from instant queries on the labels that all of them have.

    A row that the first query does not give is dropped: it alone decides what is listed.
    """
    panel = (
        table.Panel()
        .title(title)
        .description(description)
        .datasource(DATASOURCE)
        .targets([_rows(expr, ref) for ref, expr in queries.items()])
        .transformations(_joined(queries, columns))
        .color_scheme(by_thresholds())
        .filterable(True)
        .sort_by([common_builders.TableSortByFieldState().display_name(sort).desc(descending)])
        .no_value("")
        .height(10)
        .span(WIDTH)
    )
    for column in columns:
        panel = panel.override_by_name(column.title, _look(column))
    return panel


def _rows(expr: str, ref: str) -> prometheus.Dataquery:
    return at_end(expr, ref=ref).format(PromQueryFormat.TABLE)


def _joined(
    queries: dict[str, str], columns: Sequence[Column]
) -> list[dashboard.DataTransformerConfig]:
    # With one query Grafana calls its value "Value", with several "Value #A".
    def field(column: Column) -> str:
        if not column.is_value():
            return column.field
        return "Value" if len(queries) == 1 else f"Value #{column.field}"

    first = field(Column(next(iter(queries)), ""))
    listed = {
        "fieldName": first,
        "config": {"id": "isNotNull", "options": {}},
    }
    fields = [field(column) for column in columns]
    return [
        _step("merge"),
        _step("filterByValue", filters=[listed], type="include", match="all"),
        _step("filterFieldsByName", include={"names": fields}),
        _step(
            "organize",
            excludeByName={},
            indexByName={each: index for index, each in enumerate(fields)},
            renameByName=dict(zip(fields, (column.title for column in columns), strict=True)),
        ),
    ]


def _step(identity: str, **options: object) -> dashboard.DataTransformerConfig:
    return dashboard.DataTransformerConfig(identity, options=options)


def _look(column: Column) -> list[dashboard.DynamicConfigValue]:
    look: dict[str, object] = {}
    if column.unit:
        look["unit"] = column.unit
    if column.width:
        look["custom.width"] = column.width
    if column.mappings:
        look["mappings"] = column.mappings
        look["custom.cellOptions"] = common.TableColoredBackgroundCellOptions(
            common.TableCellBackgroundDisplayMode.BASIC
        )
    if column.link:
        look["links"] = [{"title": f"Open this {column.title.lower()}", "url": column.link}]
    return [dashboard.DynamicConfigValue(key, value) for key, value in look.items()]
