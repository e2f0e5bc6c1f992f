"""The command: tables, JSON and CSV, errors that say what to do."""

import csv
import io
import json
import sqlite3
from contextlib import closing
from types import SimpleNamespace

import pytest

from ros_diagnostics_exporter.config.fleet import Fleet
from ros_diagnostics_exporter.model import ZENOH
from ros_diagnostics_tools import commands
from ros_diagnostics_tools.backtest import report
from ros_diagnostics_tools.backtest.fault_recording import FaultRecording
from support.bags import BEGIN, every_second, write_bag

FLEET = "fleet: f\ndiscovery: [{topic: '/{robot}/diagnostics', domain_ids: [0]}]\n"


@pytest.fixture
def backtest(tmp_path, run):
    """A function (words, bag, config, code=0): what is printed, of a made-up bag by default."""
    outages = {"motor": range(40, 90), "laser": [100]}
    recorded = write_bag(tmp_path / "bag", every_second(range(300), outages))
    (tmp_path / "other.yml").write_text(FLEET + "profiles: {default: {confirm_after: 30s}}\n")
    path = tmp_path / "fleet.yml"

    def backtest(*words, bag=recorded, config=FLEET, code=0):
        path.write_text(config)
        return run("backtest", "--config", str(path), *words, str(bag), code=code)

    return backtest


def test_a_table_has_the_faults_and_a_summary(backtest):
    out, err = backtest()
    assert err == ""
    assert "motor" in out
    assert "critical" in out
    assert "1 notification, 0 of them last, 1 outage too short to notify" in out
    assert "times real time" in out


def test_what_is_not_in_the_table_is_in_the_csv_that_it_names(backtest, monkeypatch):
    monkeypatch.setattr(report, "SHOWN", 0)
    assert "and 1 more: --output csv has all" in backtest().out
    backtest("--output", "csv")


@pytest.mark.parametrize("domain_id", [7, ZENOH])
def test_a_recording_is_of_the_domain_that_it_names(domain_id):
    recording = FaultRecording({"domain_ids": [domain_id]}, b"")
    options = SimpleNamespace(domain_id=None)
    assert commands.backtest._domain(Fleet("f", ()), options, recording) == domain_id


def test_json_has_everything(backtest):
    found = json.loads(backtest("--output", "json").out)
    (fault,) = found["notifications"]
    labels = {"robot": "r", "scope": "component", "state": "critical", "severity": "critical"}
    assert fault.items() >= labels.items()
    assert [fault[key] - BEGIN for key in ("since", "notified", "ended")] == [40, 50, 90]
    assert fault["evidence"]
    too_short = {each["component"]: each["too_short"] for each in found["components"]}
    assert too_short == {"motor": 0, "laser": 1}


def test_csv_has_a_line_for_each_notification(backtest):
    (row,) = csv.DictReader(io.StringIO(backtest("--output", "csv").out))
    assert (row["component"], row["duration"]) == ("motor", "50.0")
    assert row["since"] == "2026-09-21T14:14:00.000Z"


def test_two_configurations_are_compared_in_words(backtest, tmp_path):
    out = backtest("--compare", str(tmp_path / "other.yml")).out
    assert "profile default: confirm_after 30s instead of 10s" in out
    assert "1 fault later by 20s" in out
    assert "none missed" in out


def test_all_of_it_is_in_json(backtest, tmp_path):
    other = ("--compare", str(tmp_path / "other.yml"))
    found = json.loads(backtest(*other, "--suggest", "--output", "json").out)
    assert found["comparison"]["later"][0]["by"] == 20.0
    assert found["suggestions"] == []


def test_openmetrics_has_each_sample_with_its_time(backtest, tmp_path):
    path = tmp_path / "samples.om"
    backtest("--openmetrics", str(path), "--openmetrics-interval", "10s")
    lines = path.read_text().splitlines()
    assert lines[-1] == "# EOF"
    faults = [line for line in lines if line.startswith("ros_diagnostics_fault_start")]
    assert faults
    times = [float(line.rsplit(" ", 1)[1]) - BEGIN for line in faults]
    assert times == [50.25, 60.25, 70.25, 80.25]
    assert all('job="ros-diagnostics",instance="backtest"' in line for line in lines[:-1])


@pytest.mark.parametrize(
    ("config", "what"),
    [
        ("fleet: f\nrobots: [{name: r, namespace: /other}]\n", "no robot for the recorded topics"),
        ("fleet: f\nrobots: [{name: a}, {name: b, domain_id: 1}]\n", "several DDS domains"),
    ],
)
def test_a_recording_of_other_robots_is_an_error_that_says_what_to_do(backtest, config, what):
    out, err = backtest(config=config, code=1)
    assert (out, what in err) == ("", True)


def test_the_domain_of_a_recording_may_follow_its_name(backtest, tmp_path):
    two = "fleet: f\nrobots: [{name: a}, {name: b, namespace: /r, domain_id: 7}]\n"
    found = backtest("--output", "json", config=two, bag=f"{tmp_path / 'bag'}@7").out
    assert json.loads(found)["robots"] == ["b"]


def test_a_wrong_config_and_a_wrong_flag_exit_with_2(backtest):
    backtest(config="fleet: f\nrobot: []\n", code=2)
    backtest("--output", "csv", "--suggest", code=2)


def cut(tmp_path, of):
    """A bag of 100 messages, every so many-th of them without its last bytes."""
    bag = write_bag(tmp_path / "cut", every_second(range(100), {"motor": []}), "sqlite3")
    (file,) = bag.glob("*.db3")
    with closing(sqlite3.connect(file)) as connection, connection:
        connection.execute(
            "UPDATE messages SET data = substr(data, 1, length(data) - 7) WHERE id % ? = 0", (of,)
        )
    return file


def test_undecodable_messages_are_counted(backtest, tmp_path):
    out, err = backtest("--output", "json", bag=cut(tmp_path, 2))
    assert "50 of 100 messages cannot be decoded: /r/diagnostics: ends within" in err
    found = json.loads(out)
    assert found["undecodable_messages"] == 50
    assert [f"ros-diagnostics: {each}" for each in found["warnings"]] == err.splitlines()


def test_a_bag_of_which_nothing_can_be_decoded_is_an_error(backtest, tmp_path):
    err = backtest(bag=cut(tmp_path, 1), code=1).err
    assert "100 of 100 messages cannot be decoded: /r/diagnostics: ends within" in err
