"""Every alert has a runbook and a promtool test; settings, records and metrics are all used."""

import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from ros_diagnostics_exporter.metrics.self_metrics import ALL_FAMILIES
from support.alert_steps import steps_left, steps_left_to_hold
from support.shipped_rules import (
    PROMETHEUS,
    ROOT,
    RULE_FILES,
    alerts,
    read_yaml,
    rules,
    run_tool,
)

PAGES = {page.stem: page for page in (ROOT / "docs" / "alerts").glob("*.md")}
HEADINGS = ["Meaning", "Impact", "Do this now", "If that does not help", "Prevent"]
SCREEN = 50  # lines
OF_PARTS = "RosDiagnosticsExporterFault"
CONTRIBUTING = (ROOT / "CONTRIBUTING.md").read_text()
SEVERITIES = {"critical", "warning", "info"}
ESCALATION = {"RosDiagnosticsUnacknowledged"}
RECORD = re.compile(r"\b\w+:ros_diagnostics\w*:\w+|\bros_diagnostics:\w+:\w+")


def every_alert() -> list[Any]:
    return [pytest.param(name, rule, id=name) for name, found in alerts().items() for rule in found]


def test_every_alert_has_a_runbook_and_every_runbook_an_alert():
    built = {"RosDiagnosticsOnCallEnds"}  # the rule is written by ros-diagnostics oncall
    assert set(PAGES) - set(alerts()) == built, "docs/alerts: remove the runbooks without an alert"


@pytest.mark.parametrize("name", sorted(alerts()))
def test_an_alert_has_all_that_contributing_asks_for(name: str):
    missing = steps_left(name)
    assert not missing, "\n".join(missing)


@pytest.mark.parametrize("name", sorted(PAGES))
def test_runbook_is_one_screen_with_all_headings(name: str):
    text = PAGES[name].read_text()

    assert text.startswith(f"# {name}\n")
    assert re.findall(r"^## (.*)$", text, re.MULTILINE) == HEADINGS
    assert text.count("\n") <= SCREEN


def test_the_runbook_of_the_exporter_has_the_first_step_of_each_part_word_for_word():
    rows = re.findall(r"^\| (`.*?) \| .* \| (.*) \|$", PAGES[OF_PARTS].read_text(), re.MULTILINE)
    words = (ROOT / "alertmanager" / "templates" / "words.tmpl").read_text()

    assert len(rows) == 12
    assert not [part for part, step in rows if f"}}}}{step}\n" not in words]


@pytest.mark.parametrize("name", sorted(PAGES))
def test_a_runbook_is_a_list_of_numbered_steps(name: str):
    section = PAGES[name].read_text().partition("## Do this now\n\n")[2].partition("\n## ")[0]
    steps = re.findall(r"^(\d)\. ", section, re.MULTILINE)

    assert steps == [str(number) for number in range(1, len(steps) + 1)]
    assert all(line.startswith((" ", *steps)) for line in section.splitlines() if line)


def test_promtool_accepts_the_queries_of_the_runbooks(tmp_path: Path):
    lines = [
        line.strip()
        for page in PAGES.values()
        for block in re.findall(r"```promql\n(.*?)\n *```", page.read_text(), re.DOTALL)
        for line in block.splitlines()
    ]
    checked = tmp_path / "queries.yml"
    queries = [{"record": f"page:query:line{n}", "expr": line} for n, line in enumerate(lines)]
    checked.write_text(yaml.safe_dump({"groups": [{"name": "pages", "rules": queries}]}))

    assert f"SUCCESS: {len(lines)} rules found" in run_tool("promtool", "check", "rules", checked)


@pytest.mark.parametrize(("name", "rule"), every_alert())
def test_an_alert_has_a_severity_and_a_summary(name: str, rule: dict[str, Any]):
    """A fault's severity is the exporter's; escalation takes its texts from its labels."""
    assert name.startswith("RosDiagnostics")
    if "severity" not in rule.get("labels", {}):
        assert re.search(r"fleet:ros_diagnostics_(fault|unresolved)", rule["expr"])
    else:
        assert rule["labels"]["severity"] in SEVERITIES
    if name not in ESCALATION:
        assert rule["annotations"]["summary"].endswith(".")
        assert "\n" not in rule["annotations"]["summary"]


