"""The steps of "Add an alert" in CONTRIBUTING.md that an alert lacks, as sentences."""

import re
from collections.abc import Iterator

from support.shipped_rules import PROMTOOL_TESTS, ROOT, read_yaml, rules

HELD = "fleet:ros_diagnostics_alert:held"
# The first step depends on what the alert is about: the fault, or which part; the mail has it.
OF_ANOTHER = {"RosDiagnosticsUnacknowledged", "RosDiagnosticsExporterFault"}
ALWAYS_FIRES = {"RosDiagnosticsWatchdog"}


def steps_left(name: str) -> list[str]:
    """What an alert of this name lacks of what every alert has."""
    return [*_of_its_runbook(name), *_of_its_test(name)]


def steps_left_to_hold(name: str, expr: str) -> list[str]:
    """What an alert about an exporter lacks to go on while the exporter does not answer."""
    return list(_of_its_hold(name, expr))


def _of_its_hold(name: str, expr: str) -> Iterator[str]:
    end = f'or ignoring (alertname, severity) {HELD}{{alertname="{name}"}}'
    # More labels to ignore are those that only annotations need.
    if not re.sub(r"(?<=severity)(, \w+)+(?=\) \S+$)", "", expr.rstrip()).endswith(end):
        yield f"prometheus/rules/monitoring.yml: let the expr of {name} end with `{end}`"
    [record] = [each["expr"] for each in rules() if each.get("record") == HELD]
    kinds = re.findall(r'ALERTS\{alertname=~"(.*?)"', record)
    if len([kind for kind in kinds if re.fullmatch(kind, name)]) != 1:
        yield f"prometheus/rules/monitoring.yml: name {name} in one `ALERTS` of the record {HELD}"


def _of_its_runbook(name: str) -> Iterator[str]:
    page = ROOT / "docs" / "alerts" / f"{name}.md"
    if not page.exists():
        yield f"docs/alerts/{name}.md: write the runbook, with the sections of the others"
    words = (ROOT / "alertmanager" / "templates" / "words.tmpl").read_text()
    if name not in OF_ANOTHER and f"}}}}{first_step(name)}\n" not in words:
        yield f"alertmanager/templates/words.tmpl: repeat the first step of {name}'s runbook there"


def first_step(name: str) -> str:
    """The first step of the runbook, in one line; a word if there is none."""
    page = ROOT / "docs" / "alerts" / f"{name}.md"
    text = page.read_text() if page.exists() else ""
    steps = text.partition("## Do this now\n\n1. ")[2]
    return " ".join(re.split(r"\n\n|\n2\. ", steps)[0].split()) or "missing"


def _of_its_test(name: str) -> Iterator[str]:
    firing = [
        [bool(c["exp_alerts"]) for c in test.get("alert_rule_test", ()) if c["alertname"] == name]
        for file in PROMTOOL_TESTS
        for test in read_yaml(file)["tests"]
    ]
    shown = any(when[:1] == [False] and when[-1:] == [False] and any(when) for when in firing)
    if name not in ALWAYS_FIRES and not shown:
        yield f"prometheus/tests/: add a test in which {name} does not fire, fires, and resolves"
