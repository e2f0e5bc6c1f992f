"""Every kind of alert as Prometheus sends it: from the expectations of the promtool tests."""

import re
from typing import Any

from support.shipped_rules import PROMTOOL_TESTS, read_yaml

SINCE = "2026-01-12 03:04:05.25 +0000 UTC"
BEGAN, ENDED = "2026-01-12T03:04:15Z", "2026-01-12T04:16:30Z"
ESCALATED = "2026-01-12T03:19:15Z"
ESCALATION = "RosDiagnosticsUnacknowledged"
# What tells one fault from another; escalation has these labels, and `since`.
STEPS = {"critical": ("1", "2"), "warning": ("0",)}


def every_alert() -> list[dict[str, Any]]:
    """One alert of each name, then the escalation or the reminder of each fault."""
    found: dict[str, dict[str, Any]] = {}
    for file in PROMTOOL_TESTS:
        for test in read_yaml(file)["tests"]:
            for check in test.get("alert_rule_test", ()):
                name = check["alertname"]
                if check["exp_alerts"] and name not in (*found, ESCALATION):
                    found[name] = _alert(name, check["exp_alerts"][0])
    faults = [each for each in found.values() if each["labels"].get("scope", "canary") != "canary"]
    exporter_down = {**found["RosDiagnosticsExporterDown"], "annotations": {}}
    labels = {**exporter_down["labels"], "of": exporter_down["labels"]["alertname"]}
    unresolved = [*faults, {**exporter_down, "labels": labels}]
    return [*found.values(), *(each for fault in unresolved for each in _steps(fault))]


def _alert(name: str, expected: dict[str, Any]) -> dict[str, Any]:
    texts = dict(expected.get("exp_annotations", {}))
    if "since" in texts:
        texts["since"] = SINCE
    if texts.get("evidence", "").startswith("since "):
        texts["evidence"] = re.sub("^since [^;]*", f"since {SINCE}", texts["evidence"])
    labels = {**expected["exp_labels"], "alertname": name}
    return {"labels": labels, "annotations": texts, "startsAt": BEGAN}


def _steps(fault: dict[str, Any]) -> list[dict[str, Any]]:
    texts = {"evidence": fault["annotations"].get("evidence", f"since {SINCE}")}
    if fault["labels"].get("component") and fault["labels"].get("robot"):
        texts["message"] = "drive switched off"
    of_exporter = "of" in fault["labels"]
    more = {"alertname": ESCALATION} | ({} if of_exporter else {"since": SINCE})
    return [
        {
            "labels": {**fault["labels"], **more, "step": step},
            "annotations": texts,
            "startsAt": ESCALATED,
        }
        for step in STEPS[fault["labels"]["severity"]]
    ]
