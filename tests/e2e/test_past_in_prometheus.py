"""A recording in Prometheus' history: the fault is found by a query over the past."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from ros_diagnostics_tools.commands.backtest import main
from support.bags import BEGIN, every_second, write_bag
from support.prometheus_site import Site
from testbed import servers
from testbed.ports import free_port

STEP = 15.0
FLEET = "fleet: f\nrobots: [{name: r, namespace: /r, source: raw, labels: {site: hall}}]\n"


@pytest.fixture
def prometheus(tmp_path: Path):
    """A Prometheus that has never run, and has the blocks of a bag."""
    bag = write_bag(
        tmp_path / "bag", every_second(range(1200), {"motor": range(300, 900), "laser": []})
    )
    (tmp_path / "fleet.yml").write_text(FLEET)
    samples, blocks = tmp_path / "bag.om", tmp_path / "tsdb"
    done = main(
        ["--config.file", str(tmp_path / "fleet.yml"), "--openmetrics", str(samples), str(bag)]
    )
    assert done == 0
    subprocess.run(
        ["promtool", "tsdb", "create-blocks-from", "openmetrics", samples, blocks], check=True
    )
    (tmp_path / "prometheus.yml").write_text("scrape_configs: []\n")
    address = f"127.0.0.1:{free_port()}"
    retention = "--storage.tsdb.retention.time=50y"
    server = servers.prometheus(tmp_path, tmp_path / "prometheus.yml", address, retention)
    with servers.running(server):
        yield Site(address, "")


def test_a_fault_of_the_past_is_found_by_a_query(prometheus: Site):
    (series,) = prometheus.query_range(
        "ros_diagnostics_fault_start_timestamp_seconds", BEGIN, BEGIN + 1200, STEP
    )

    labels, values = series["metric"], series["values"]
    assert labels["component"] == "motor"
    assert (labels["state"], labels["site"]) == ("critical", "hall")
    assert {float(value) for _at, value in values} == {BEGIN + 300}
    confirmed, ended = BEGIN + 310, BEGIN + 900
    assert confirmed <= values[0][0] <= confirmed + 2 * STEP
    # Without a scrape that lacks the series, Prometheus looks back five minutes.
    assert ended <= values[-1][0] <= ended + 300 + STEP


def test_levels_and_values_are_there_with_the_labels_of_a_scrape(prometheus: Site):
    query = 'max_over_time(ros_diagnostics_component_level{job="ros-diagnostics"}[20m])'

    found = prometheus.query(query, BEGIN + 1200)

    levels = {each["metric"]["component"]: each["value"][1] for each in found}
    assert levels == {"motor": "2", "laser": "0"}
    assert prometheus.query('up{instance="backtest"}', BEGIN + 600)
