"""Panels of each type, in the style that all dashboards share.

A panel's description begins with the question that it answers; docs/reference/panels.md lists them.
Only panel types that Grafana has had since 9.5 are used.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

from grafana_foundation_sdk.builders import (
    bargauge,
    prometheus,
    stat,
    statetimeline,
    table,
    timeseries,
)
from grafana_foundation_sdk.builders import common as common_builders
from grafana_foundation_sdk.builders import dashboard as builders
from grafana_foundation_sdk.models import common, dashboard
from grafana_foundation_sdk.models.prometheus import PromQueryFormat

from fleet_dashboards.lib import palette
from fleet_dashboards.lib.variables import DATASOURCE

NO_DATA = "No data"
Shown = TypeVar("Shown", stat.Panel, bargauge.Panel, table.Panel)
WIDTH = 24  # of Grafana's grid; on a phone every panel is as wide as the screen


def over_time(expr: str, legend: str = "", ref: str = "A") -> prometheus.Dataquery:
    """Return a range query; ``legend`` is Grafana's template of labels."""
    query = prometheus.Dataquery().expr(tidy(expr)).range().ref_id(ref)
    return query.legend_format(legend or "__auto").datasource(DATASOURCE)


def at_end(expr: str, legend: str = "", ref: str = "A") -> prometheus.Dataquery:
    """Return an instant query at the end of the time range."""
    return over_time(expr, legend, ref).instant()


def tidy(expr: str) -> str:
    """Remove empty lines and common indentation from an expression."""
    lines = [line.rstrip() for line in expr.splitlines() if line.strip()]
    margin = min(len(line) - len(line.lstrip()) for line in lines)
    return "\n".join(line[margin:] for line in lines)


# --- One number, or one word ---


def number(title: str, description: str, expr: str, unit: str = "none") -> stat.Panel:
    """Show the present value, large; without one, that there is no data, on no colour.

    In the unit "short" 1034 robots would be 1 K.
    """
    return (
        stat.Panel()
        .title(title)
        .description(description)
        .datasource(DATASOURCE)
        .with_target(at_end(expr))
        .unit(unit)
        .reduce_options(common_builders.ReduceDataOptions().calcs(["lastNotNull"]))
        .color_mode(common.BigValueColorMode.VALUE)
        .color_scheme(by_thresholds())
        .thresholds(steps((None, palette.TEXT)))
        .graph_mode(common.BigValueGraphMode.NONE)
        .text_mode(common.BigValueTextMode.VALUE)
        .no_value(NO_DATA)
        .height(4)
        .span(4)
    )


def word(
    title: str, description: str, expr: str, mappings: list[dashboard.ValueMapping]
) -> stat.Panel:
    """Show the present value as a word on its colour."""
    return on_colour(number(title, description, expr).mappings(mappings))


def on_colour(panel: stat.Panel, *starts: tuple[float, str]) -> stat.Panel:
    """Show a number or word on the colour of its mapping, or from a value on; else on none."""
    panel = panel.thresholds(steps((None, palette.NOTHING), *starts))
    # Solid: its gradient is lighter in the light theme, where no text on it would be legible.
    return panel.color_mode(common.BigValueColorMode.BACKGROUND_SOLID)


def texts(
    title: str, description: str, expr: str, label: str, mappings: list[dashboard.ValueMapping]
) -> stat.Panel:
    """Show the texts of a label of all series."""
    query = at_end(expr).format(PromQueryFormat.TABLE)
    reduced = common_builders.ReduceDataOptions().calcs(["lastNotNull"]).values(True)
    return (
        on_colour(number(title, description, expr).mappings(mappings))
        .targets([query])
        .reduce_options(reduced.fields(f"/^{label}$/"))
    )


def now(panel: Shown) -> Shown:
    """Show what is now, also where the time range ends later: with the day."""
    return panel.time_from("5m").hide_time_override(True)


def text_of(
    *, value: float | None = None, name: float | None = None
) -> common_builders.VizTextDisplayOptions:
    """Return the sizes of texts in pixels; else that of one is large, and those of many small."""
    size = common_builders.VizTextDisplayOptions()
    size = size if value is None else size.value_size(value)
    return size if name is None else size.title_size(name)


