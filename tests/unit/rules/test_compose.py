"""compose.yaml runs what is shipped."""

from __future__ import annotations

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


def _read(path: str) -> dict[str, Any]:
    document: dict[str, Any] = yaml.safe_load((ROOT / path).read_text())
    return document
