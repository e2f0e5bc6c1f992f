"""The provisioning files and grafana.ini fit the dashboards."""

import configparser
from pathlib import PurePosixPath
from typing import Any

import yaml

from support.committed_dashboards import BOARDS, GRAFANA
from support.shipped_rules import PROMETHEUS


def provisioned(kind: str) -> list[dict[str, Any]]:
    document = yaml.safe_load((GRAFANA / "provisioning" / kind / "ros-diagnostics.yml").read_text())
    assert document["apiVersion"] == 1
    found: list[dict[str, Any]] = document["providers" if kind == "dashboards" else kind]
    return found


def settings() -> configparser.ConfigParser:
    found = configparser.ConfigParser()
    found.read(GRAFANA / "grafana.ini")
    return found


def test_prometheus_is_the_default_data_source_and_linked_to_alertmanager():
    sources = {source["type"]: source for source in provisioned("datasources")}

    assert sources["prometheus"]["isDefault"]
    linked = sources["prometheus"]["jsonData"]["alertmanagerUid"]
    assert linked == sources["alertmanager"]["uid"]


def test_a_rate_is_over_at_least_four_scrapes():
    """Grafana makes $__rate_interval four times timeInterval: over less a graph is loose dots."""
    (source,) = (each for each in provisioned("datasources") if each["type"] == "prometheus")
    config = yaml.safe_load((PROMETHEUS / "prometheus.yml").read_text())

    assert source["jsonData"]["timeInterval"] == config["global"]["scrape_interval"]


def test_the_home_dashboard_is_one_that_the_provider_reads():
    (provider,) = provisioned("dashboards")
    home = PurePosixPath(settings()["dashboards"]["default_home_dashboard_path"])

    assert home.parent == PurePosixPath(provider["options"]["path"])
    assert home.stem in BOARDS


def test_anonymous_access_is_disabled_by_default():
    anonymous = settings()["auth.anonymous"]

    assert anonymous.getboolean("enabled") is False
    assert anonymous["org_role"] == "Viewer"


def test_the_days_of_dashboards_are_those_of_the_time_zone_that_grafana_has():
    """One of its own would keep a dashboard from that of the site."""
    assert {board["timezone"] for board in BOARDS.values()} == {""}
    assert settings()["date_formats"]["default_timezone"] == "browser"