def counts(
    title: str, description: str, expr: str, label: str, shown: Mapping[str, palette.State]
) -> stat.Panel:
    """Show a count for each value of ``label``, by state; a zero on no colour."""
    panel = on_colour(number(title, description, expr).targets([at_end(expr, f"{{{{{label}}}}}")]))
    for name, state in shown.items():
        panel = panel.override_by_name(name, counted(state))
    return panel.text_mode(common.BigValueTextMode.VALUE_AND_NAME).span(WIDTH // 3)


def counted(state: palette.State) -> list[dashboard.DynamicConfigValue]:
    """Return an override: the word of a state, and its colour from one on."""
    colours = steps((None, palette.NOTHING), (1, state.colour)).build()
    return [
        dashboard.DynamicConfigValue("displayName", state.word),
        dashboard.DynamicConfigValue("thresholds", colours),
    ]


# --- Lines and bars over time ---


def graph(
    title: str, description: str, *queries: prometheus.Dataquery, unit: str = "short"
) -> timeseries.Panel:
    """Show lines over time."""
    return (
        timeseries.Panel()
        .title(title)
        .description(description)
        .datasource(DATASOURCE)
        .targets(list(queries))
        .unit(unit)
        .no_value(NO_DATA)
        .legend(legend())
        .tooltip(common_builders.VizTooltipOptions().mode(common.TooltipDisplayMode.MULTI))
        .line_width(1)
        .fill_opacity(5)
        .show_points(common.VisibilityMode.NEVER)
        .height(8)
        .span(WIDTH // 2)
    )


def stacked(panel: timeseries.Panel) -> timeseries.Panel:
    """Stack the lines of a graph as areas, with steps: what is counted has none between them."""
    stacking = common_builders.StackingConfig().mode(common.StackingMode.NORMAL)
    panel = panel.stacking(stacking).line_interpolation(common.LineInterpolation.STEP_AFTER)
    return panel.fill_opacity(80).line_width(0)


def timeline(title: str, description: str, *queries: prometheus.Dataquery) -> statetimeline.Panel:
    """Show a bar of states over time for each series."""
    return (
        statetimeline.Panel()
        .title(title)
        .description(description)
        .datasource(DATASOURCE)
        .targets(list(queries))
        .mappings(palette.state_mappings())
        # By thresholds Grafana would merge the values and ignore the colours of the mappings.
        .color_scheme(fixed(palette.UNDETERMINED_COLOUR))
        .show_value(common.VisibilityMode.NEVER)
        .merge_values(True)
        .row_height(0.85)
        .fill_opacity(90)
        .line_width(0)
        .legend(legend())
        .tooltip(common_builders.VizTooltipOptions().mode(common.TooltipDisplayMode.SINGLE))
        .height(10)
        .span(WIDTH)
    )


def legend() -> common_builders.VizLegendOptions:
    """Return a legend below the graph, so that the graph has the whole width of a phone."""
    return (
        common_builders.VizLegendOptions()
        .display_mode(common.LegendDisplayMode.LIST)
        .placement(common.LegendPlacement.BOTTOM)
        .show_legend(True)
        .calcs([])
    )


def bars(title: str, description: str, *queries: prometheus.Dataquery) -> bargauge.Panel:
    """Show a bar for each series, as long as its present value."""
    return (
        bargauge.Panel()
        .title(title)
        .description(description)
        .datasource(DATASOURCE)
        .targets(list(queries))
        .orientation(common.VizOrientation.HORIZONTAL)
        .display_mode(common.BarGaugeDisplayMode.BASIC)
        .reduce_options(common_builders.ReduceDataOptions().calcs(["lastNotNull"]))
        .color_scheme(fixed(palette.NEUTRAL))
        .height(8)
        .span(WIDTH // 2)
    )


# --- Colours ---


def fixed(colour: str) -> builders.FieldColor:
    """Return one colour for all values."""
    return builders.FieldColor().mode(dashboard.FieldColorModeId.FIXED).fixed_color(colour)


def by_thresholds() -> builders.FieldColor:
    """Return the colour of the threshold or mapping that a value matches."""
    return builders.FieldColor().mode(dashboard.FieldColorModeId.THRESHOLDS)


def series(name: str, colour: str) -> list[dashboard.DynamicConfigValue]:
    """Return an override: the name and colour of a series."""
    return [
        dashboard.DynamicConfigValue("displayName", name),
        fixed_colour(colour),
    ]


def fixed_colour(colour: str) -> dashboard.DynamicConfigValue:
    """Return an override's property: one colour for a series."""
    return dashboard.DynamicConfigValue("color", {"mode": "fixed", "fixedColor": colour})


def look(property_id: str, value: object) -> dashboard.DynamicConfigValue:
    """Return one property of an override."""
    return dashboard.DynamicConfigValue(property_id, value)


def steps(*starts: tuple[float | None, str]) -> builders.ThresholdsConfig:
    """Return thresholds: colours from a value on; the first has no value."""
    thresholds = [dashboard.Threshold(value, colour) for value, colour in starts]
    config = builders.ThresholdsConfig().mode(dashboard.ThresholdsMode.ABSOLUTE)
    return config.steps(thresholds)


def dashed(colour: str) -> list[dashboard.DynamicConfigValue]:
    """Return an override: a dashed line, for a limit."""
    return [
        fixed_colour(colour),
        dashboard.DynamicConfigValue("custom.lineStyle", {"fill": "dash", "dash": [10, 10]}),
        dashboard.DynamicConfigValue("custom.fillOpacity", 0),
    ]
