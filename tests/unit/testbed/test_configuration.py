"""A run's configuration is the shipped one, with this run's addresses and nothing else changed."""

from __future__ import annotations

import subprocess
from dataclasses import replace

import pytest
import yaml

from ros_diagnostics_exporter.config.load import load
from testbed import configuration

ADDRESSES = configuration.Addresses(*(f"127.0.0.1:{port}" for port in range(1, 6)))


@pytest.fixture
def configs(tmp_path):
    return configuration.write(tmp_path, 42, ADDRESSES, configuration.Clocks())


def test_prometheus_finds_this_runs_servers_under_the_shipped_jobs(configs):
    targets = configs.prometheus.parent / "targets"

    def listed(job: str) -> list[str]:
        return yaml.safe_load((targets / f"{job}.yml").read_text())[0]["targets"]

    assert listed("ros-diagnostics") == [ADDRESSES.exporter]
    assert listed("prometheus") == [ADDRESSES.prometheus]
    assert listed("alertmanager") == [ADDRESSES.alertmanager]


def test_rules_and_clocks_are_the_shipped_ones(configs):
    shipped = configuration.CHECKOUT / "prometheus"
    for path in shipped.rglob("*.yml"):
        if path.parent.name == "targets":
            continue
        copy = configs.prometheus.parent / path.relative_to(shipped)
        assert copy.read_text() == path.read_text()


def test_links_in_notifications_lead_to_this_runs_servers(configs):
    site = (configs.alertmanager.parent / "templates" / "site.tmpl").read_text()

    runbooks = f"http://{ADDRESSES.prometheus}/user/alerts"
    assert f'{{{{ define "site.runbooks_url" }}}}{runbooks}{{{{ end }}}}' in site
    assert f"Dashboard:  http://{ADDRESSES.grafana}" in site
    assert f'<a href="http://{ADDRESSES.grafana}' in site


def test_no_link_leads_to_a_grafana_that_is_not_there(tmp_path):
    addresses = replace(ADDRESSES, grafana="")
    configs = configuration.write(tmp_path, 42, addresses, configuration.Clocks())
    site = (configs.alertmanager.parent / "templates" / "site.tmpl").read_text()

    assert '{{ define "site.dashboard.text" }}{{ end }}' in site
    assert '{{ define "site.dashboard.html" }}{{ end }}' in site


def test_alertmanager_sends_to_this_runs_mail_server(configs):
    settings = yaml.safe_load(configs.alertmanager.read_text())

    assert settings["global"]["smtp_smarthost"] == ADDRESSES.smtp


@pytest.mark.parametrize("server", ["prometheus", "alertmanager"])
def test_the_servers_own_tools_accept_it(configs, server):
    argv = {
        "prometheus": ["promtool", "check", "config", configs.prometheus],
        "alertmanager": ["amtool", "check-config", configs.alertmanager],
    }[server]

    done = subprocess.run(argv, capture_output=True, text=True, check=False)

    assert done.returncode == 0, done.stdout + done.stderr


def test_a_shipped_configuration_that_lacks_what_is_edited_is_an_error(tmp_path, monkeypatch):
    checkout = tmp_path / "checkout"
    (checkout / "prometheus" / "rules").mkdir(parents=True)
    monkeypatch.setattr(configuration, "CHECKOUT", checkout)

    with pytest.raises(LookupError, match=r"targets/ros-diagnostics\.yml is no longer shipped"):
        configuration.write(tmp_path, 42, ADDRESSES, configuration.Clocks())


@pytest.mark.parametrize(("zenoh", "domains"), [("", (42,)), ("tcp/127.0.0.1:7447", ("zenoh",))])
def test_robots_are_received_from_their_domain_or_through_a_router(tmp_path, zenoh, domains):
    clocks = configuration.Clocks()
    configs = configuration.write(tmp_path, 42, ADDRESSES, clocks, zenoh)
    assert load(configs.fleet).domain_ids == domains
