"""Grafana is started with the shipped dashboards and this run's servers."""

from pathlib import Path

import pytest
import yaml

from testbed import configuration, grafana

ADDRESSES = configuration.Addresses(*(f"127.0.0.1:{port}" for port in range(1, 6)))


@pytest.fixture
def install(tmp_path, monkeypatch):
    """A function: puts an executable with this path into PATH, and nothing else."""

    def install(path: str) -> Path:
        binary = tmp_path / path
        binary.parent.mkdir(parents=True, exist_ok=True)
        binary.touch(mode=0o755)
        monkeypatch.setenv("PATH", str(binary.parent))
        monkeypatch.delenv("GRAFANA", raising=False)
        return binary

    return install


def test_a_packages_pages_are_in_usr_share(install, monkeypatch, tmp_path):
    binary = install("bin/grafana")
    monkeypatch.setattr(grafana, "PACKAGED_HOME", tmp_path / "share")

    assert grafana.command() == [str(binary), "server", f"--homepath={tmp_path / 'share'}"]


def test_a_packages_script_is_skipped(install, tmp_path, monkeypatch):
    install("usr/sbin/grafana")
    monkeypatch.setattr(grafana, "PACKAGED_HOME", tmp_path / "share")
    binary = tmp_path / "share" / "bin" / "grafana"
    binary.parent.mkdir(parents=True)
    binary.touch(mode=0o755)

    assert grafana.command() == [str(binary), "server", f"--homepath={tmp_path / 'share'}"]


def test_an_unpacked_archive_has_its_pages_beside_the_binary(install, tmp_path):
    binary = install("grafana-9/bin/grafana-server")
    (tmp_path / "grafana-9" / "conf").mkdir()
    (tmp_path / "grafana-9" / "conf" / "defaults.ini").touch()

    assert grafana.command() == [str(binary), f"--homepath={tmp_path / 'grafana-9'}"]


def test_the_provisioning_has_this_runs_servers_and_the_shipped_dashboards(tmp_path):
    grafana.write_provisioning(tmp_path / "provisioning", ADDRESSES)

    sources = yaml.safe_load(
        (tmp_path / "provisioning/datasources/ros-diagnostics.yml").read_text()
    )
    boards = yaml.safe_load((tmp_path / "provisioning/dashboards/ros-diagnostics.yml").read_text())
    assert {each["type"]: each["url"] for each in sources["datasources"]} == {
        "prometheus": f"http://{ADDRESSES.prometheus}",
        "alertmanager": f"http://{ADDRESSES.alertmanager}",
    }
    (provider,) = boards["providers"]
    assert list(Path(provider["options"]["path"]).glob("ros-diagnostics-*.json"))
