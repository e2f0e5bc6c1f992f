"""Expressions of the dashboards are valid PromQL; their metrics and labels exist."""

import re
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

from ros_diagnostics_exporter.metrics.self_metrics import ALL_FAMILIES
from support.called import called
from support.committed_dashboards import ROOT, Query, filled, queries

QUERIES = list(queries())
FAMILIES = {family.name: family for family in ALL_FAMILIES}
RECORDED = {
    rule["record"]
    for path in (ROOT / "prometheus" / "rules").glob("*.yml")
    for group in yaml.safe_load(path.read_text())["groups"]
    for rule in group["rules"]
    if "record" in rule
}
# Metrics of Prometheus, Alertmanager, blackbox_exporter and node_exporter.
FOREIGN = re.compile(
    r"up|ALERTS(_FOR_STATE)?|(process|prometheus|alertmanager|probe|scrape|node)_\w+"
)
HISTOGRAM = re.compile(r"_(bucket|count|sum)$")
HISTOGRAMS = {name for name, family in FAMILIES.items() if family.type == "histogram"}
KEYWORDS = re.compile(
    r"and|or|unless|bool|offset|on|ignoring|group_left|group_right|by|without|inf|nan",
    re.IGNORECASE,
)
MATCHER = re.compile(r"(\w+)\s*(?:=~|!~|!=|=)")


def metric_names(expr: str) -> set[str]:
    """The names of series in an expression: what is no string, label, keyword or function."""
    bare = re.sub(r'"(?:\\.|[^"\\])*"|`[^`]*`', '""', expr)
    bare = re.sub(r"\{[^}]*\}|\[[^\]]*\]", " ", bare)
    bare = re.sub(r"\b(by|without|on|ignoring|group_left|group_right)\s*\([^)]*\)", " ", bare)
    found = re.finditer(r"(?<![\w:.])([A-Za-z_:][\w:]*)(\s*\()?", bare)
    return {name[1] for name in found if not name[2] and not KEYWORDS.fullmatch(name[1])}


def selectors(expr: str) -> Iterator[tuple[str, str]]:
    """Pairs of a metric's name and its matchers."""
    yield from re.findall(r'([A-Za-z_:][\w:]*)\{((?:[^}"]|"(?:\\.|[^"\\])*")*)\}', expr)


@pytest.mark.parametrize("query", QUERIES, ids=str)
def test_metrics_and_recorded_series_exist(query: Query):
    names = metric_names(filled(query.expr))

    assert names or "__name__" in query.expr, "no metric"
    unknown = {name for name in names if name not in FAMILIES and name not in RECORDED}
    unknown -= {name for name in unknown if HISTOGRAM.sub("", name) in HISTOGRAMS}
    assert all(FOREIGN.fullmatch(name) for name in unknown), unknown


@pytest.mark.parametrize("query", QUERIES, ids=str)
def test_matchers_use_labels_that_the_metric_has(query: Query):
    for name, matchers in selectors(filled(query.expr)):
        family = FAMILIES.get(name)
        if family is not None and not family.open:
            assert set(MATCHER.findall(matchers)) <= {*family.labels, "job", "instance"}, name


def test_metric_names_and_selectors_of_an_expression_are_found():
    """The tests above do not check what these functions overlook."""
    expr = """
      sum by (robot, le) (rate(a_total{x="y(z)", m=~"n"}[5m])) / on (robot) group_left (site)
      label_replace(b:c:rank == 2 or vector(0), "to", "$1", "from", "(.*)") unless d_info
    """

    assert metric_names(expr) == {"a_total", "b:c:rank", "d_info"}
    assert list(selectors(expr)) == [("a_total", 'x="y(z)", m=~"n"')]


def test_promtool_accepts_every_expression(tmp_path: Path):
    promtool = shutil.which("promtool")
    if promtool is None:
        pytest.skip("promtool is not installed")
    rules = [
        {"record": f"query:{number}:{query.ref}", "expr": filled(query.expr)}
        for number, query in enumerate(QUERIES)
    ]
    file = tmp_path / "queries.yml"
    file.write_text(yaml.safe_dump({"groups": [{"name": "queries", "rules": rules}]}))

    called([promtool, "check", "rules", file], timeout=60)