@pytest.mark.parametrize(("name", "rule"), every_alert())
def test_an_alert_queries_nothing_and_blanks_only_what_changes_while_it_fires(name, rule):
    texts = [*rule.get("annotations", {}).values(), *rule.get("labels", {}).values()]

    assert not [text for text in texts if re.search(r"\bquery\b", text)]
    assert {label for label, text in rule.get("labels", {}).items() if text == ""} <= {
        "evidence",
        "robots",
    }


@pytest.mark.parametrize(("name", "rule"), every_alert())
def test_the_alert_of_a_fault_has_two_texts_and_no_label(name: str, rule: dict[str, Any]):
    """Each costs time at each evaluation where thousands of faults last, also without `{{`."""
    if "severity" not in rule.get("labels", {}) and name not in ESCALATION:
        assert "labels" not in rule
        assert set(rule["annotations"]) == {"evidence", "summary"}


def test_no_alert_reads_the_history_for_dashboards():
    """A site without dashboards and reports leaves those files out."""
    of_file = {
        path.name: [
            rule for group in yaml.safe_load(path.read_text())["groups"] for rule in group["rules"]
        ]
        for path in RULE_FILES
    }
    history = {"states.yml", "availability.yml", "missions.yml"}
    recorded = {rule["record"] for name in history for rule in of_file[name]}
    others = [rule for name, found in of_file.items() if name not in history for rule in found]
    assert recorded
    for rule in others:
        assert recorded.isdisjoint(RECORD.findall(rule["expr"])), rule
    assert {rule.get("record") for rule in others}.isdisjoint(recorded)


def read_from_exporters() -> list[Any]:
    """The alerts that an exporter's own metrics are for, not those about its absence."""
    absence = {f"RosDiagnosticsExporter{what}" for what in ("Down", "NeverAnswered")}
    return [
        pytest.param(rule["alert"], rule["expr"], id=rule["alert"])
        for group in read_yaml(PROMETHEUS / "rules" / "monitoring.yml")["groups"]
        for rule in group["rules"]
        if "alert" in rule and rule["alert"] not in absence
    ]


@pytest.mark.parametrize(("name", "expr"), read_from_exporters())
def test_an_alert_is_held_while_what_it_is_about_does_not_answer(name: str, expr: str):
    missing = steps_left_to_hold(name, expr)
    assert not missing, "\n".join(missing)


def test_who_adds_an_alert_reads_which_steps_of_contributing_are_missing():
    name = "RosDiagnosticsExporterHot"
    left = [*steps_left_to_hold(name, "temperature > 60"), *steps_left(name)]

    places, steps = zip(*(each.split(": ", 1) for each in left), strict=True)
    assert places == (
        *["prometheus/rules/monitoring.yml"] * 2,
        f"docs/alerts/{name}.md",
        "alertmanager/templates/words.tmpl",
        "prometheus/tests/",
    )
    assert [step.split()[0] for step in steps] == ["let", "name", "write", "repeat", "add"]
    section = CONTRIBUTING.partition("## Add an alert")[2].partition("\n## ")[0]
    for place in places:
        assert f"`{place.replace(name, 'NAME')}`" in section


def test_no_expression_is_a_yaml_alias():
    """Prometheus takes an alias there for the name of a metric."""
    for file in RULE_FILES:
        assert not re.search(r"^ *expr: [*]", file.read_text(), re.MULTILINE), file


def test_rules_use_only_metrics_of_the_exporter():
    families = {family.name for family in ALL_FAMILIES}
    read = {
        name
        for file in RULE_FILES
        for name in re.findall(r"(?<![\w:])ros_diagnostics_\w+(?!:)\b", file.read_text())
    }

    assert read <= families
    assert read


def test_rules_use_only_series_that_are_recorded():
    recorded = {rule["record"] for rule in rules() if "record" in rule}
    read = {name for rule in rules() for name in RECORD.findall(rule["expr"])}

    by_a_person = {"exporter:ros_diagnostics_exporter:removed"}  # docs/alerts.md
    assert read <= recorded | by_a_person
