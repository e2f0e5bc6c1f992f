"""A run's configuration is the shipped one, with this run's addresses and nothing else changed."""

from dataclasses import replace

import pytest

from ros_diagnostics_exporter.config.load import load
from testbed import configuration

ADDRESSES = configuration.Addresses(*(f"127.0.0.1:{port}" for port in range(1, 6)))


@pytest.fixture
def configs(tmp_path):
    return configuration.write(tmp_path, 42, ADDRESSES, configuration.Clocks())


def test_links_in_notifications_lead_to_this_runs_servers(configs):
    site = (configs.alertmanager.parent / "templates" / "site.tmpl").read_text()

    exporter = f"http://{ADDRESSES.exporter}"
    assert f'{{{{ define "site.exporter_url" }}}}{exporter}{{{{ end }}}}' in site
    assert f"Dashboard:  http://{ADDRESSES.grafana}" in site
    assert f'<a href="http://{ADDRESSES.grafana}' in site


def test_no_link_leads_to_a_grafana_that_is_not_there(tmp_path):
    addresses = replace(ADDRESSES, grafana="")
    configs = configuration.write(tmp_path, 42, addresses, configuration.Clocks())
    site = (configs.alertmanager.parent / "templates" / "site.tmpl").read_text()

    assert '{{ define "site.dashboard.text" }}{{ end }}' in site
    assert '{{ define "site.dashboard.html" }}{{ end }}' in site


@pytest.mark.parametrize(("zenoh", "domains"), [("", (42,)), ("tcp/127.0.0.1:7447", ("zenoh",))])
def test_robots_are_received_from_their_domain_or_through_a_router(tmp_path, zenoh, domains):
    clocks = configuration.Clocks()
    configs = configuration.write(tmp_path, 42, ADDRESSES, clocks, zenoh)
    assert load(configs.fleet).domain_ids == domains


def test_robots_without_diagnostics_are_found_by_their_topics_where_these_are_received(tmp_path):
    sources = []
    for number, zenoh in enumerate(("", "tcp/127.0.0.1:7447")):
        folder = tmp_path / str(number)
        folder.mkdir()
        fleet = load(configuration.fleet(folder, 42, configuration.Clocks(), zenoh))
        sources.append({each.source.value for each in fleet.discoveries})
        assert fleet.name == configuration.FLEET
        assert (folder / "msg" / "ur_dashboard_msgs" / "SafetyMode.msg").is_file()
    assert ("none" in sources[0], "none" in sources[1]) == (True, False)
