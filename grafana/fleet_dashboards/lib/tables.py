"""Tables: rows joined from several queries, columns with units, colours and links.

Grafana joins the rows (transformation "merge"): those become one whose common labels are equal.

Where no row is good news, a row says so, and only if a query has proved it (`Empty`): Grafana shows
the same text for an empty result and for a Prometheus that does not answer.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from grafana_foundation_sdk.builders import common as common_builders
from grafana_foundation_sdk.builders import prometheus, table
from grafana_foundation_sdk.models import common, dashboard
from grafana_foundation_sdk.models.prometheus import PromQueryFormat

from fleet_dashboards.lib import links, palette
from fleet_dashboards.lib.panels import NO_DATA, WIDTH, at_end, by_thresholds, steps, tidy
from fleet_dashboards.lib.promql import or_nothing
from fleet_dashboards.lib.variables import DATASOURCE

TIME = "dateTimeAsIsoNoDateIfToday"  # of milliseconds
MINUTE = "time:D MMM HH:mm"  # as wide on any day
DURATION = "dtdhms"  # of seconds: 01:02:03, from a day on "2 d 01:02:03"


class Column(NamedTuple):
    """A column of a table: ``field`` is a label, or "A", "B", ... for the value of that query."""

    field: str
    title: str
    unit: str = ""
    mappings: list[dashboard.ValueMapping] | None = None
    link: str = ""  # of the cells
    links: tuple[tuple[str, str], ...] = ()  # of the cells: titles and addresses; instead of one
    width: int = 0  # pixels; 0 = what is left
    min_width: int = 0  # pixels, where width is 0
    hidden: bool = False  # there only for links of other columns, or to sort by
    filtered: bool = False  # whether its header has a filter
    wrapped: bool = False  # whether a long text takes several lines; Grafana 11 and later
    decimals: int | None = None  # of the value; by default as many as Grafana finds fit
    background: bool = False  # whether the colour of the value is that of the cell

    def is_value(self) -> bool:
        """Return whether it shows a query's value, not a label."""
        return len(self.field) == 1


class Empty(NamedTuple):
    """A row's text if the first query has none and ``proof`` has a value: then that is known."""

    text: str
    proof: str
    column: str = "message"  # the label of the column with the text


STATE = Column("A", "State", mappings=palette.state_mappings(), width=120, background=True)
FLEET = Column("fleet", "Fleet", width=100)
ROBOT = Column("robot", "Robot", link=links.TO_ROBOT, min_width=110, filtered=True)
MAINTENANCE = Column(
    "F",
    "Maintenance",
    mappings=palette.yes("planned", palette.MAINTENANCE_COLOUR),
    width=110,
    background=True,
)
# Robots in their natural order: sorted by the label `order`, which is shown without its "!".
ROBOT_IN_ORDER = Column(
    "order",
    "Robot",
    link=links.TO_ROBOT_IN_ORDER,
    min_width=110,
    filtered=True,
    mappings=palette.rewritten("/^(.*?)!+([0-9]+)$/", "$1$2"),
)
NAME = Column("robot", "Name", hidden=True)  # for its link


def joined(
    title: str,
    description: str,
    queries: dict[str, str],
    columns: Sequence[Column],
    *,
    empty: Empty | str = NO_DATA,
    by: str = "fleet, robot, group, component",
    sort: Sequence[str] = ("State",),
    ascending: Sequence[str] = ("Since", "Robot"),
) -> table.Panel:
    """Return a table of rows joined from instant queries on the labels ``by``.

    The first query decides which rows there are: the others are restricted to its rows in PromQL,
    because Grafana cannot filter by a field that is missing when the first query finds nothing.
    Without rows the text ``empty`` is shown. Rows are sorted by the titles ``sort``, descending
    except for those in ``ascending``.
    """
    first, *others = queries
    rows = tidy(queries[first])
    sent = {first: or_nothing(rows, *empty) if isinstance(empty, Empty) else rows}
    for ref in others:
        sent[ref] = f"(\n{tidy(queries[ref])}\n)\nand on ({by})\n(\n{rows}\n)"
    return (
        _table(title, description, columns)
        .targets([_rows(expr, ref) for ref, expr in sent.items()])
        .transformations(_merged(list(queries), columns))
        .sort_by([_order(each, each not in ascending) for each in sort])
        .no_value(NO_DATA if isinstance(empty, Empty) else empty)
    )


