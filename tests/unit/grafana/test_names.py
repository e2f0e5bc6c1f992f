"""What the dashboards ask for exists: metrics, recorded series, labels; and it is PromQL."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

from ros_diagnostics_exporter.metrics.self_metrics import ALL_FAMILIES
from support.committed_dashboards import BOARDS, ROOT, Question, filled, questions

QUESTIONS = list(questions())
FAMILIES = {family.name: family for family in ALL_FAMILIES}
RECORDED = {
    rule["record"]
    for path in (ROOT / "prometheus" / "rules").glob("*.yml")
    for group in yaml.safe_load(path.read_text())["groups"]
    for rule in group["rules"]
    if "record" in rule
}
# Of Prometheus, Alertmanager, blackbox_exporter and node_exporter themselves.
FOREIGN = re.compile(
    r"up|ALERTS(_FOR_STATE)?|(process|prometheus|alertmanager|probe|scrape|node)_\w+"
)
WORDS = re.compile(
    r"and|or|unless|bool|offset|on|ignoring|group_left|group_right|by|without|inf|nan",
    re.IGNORECASE,
)
MATCHER = re.compile(r"(\w+)\s*(?:=~|!~|!=|=)")


def metric_names(expr: str) -> set[str]:
    """The names of series in an expression: what is no string, label, word or function."""
    bare = re.sub(r'"(?:\\.|[^"\\])*"', '""', expr)
    bare = re.sub(r"\{[^}]*\}|\[[^\]]*\]", " ", bare)
    bare = re.sub(r"\b(by|without|on|ignoring|group_left|group_right)\s*\([^)]*\)", " ", bare)
    found = re.finditer(r"(?<![\w:.])([A-Za-z_:][\w:]*)(\s*\()?", bare)
    return {name[1] for name in found if not name[2] and not WORDS.fullmatch(name[1])}


def selectors(expr: str) -> Iterator[tuple[str, str]]:
    """Pairs of a metric's name and what stands in its braces."""
    yield from re.findall(r'([A-Za-z_:][\w:]*)\{((?:[^}"]|"(?:\\.|[^"\\])*")*)\}', expr)


@pytest.mark.parametrize("question", QUESTIONS, ids=str)
def test_metrics_and_recorded_series_exist(question: Question):
    names = metric_names(filled(question.expr))

    assert names, "asks for no metric"
    unknown = {name for name in names if name not in FAMILIES and name not in RECORDED}
    assert all(FOREIGN.fullmatch(name) for name in unknown), unknown


@pytest.mark.parametrize("question", QUESTIONS, ids=str)
def test_a_metric_is_filtered_by_labels_that_it_has(question: Question):
    for name, inside in selectors(question.expr):
        family = FAMILIES.get(name)
        if family is not None and not family.open:
            assert set(MATCHER.findall(inside)) <= {*family.labels, "job", "instance"}, name


def test_the_names_of_an_expression_are_found():
    """The reader of expressions above is worth a test: what it overlooks nobody checks."""
    expr = """
      sum by (robot, le) (rate(a_total{x="y(z)", m=~"n"}[5m])) / on (robot) group_left (site)
      label_replace(b:c:rank == 2 or vector(0), "to", "$1", "from", "(.*)") unless d_info
    """

    assert metric_names(expr) == {"a_total", "b:c:rank", "d_info"}
    assert list(selectors(expr)) == [("a_total", 'x="y(z)", m=~"n"')]


def test_promtool_reads_every_expression(tmp_path: Path):
    promtool = shutil.which("promtool")
    if promtool is None:
        pytest.skip("promtool is not installed")
    rules = [
        {"record": f"question:{number}:{question.ref}", "expr": filled(question.expr)}
        for number, question in enumerate(QUESTIONS)
    ]
    file = tmp_path / "questions.yml"
    file.write_text(yaml.safe_dump({"groups": [{"name": "questions", "rules": rules}]}))

    said = subprocess.run(
        [promtool, "check", "rules", file], capture_output=True, text=True, timeout=60, check=False
    )

    assert said.returncode == 0, said.stdout + said.stderr


def test_links_in_alerts_lead_to_dashboards_and_variables_that_exist():
    urls = {
        rule["annotations"]["dashboard_url"]
        for path in (ROOT / "prometheus" / "rules").glob("*.yml")
        for group in yaml.safe_load(path.read_text())["groups"]
        for rule in group["rules"]
        if "dashboard_url" in rule.get("annotations", {})
    }
    assert urls

    for url in urls:
        board = BOARDS[re.search(r"/d/([\w-]+)", url)[1]]
        variables = {each["name"] for each in board["templating"]["list"]}
        assert set(re.findall(r"[?&]var-(\w+)=", url)) <= variables, url
