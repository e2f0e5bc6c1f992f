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
from ros_diagnostics_tools.backtest import report
from ros_diagnostics_tools.backtest.fault_recording import FaultRecording
from ros_diagnostics_tools.commands import backtest
from ros_diagnostics_tools.main import main
from support.bags import BEGIN, every_second, write_bag

FLEET = "fleet: f\ndiscovery: [{topic: '/{robot}/diagnostics', domain_ids: [0]}]\n"


@pytest.fixture
def run(tmp_path, capsys):
    """A function (arguments): (exit code, standard output, standard error) for a made-up bag."""
    bag = write_bag(
        tmp_path / "bag", every_second(range(300), {"motor": range(40, 90), "laser": [100]})
    )
    config = tmp_path / "fleet.yml"
    config.write_text(FLEET)
    (tmp_path / "other.yml").write_text(FLEET + "profiles: {default: {confirm_after: 30s}}\n")

    def run_command(*arguments, bag=str(bag), config=config):
        code = main(["backtest", "--config", str(config), *arguments, bag])
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return run_command


def test_a_table_has_the_faults_and_a_summary(run):
    code, out, err = run()

    assert (code, err) == (0, "")
    assert "motor" in out
    assert "critical" in out
    assert "1 notification, 0 of them last, 1 outage too short to notify" in out
    assert "times real time" in out


def test_what_is_not_in_the_table_is_in_the_csv_that_it_names(run, monkeypatch):
    monkeypatch.setattr(report, "SHOWN", 0)
    assert "and 1 more: --output csv has all" in run()[1]
    assert run("--output", "csv")[0] == 0


@pytest.mark.parametrize("domain_id", [7, ZENOH])
def test_a_recording_is_of_the_domain_that_it_names(domain_id):
    recording = FaultRecording({"domain_ids": [domain_id]}, b"")
    options = SimpleNamespace(domain_id=None)
    assert backtest._domain(Fleet("f", ()), options, recording) == domain_id


def test_json_has_everything(run):
    code, out, _err = run("--output", "json")

    found = json.loads(out)
    assert code == 0
    (fault,) = found["notifications"]
    assert fault["robot"] == "r"
    assert (fault["scope"], fault["state"], fault["severity"]) == (
        "component",
        "critical",
        "critical",
    )
    assert [fault[key] - BEGIN for key in ("since", "notified", "ended")] == [40, 50, 90]
    assert fault["evidence"]
    assert {each["component"]: each["too_short"] for each in found["components"]} == {
        "motor": 0,
        "laser": 1,
    }


def test_csv_has_a_line_for_each_notification(run):
    _code, out, _err = run("--output", "csv")

    (row,) = csv.DictReader(io.StringIO(out))
    assert (row["component"], row["duration"]) == ("motor", "50.0")
    assert row["since"] == "2026-09-21T14:14:00.000Z"


def test_two_configurations_are_compared_in_words(run, tmp_path):
    _code, out, _err = run("--compare", str(tmp_path / "other.yml"))

    assert "profile default: confirm_after 30s instead of 10s" in out
    assert "1 fault later by 20s" in out
    assert "none missed" in out


def test_all_of_it_is_in_json(run, tmp_path):
    _code, out, _err = run(
        "--compare", str(tmp_path / "other.yml"), "--suggest", "--output", "json"
    )

    found = json.loads(out)
    assert found["comparison"]["later"][0]["by"] == 20.0
    assert found["suggestions"] == []


def test_openmetrics_has_each_sample_with_its_time(run, tmp_path):
    path = tmp_path / "samples.om"

    run("--openmetrics", str(path), "--openmetrics-interval", "10s")

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
        (
            "fleet: f\nrobots: [{name: r, namespace: /other}]\n",
            "has no robot for the recorded topics",
        ),
        ("fleet: f\nrobots: [{name: a}, {name: b, domain_id: 1}]\n", "several DDS domains"),
    ],
)
def test_a_recording_of_other_robots_is_an_error_that_says_what_to_do(run, tmp_path, config, what):
    path = tmp_path / "wrong.yml"
    path.write_text(config)

    code, out, err = run(config=path)

    assert (code, out) == (1, "")
    assert what in err


def test_the_domain_of_a_recording_may_follow_its_name(run, tmp_path):
    path = tmp_path / "two.yml"
    path.write_text("fleet: f\nrobots: [{name: a}, {name: b, namespace: /r, domain_id: 7}]\n")

    code, out, _err = run("--output", "json", config=path, bag=f"{tmp_path / 'bag'}@7")

    assert code == 0
    assert json.loads(out)["robots"] == ["b"]


def test_a_wrong_config_and_a_wrong_flag_exit_with_2(run, tmp_path):
    path = tmp_path / "bad.yml"
    path.write_text("fleet: f\nrobot: []\n")

    assert run(config=path)[0] == 2
    assert run("--output", "csv", "--suggest")[0] == 2


def cut(bag, cut_off, of):
    """Every so many-th message of a bag without its last bytes."""
    (file,) = bag.glob("*.db3")
    with closing(sqlite3.connect(file)) as connection, connection:
        connection.execute(
            "UPDATE messages SET data = substr(data, 1, length(data) - ?) WHERE id % ? = 0",
            (cut_off, of),
        )
    return str(file)


def test_undecodable_messages_are_counted(run, tmp_path):
    bag = write_bag(tmp_path / "cut", every_second(range(100), {"motor": []}), "sqlite3")

    code, out, err = run("--output", "json", bag=cut(bag, 7, 2))

    assert code == 0
    assert "50 of 100 messages cannot be decoded: /r/diagnostics: ends within" in err
    found = json.loads(out)
    assert found["undecodable_messages"] == 50
    assert [f"ros-diagnostics: {each}" for each in found["warnings"]] == err.splitlines()


def test_a_bag_of_which_nothing_can_be_decoded_is_an_error(run, tmp_path):
    bag = write_bag(tmp_path / "cut", every_second(range(100), {"motor": []}), "sqlite3")

    code, _out, err = run(bag=cut(bag, 7, 1))

    assert code == 1
    assert "100 of 100 messages cannot be decoded: /r/diagnostics: ends within" in err
