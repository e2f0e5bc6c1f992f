"""The pieces of docs/existing-servers.md are accepted by amtool, and are what is shipped."""

import re
from pathlib import Path
from typing import Any

import yaml

from support import existing_site
from support.shipped_rules import ALERTMANAGER, ROOT, RULE_FILES, run_tool

PAGE = (ROOT / "docs" / "existing-servers.md").read_text()
SHIPPED = yaml.safe_load((ALERTMANAGER / "alertmanager.yml").read_text())


def piece(key: str) -> Any:
    found = re.search(rf"```yaml\n# alertmanager.yml, under {key}:\n(.*?)```", PAGE, re.DOTALL)
    assert found
    return yaml.safe_load(found[1])


def test_the_routes_are_those_that_are_shipped():
    (route,) = piece("routes")
    for key in ("group_by", "group_wait", "group_interval", "repeat_interval"):
        assert route[key] == SHIPPED["route"][key]
    ours, shipped = (
        [each.get("matchers") for each in routes]
        for routes in (route["routes"], SHIPPED["route"]["routes"])
    )
    assert ours == shipped  # the last one of both takes all


def test_mails_and_inhibition_are_those_that_are_shipped():
    receivers = {each["name"]: each for each in piece("receivers")}
    [canary] = [each for each in SHIPPED["receivers"] if each["name"] == "canary"]
    assert receivers.pop("robots-canary")["webhook_configs"] == canary["webhook_configs"]
    ours = {name: each.get("email_configs") for name, each in receivers.items()}
    shipped = {each["name"]: each.get("email_configs") for each in SHIPPED["receivers"]}

    assert ours == {
        "robots-none": None,
        "robots": shipped["email"],
        "robots-reminder": shipped["reminder"],
        "robots-escalation-1": shipped["escalation-1"],
        "robots-escalation-2": shipped["escalation-2"],
    }
    assert piece("inhibit_rules") == SHIPPED["inhibit_rules"]


def test_amtool_finds_the_receiver_that_the_page_names(tmp_path: Path):
    config = tmp_path / "alertmanager.yml"
    own = {"receiver": "robots-none", "routes": piece("routes")}
    content = {"route": own, "receivers": piece("receivers")}
    content["inhibit_rules"] = piece("inhibit_rules")
    content["global"] = SHIPPED["global"]
    config.write_text(yaml.safe_dump(content))

    run_tool("amtool", "check-config", config)
    found = re.search(
        r"`amtool (config routes test) --config.file=\S+ (.*?)`\nprints `(.*?)`", PAGE
    )
    assert found
    route = f"--config.file={config}"
    assert run_tool("amtool", *found[1].split(), route, *found[2].split()) == f"{found[3]}\n"


def test_each_inhibition_of_a_site_is_exempted_on_both_sides():
    given = existing_site.ALERTMANAGER.format(smtp="localhost:25")
    theirs = len(yaml.safe_load(given)["inhibit_rules"])
    rules = yaml.safe_load(existing_site.added(given, "alertmanager.yml"))["inhibit_rules"]

    for rule in rules[len(rules) - theirs :]:
        for side in ("source_matchers", "target_matchers"):
            assert rule[side][-1] == 'alertname !~ "RosDiagnostics.+|Robot.+"', rule


def series(metric: str, **labels: str) -> str:
    pairs = ", ".join(f'{name}="{value}"' for name, value in labels.items())
    return f"{metric}{{{pairs}}}"


def firing(name: str) -> str:
    return series("ALERTS", alertname=f"RosDiagnostics{name}", alertstate="firing")


def test_labels_of_the_target_come_to_faults_and_to_an_exporter_that_is_down(tmp_path: Path):
    """The target's label is changed within the hour in which the exporter goes away: one alert."""
    target = {"env": "prod", "job": "j", "instance": "e"}
    before = target | {"env": "test"}
    fault = {"fault": "1", "scope": "component", "state": "critical", "severity": "critical"}
    was_settled, settled = (
        series("ros_diagnostics_exporter_settled", fleet="f", **each) for each in (before, target)
    )
    start = series("ros_diagnostics_fault_start_timestamp_seconds", fleet="f", **fault, **target)
    test = {
        "interval": "5s",
        "input_series": [
            {"series": series("up", **before), "values": "1x12 stale"},
            {"series": series("up", **target), "values": "_x13 1x12 0x40 stale"},
            {"series": was_settled, "values": "1x12 stale"},
            {"series": settled, "values": "_x13 1x12 stale"},
            {"series": start, "values": "_x13 5x12 stale"},
        ],
        "promql_expr_test": [
            {
                "expr": f"count by (fleet, env) ({firing(name)})",
                "exp_samples": [{"labels": series("", fleet="f", env="prod"), "value": 1}],
                "eval_time": when,
            }
            for name in ("ComponentCritical", "ExporterDown")
            # The exporter does not answer, and is no target any more.
            for when in ("4m", "6m")
        ],
    }
    files = [str(each) for each in RULE_FILES]
    content = {"rule_files": files, "evaluation_interval": "5s", "tests": [test]}
    (tmp_path / "test.yml").write_text(yaml.safe_dump(content))

    run_tool("promtool", "test", "rules", tmp_path / "test.yml")
