"""Annotations on all graphs of a dashboard."""

from __future__ import annotations

from grafana_foundation_sdk.builders import dashboard as builders
from grafana_foundation_sdk.models import dashboard

from fleet_dashboards.lib.panels import tidy
from fleet_dashboards.lib.variables import DATASOURCE


class _AnnotationQuery(dashboard.AnnotationQuery):
    """With the templates of Prometheus' data source, which the SDK's model does not know."""

    title_format = ""
    text_format = ""

    def to_json(self) -> dict[str, object]:
        formats = {"titleFormat": self.title_format, "textFormat": self.text_format}
        return {**super().to_json(), **formats}


class Annotation(builders.AnnotationQuery):
    """Mark the times at which ``expr`` has a value; title and text are templates of labels."""

    def __init__(self, name: str, expr: str, colour: str, title: str, text: str) -> None:
        super().__init__()
        self._internal = _AnnotationQuery()
        self._internal.title_format = title
        self._internal.text_format = text
        self.name(name).expr(tidy(expr)).icon_color(colour).datasource(DATASOURCE).enable(True)
