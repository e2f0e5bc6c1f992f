"""What prometheus_operator.py writes: the shipped rules, as objects of its operator."""

import json
import re
from pathlib import Path
from typing import Any

import pytest
import yaml

import prometheus_operator
from support.shipped_rules import ALERTMANAGER, PROMETHEUS, RULE_FILES, run_tool


def objects(capsys: pytest.CaptureFixture[str], *arguments: str) -> list[dict[str, Any]]:
    assert prometheus_operator.main(arguments) == 0
    return list(yaml.safe_load_all(capsys.readouterr().out))


def with_runbooks(content: dict[str, Any], url: str) -> dict[str, Any]:
    """A copy of the rules, with the address of each alert's runbook."""
    copy: dict[str, Any] = json.loads(json.dumps(content))
    for rule in (rule for group in copy["groups"] for rule in group["rules"]):
        if "alert" in rule:
            rule.setdefault("annotations", {})["runbook_url"] = f"{url}/{rule['alert']}.html"
    return copy


def test_the_rules_come_back_with_their_runbooks(capsys, tmp_path: Path):
    found = objects(capsys, "--servers", "--runbooks=https://runbooks.example.org/")

    assert [each["metadata"]["name"] for each in found] == [
        f"ros-diagnostics-{path.stem}" for path in RULE_FILES
    ]
    for each, path in zip(found, RULE_FILES, strict=True):
        shipped = yaml.safe_load(path.read_text())
        assert each["spec"] == with_runbooks(shipped, "https://runbooks.example.org")
        copy = tmp_path / path.name
        copy.write_text(yaml.safe_dump({"groups": each["spec"]["groups"]}))
        run_tool("promtool", "check", "rules", copy)


def test_runbooks_are_by_default_where_the_mails_link_to(capsys):
    found = objects(capsys)
    (url,) = re.findall(
        r'"site.exporter_url" }}(.*?){{', (ALERTMANAGER / "templates" / "site.tmpl").read_text()
    )

    alerts = [
        (rule["alert"], rule["annotations"]["runbook_url"])
        for each in found
        for group in each["spec"]["groups"]
        for rule in group["rules"]
        if "alert" in rule
    ]
    assert alerts == [(name, f"{url}/runbooks/{name}.html") for name, _ in alerts]


def test_rules_about_the_servers_are_left_out(capsys):
    names = {each["metadata"]["name"] for each in objects(capsys)}

    assert "ros-diagnostics-faults" in names
    assert "ros-diagnostics-servers" not in names


def test_namespace_and_labels_are_on_every_object(capsys):
    found = objects(capsys, "--namespace=m", "--label=release=prom", "--target=e:9877")

    assert all(each["metadata"]["namespace"] == "m" for each in found)
    assert all(each["metadata"]["labels"] == {"release": "prom"} for each in found)


def test_exporters_are_scraped_as_in_prometheus_yml(capsys):
    found = objects(capsys, "--target=a:9877", "--target=b:9877")
    scrapes = {
        each["metadata"]["name"]: each["spec"] for each in found if each["kind"] == "ScrapeConfig"
    }

    config = yaml.safe_load((PROMETHEUS / "prometheus.yml").read_text())
    shipped = {each["job_name"]: each for each in config["scrape_configs"]}
    assert scrapes.keys() == {"ros-diagnostics-faults", "ros-diagnostics"}
    for name, spec in scrapes.items():
        interval = shipped[name].get("scrape_interval", config["global"]["scrape_interval"])
        assert spec["scrapeInterval"] == interval
        assert spec["params"] == shipped[name]["params"]
        assert spec["honorLabels"] is shipped[name]["honor_labels"] is True
        assert spec["staticConfigs"] == [{"targets": ["a:9877", "b:9877"]}]


def test_a_wrong_label_is_rejected(capsys):
    with pytest.raises(SystemExit):
        prometheus_operator.main(["--label=release"])
    assert "'release' is not NAME=VALUE" in capsys.readouterr().err
