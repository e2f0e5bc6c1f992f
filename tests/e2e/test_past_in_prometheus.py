"""The past in Prometheus: a recording's faults found by a query, a recording judged by queries."""

import json
import re
import shutil
from collections.abc import Iterator, Sequence

import pytest

from ros_diagnostics_tools.main import main
from support import host_checks
from support.bags import BEGIN, every_second, write_bag
from support.past import start_with
from testbed.configuration import CHECKOUT
from testbed.engine import Engine
from testbed.http import get
from testbed.site import Site

STEP = 15.0
FLEET = "fleet: f\nrobots: [{name: r, namespace: /r, source: raw, labels: {site: hall}}]\n"
# Another one, with the shipped queries of hosts: a robot behind an access point.
MEASURED = """\
fleet: hall
robots:
  - {name: r, namespace: /r, source: raw, labels: {uplink: ap}}
  - {name: ap, source: queries}
"""
QUERIES = CHECKOUT / "docs" / "examples" / "queries" / "queries.d"


@pytest.fixture
def prometheus(site: Site) -> Engine:
    """A Prometheus that has never run, and has the blocks of a bag."""
    failing = {"motor": range(300, 900), "laser": []}
    bag = write_bag(site.folder / "bag", every_second(range(1200), failing))
    config, samples = site.write("fleet.yml", FLEET), site.folder / "bag.om"
    assert main(["backtest", "--config", str(config), "--openmetrics", str(samples), str(bag)]) == 0
    return start_with(site, samples)


def test_a_fault_of_the_past_is_found_by_a_query(prometheus: Engine):
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
    levels = 'max_over_time(ros_diagnostics_component_level{job="ros-diagnostics"}[20m])'
    found = prometheus.query(levels, BEGIN + 1200)
    assert {each.labels["component"]: each.value for each in found} == {"motor": 2, "laser": 0}
    assert prometheus.query('up{instance="backtest"}', BEGIN + 600)


def measured(node: str, seconds: Sequence[int]) -> Iterator[str]:
    """What Prometheus would have scraped then, as OpenMetrics.

    Of node_exporter all samples that it has now, but a load of its own: 11 from 300 s to 500 s; of
    blackbox_exporter that the access point did not answer from 800 s to 1,000 s.
    """
    target = 'job="ros-diagnostics-node",fleet="hall",robot="r",instance="r:9100"'
    text = get(node, "/metrics").decode()
    for name, labels, value in re.findall(r"^(node_\w+)(?:{(.*)})? (\S+)$", text, re.MULTILINE):
        usual = "0.5" if name.startswith("node_load") else value
        for second in seconds:
            found = "11" if name == "node_load1" and 300 <= second < 500 else usual
            yield f"{name}{{{target}{labels and ','}{labels}}} {found} {BEGIN + second}\n"
    target = 'job="ros-diagnostics-uplink",fleet="hall",robot="ap",instance="ap"'
    for second in seconds:
        yield f"probe_success{{{target}}} {int(not 800 <= second < 1000)} {BEGIN + second}\n"
    for second in seconds:
        yield f'up{{job="ros-diagnostics-node",fleet="hall",robot="r"}} 1 {BEGIN + second}\n'
    yield "# EOF\n"


@pytest.mark.slow
def test_a_recording_is_judged_with_what_prometheus_had_measured_then(site: Site, capsys):
    received = [*range(800), *range(1010, 1200)]
    bag = write_bag(site.folder / "bag", every_second(received, {"motor": range(100, 150)}))
    config = site.write("fleet.yml", MEASURED)
    shutil.copytree(QUERIES, site.folder / "queries.d")
    own = ("--collector.disable-defaults", "--collector.loadavg", "--collector.filesystem")
    node, _blackbox = host_checks.start(site, *own)
    site.wait_until_ready()
    samples = site.write("measured.om", "".join(measured(node, range(0, 1200, 15))))

    def found(*arguments: str) -> dict[str, tuple[str, int, int]]:
        given = ("--config", str(config), "--output", "json", *arguments)
        assert main(["backtest", *given, str(bag)]) == 0
        return {
            each["component"] or each["state"]: (
                each["robot"],
                round(each["notified"] - BEGIN),
                round(each["ended"] - BEGIN),
            )
            for each in json.loads(capsys.readouterr().out)["notifications"]
            if not each["component"].startswith("disk")  # as full as this machine's
        }

    assert set(found()) == {"motor", "silent"}
    engine = start_with(site, samples)
    asked = found("--prometheus", f"http://{engine.address}")

    motor, load, uplink = asked.pop("motor"), asked.pop("load 1m"), asked.pop("uplink")
    assert asked == {}  # the silence is the uplink's, for which 800 s to 1,010 s
    assert motor == ("r", 110, 150)
    robot, notified, ended = load
    assert robot == "r"
    # Scraped every 15 s, asked as often, confirmed after a minute.
    assert 360 <= notified <= 390
    assert 500 <= ended <= 530
    robot, notified, ended = uplink
    assert robot == "ap"
    assert 820 <= notified <= 840  # confirmed after 20 s, before the silence would have been
    assert 1000 <= ended <= 1030
