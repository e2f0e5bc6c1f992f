"""compose.yaml runs what is shipped."""

from typing import Any

import yaml

from support.shipped_rules import ROOT

HOSTS = {"ros-diagnostics-node", "ros-diagnostics-ping"}  # comments of the shipped one


def test_the_prometheus_of_compose_has_the_shipped_configuration_and_jobs_of_hosts():
    shipped = _read("prometheus/prometheus.yml")
    composed = _read("packaging/compose/prometheus.yml")
    jobs = {job["job_name"]: job for job in composed["scrape_configs"]}

    assert jobs.keys() - {job["job_name"] for job in shipped["scrape_configs"]} == HOSTS
    composed["scrape_configs"] = [job for name, job in jobs.items() if name not in HOSTS]
    assert composed == shipped


def test_every_server_of_compose_is_for_this_machine_alone():
    services = _read("compose.yaml")["services"]
    open_to_all = [
        name
        for name, service in services.items()
        if name != "robots"
        and "127.0.0.1" not in str([service.get("command"), service.get("environment")])
    ]
    assert open_to_all == []


def test_compose_and_kubernetes_show_how_to_ask_for_a_login():
    for path in ("compose.yaml", "packaging/kubernetes/base/exporter.yaml"):
        assert "--web.config.file=" in (ROOT / path).read_text()


def _read(path: str) -> dict[str, Any]:
    document: dict[str, Any] = yaml.safe_load((ROOT / path).read_text())
    return document
