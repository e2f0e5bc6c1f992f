"""Marks on all graphs of a dashboard."""

from __future__ import annotations

from grafana_foundation_sdk.builders import dashboard as builders
from grafana_foundation_sdk.models import dashboard

from fleet_dashboards.lib import palette
from fleet_dashboards.lib.panels import tidy
from fleet_dashboards.lib.variables import DATASOURCE
from fleet_dashboards.queries import robot as queries


class _Worded(dashboard.AnnotationQuery):
    """A mark with the words that Prometheus' data source makes from labels.

    The SDK's model does not know these keys of the data source.
    """

    title_format = ""
    text_format = ""

    def to_json(self) -> dict[str, object]:
        words = {"titleFormat": self.title_format, "textFormat": self.text_format}
        return {**super().to_json(), **words}


class _Mark(builders.AnnotationQuery):
    def __init__(self, name: str, expr: str, colour: str, title: str, text: str) -> None:
        super().__init__()
        self._internal = _Worded()
        self._internal.title_format = title
        self._internal.text_format = text
        self.name(name).expr(tidy(expr)).icon_color(colour).datasource(DATASOURCE).enable(True)


def state_changes() -> builders.AnnotationQuery:
    """Minutes in which the robot's state changed."""
    return _Mark(
        "State changes",
        queries.STATE_CHANGES,
        palette.NEUTRAL,
        "{{robot}} changed its state",
        "See the states of the components.",
    )


def told() -> builders.AnnotationQuery:
    """Times in which an alert of the robot fired, and so was told."""
    return _Mark(
        "Alerts told",
        queries.TOLD,
        palette.CRITICAL.colour,
        "{{alertname}}",
        "{{severity}}: {{component}}",
    )