def pivot(
    title: str,
    description: str,
    expr: str,
    columns: Sequence[Column],
    *,
    label: str,
    sort: str,
    others: list[dashboard.ValueMapping] | None = None,
    unit: str = "",
    descending: bool = True,
) -> table.Panel:
    """Return a table from one instant query whose ``label`` is the column of a value.

    With ``others`` each other value of the label is a column, too, with these words and colours,
    and in this unit; rows are then sorted ``descending``, and by the first column.
    """
    titles = {column.field: column.title for column in columns}
    selected = _selected(titles) if others is None else [_first(titles)]
    order = [_order(sort, descending=descending and others is not None)]
    if others is not None:
        order.append(_order(columns[0].title, descending=False))
    return (
        _table(title, description, columns, others, unit)
        .targets([at_end(expr)])
        .transformations(
            [
                step("labelsToFields", mode="columns", valueLabel=label),
                step("merge"),
                *selected,
            ]
        )
        .sort_by(list(order))
    )


def _order(title: str, descending: bool) -> common_builders.TableSortByFieldState:
    return common_builders.TableSortByFieldState().display_name(title).desc(descending)


def _table(
    title: str,
    description: str,
    columns: Sequence[Column],
    numbers: list[dashboard.ValueMapping] | None = None,
    unit: str = "",
) -> table.Panel:
    panel = (
        table.Panel()
        .title(title)
        .description(description)
        .datasource(DATASOURCE)
        .color_scheme(by_thresholds())
        .thresholds(steps((None, palette.TEXT)))
        .filterable(False)
        .no_value(NO_DATA)
        .height(10)
        .span(WIDTH)
    )
    if numbers is not None:
        nothing = palette.special(dashboard.SpecialValueMatch.NULL_AND_NAN, "")
        look = BACKGROUND | {"mappings": [*numbers, nothing], "custom.minWidth": 115}
        look |= {"unit": unit, "decimals": 2} if unit else {}
        panel = panel.override_by_field_type(
            "number", [dashboard.DynamicConfigValue(key, value) for key, value in look.items()]
        )
    for column in columns:
        plain = PLAIN if numbers is not None and not column.background else {}
        panel = panel.override_by_name(column.title, _look(column, plain))
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
    return [step("merge"), *_selected(titles)]


def _selected(titles: dict[str, str]) -> list[dashboard.DataTransformerConfig]:
    """Keep only these fields, in this order, with these titles."""
    order = {field: index for index, field in enumerate(titles)}
    return [
        step("filterFieldsByName", include={"names": list(titles)}),
        step("organize", excludeByName={}, indexByName=order, renameByName=titles),
    ]


def _first(titles: dict[str, str]) -> dashboard.DataTransformerConfig:
    """Put these fields first, in this order, with these titles; the others follow."""
    order = {field: index for index, field in enumerate(titles)}
    return step("organize", excludeByName={"Time": True}, indexByName=order, renameByName=titles)


def step(identity: str, **options: object) -> dashboard.DataTransformerConfig:
    """Return a transformation."""
    return dashboard.DataTransformerConfig(identity, options=options)


def _look(column: Column, plain: dict[str, object]) -> list[dashboard.DynamicConfigValue]:
    look: dict[str, object] = {"noValue": "", **plain}  # for a cell; the table's is for no rows
    given = {
        "unit": column.unit or None,
        "decimals": column.decimals,
        "custom.width": column.width or None,
        "custom.minWidth": column.min_width or None,
        "custom.hidden": column.hidden or None,
        "custom.filterable": column.filtered or None,
    }
    look |= {key: value for key, value in given.items() if value is not None}
    # Only of values: no text is a number, either.
    without = [NOTHING] if column.background else [NAN] if column.is_value() else []
    look["mappings"] = [*(column.mappings or ()), *without]
    if column.wrapped:
        look["custom.cellOptions"] = common.TableAutoCellOptions(wrap_text=True)
    if column.background:
        look |= BACKGROUND
    if column.link:
        look["links"] = [{"title": f"Open this {column.title.lower()}", "url": column.link}]
    if column.links:
        look["links"] = [
            {"title": title, "url": url, "targetBlank": True} for title, url in column.links
        ]
    return [dashboard.DynamicConfigValue(key, value) for key, value in look.items()]


# Of a column beside others with a background.
PLAIN: dict[str, object] = {
    "custom.cellOptions": common.TableAutoCellOptions(),
    "custom.displayMode": "auto",
}
# Without a value a cell with a background would have the colour of text.
NOTHING = palette.special(dashboard.SpecialValueMatch.NULL_AND_NAN, "")
NAN = palette.special(dashboard.SpecialValueMatch.NA_N, "")
# The colour of a value or mapping as that of the cell: Grafana 9.5 and later, and before.
BACKGROUND: dict[str, object] = {
    "custom.cellOptions": common.TableColoredBackgroundCellOptions(
        common.TableCellBackgroundDisplayMode.BASIC
    ),
    "custom.displayMode": "color-background-solid",
}
