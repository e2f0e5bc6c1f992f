"""docs/existing-servers.md: the dashboards, added to a Grafana that has others and a default."""

import json
from pathlib import Path
from typing import Any

import pytest

from e2e.dashboards.browser import NO_GRAFANA
from support.newcomer import Newcomer, blocks, newcomer
from testbed import grafana
from testbed.configuration import CHECKOUT

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(grafana.command() is None, reason=NO_GRAFANA),
]

DATA_SOURCES = """\
apiVersion: 1
datasources:
  - name: Production
    type: prometheus
    url: http://localhost:9090
    isDefault: true
"""
OWN = {"dashboard": {"title": "Sales", "uid": "sales", "panels": []}}
FOLDER, API = blocks("docs/existing-servers.md", "## Grafana")
ADMIN = "curl --silent --fail --user admin:admin http://localhost:3000/api"


def start(person: Newcomer) -> None:
    (person.home / "grafana").mkdir(exist_ok=True)
    command = " ".join(grafana.command() or [])
    person.starts(
        "grafana",
        "export GF_PATHS_DATA=~/grafana GF_PATHS_LOGS=~/grafana GF_PATHS_PLUGINS=~/plugins\n"
        "export GF_PATHS_PROVISIONING=/etc/grafana/provisioning\n"
        "export GF_ANALYTICS_REPORTING_ENABLED=false\n"
        f"exec {command}",
    )
    person.until_output("curl -s localhost:3000/api/health", '"database": "ok"', 120)


def asked(person: Newcomer, path: str) -> Any:
    return json.loads(person.does(f"{ADMIN}{path}"))


@pytest.mark.parametrize("way", ["folder", "API"])
def test_the_dashboards_are_beside_those_of_others(tmp_path: Path, way: str):
    with newcomer(tmp_path) as person:
        provisioning = tmp_path / "etc" / "grafana" / "provisioning"
        for name in ("dashboards", "datasources"):
            (provisioning / name).mkdir(parents=True)
        (provisioning / "datasources" / "own.yml").write_text(DATA_SOURCES)
        if way == "folder":
            person.does(FOLDER)
        start(person)
        json_ = "--header 'Content-Type: application/json'"
        # Grafana is healthy before it can save a dashboard.
        save = f"{ADMIN}/dashboards/db {json_} --data '{json.dumps(OWN)}'"
        person.until_output(save, '"status":"success"')
        if way == "API":
            person.does(API)
        names = {each.stem for each in (CHECKOUT / "grafana" / "dashboards").glob("*.json")}
        ours = '"uid":"ros-diagnostics-monitoring"'
        person.until_output(f"{ADMIN}/search?type=dash-db", ours)

        found = {each["uid"] for each in asked(person, "/search?type=dash-db")}
        assert found == names | {"sales"}
        (source,) = asked(person, "/datasources")
        assert (source["name"], source["isDefault"]) == ("Production", True)
        assert asked(person, "/org/preferences").get("homeDashboardUID", "") == ""
