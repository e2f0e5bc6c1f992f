import re
from pathlib import Path

import pytest
import yaml

from ros_diagnostics_exporter.cli import flags


def test_help_lists_the_flags_of_its_examples_and_the_exit_codes(capsys):
    with pytest.raises(SystemExit) as ended:
        flags.parse(["--help"])
    assert ended.value.code == 0
    text = capsys.readouterr().out
    usage, _, examples = text.partition("The smallest fleet.yml")
    assert set(re.findall(r"--[a-z]+\.[a-z.]+", examples)) <= set(re.findall(r"--[a-z.]+", usage))
    assert "Exit codes: 0" in examples


def test_the_scrape_config_in_help_has_the_job_name_of_the_shipped_configuration():
    shipped = Path(__file__).parents[3] / "prometheus" / "prometheus.yml"
    jobs = [each["job_name"] for each in yaml.safe_load(shipped.read_text())["scrape_configs"]]
    example = re.search(r"scrape_configs: (\[.*?\n.*?\])$", flags.EPILOG, re.MULTILINE)
    (job,) = yaml.safe_load(example[1])
    assert job["job_name"] in jobs
    assert job["honor_labels"] is True


def test_listen_address_may_be_repeated():
    given = ["--web.listen-address", ":1", "--web.listen-address", "[::1]:2"]
    assert flags.parse(given).web_listen_address == [":1", "[::1]:2"]


def test_the_database_is_in_systemds_folder_or_in_data(monkeypatch):
    monkeypatch.delenv("STATE_DIRECTORY", raising=False)
    assert flags.parse([]).storage_path == Path("data/exporter.db")
    monkeypatch.setenv("STATE_DIRECTORY", "/var/lib/a:/var/lib/b")
    assert flags.parse([]).storage_path == Path("/var/lib/a/exporter.db")
    assert flags.parse(["--storage.path", "x.db"]).storage_path == Path("x.db")
    assert flags.parse(["--storage.path=none"]).storage_path is None


def test_retention_is_a_duration_and_a_size():
    options = flags.parse(["--storage.retention.time=12h", "--storage.retention.size=2GB"])
    assert options.storage_retention_time == 12 * 3600
    assert options.storage_retention_size == 2 << 30
    options = flags.parse([])
    assert options.storage_retention_time == 90 * 86400
    assert options.storage_retention_size == 256 << 20


@pytest.mark.parametrize(
    ("flag", "values", "error"),
    [
        ("web.telemetry-path", ["metrics", "/{job}", "/a?b", ""], "is not a path such as /metrics"),
        ("alertmanager.url", ["localhost:9093", "ftp://a", "http://"], "is not a URL"),
        (
            "alertmanager.url",
            ["http://ann:secret@a:9093", "ann:secret@a:9093", "http://ann:secret@"],
            "--alertmanager.password-file",
        ),
        ("alertmanager.user", ["ann"], "--alertmanager.password-file"),
        ("storage.path", [""], "'' is not the name of a file; with none nothing is stored"),
        ("storage.retention.time", ["90"], "'90' is not a duration such as 90d"),
        ("storage.retention.size", ["1TB"], "'1TB' is not a size such as 256MB"),
        ("storage.retention.size", ["256MB2"], "'256MB2' is not a size such as 256MB"),
        ("prometheus.url", ["http://ann:secret@p:9090"], "--prometheus.password-file"),
        ("grafana.url", ["localhost:3000", "javascript:alert(1)", "http://g/?a"], "is not a URL"),
        ("grafana.url", ["http://ann:secret@g:3000"], "without a user"),
        ("prometheus.user", ["ann"], "--prometheus.user needs --prometheus.password-file"),
        ("shard", ["5/4", "0/4", "x", "2"], "is not a shard such as 2/4, the second of four"),
        (
            "shard",
            ["2/4"],
            "--shard needs --alertmanager.url and --prometheus.url: exporters learn",
        ),
        ("storage.pat", ["x.db"], "unrecognized arguments: --storage.pat"),
    ],
)
def test_a_wrong_flag_is_named(capsys, flag, values, error):
    for value in values:
        with pytest.raises(SystemExit) as ended:
            flags.parse(["--alertmanager.url=http://a:9093", f"--{flag}={value}"])
        assert ended.value.code == 2
        stderr = capsys.readouterr().err
        assert error in stderr
        assert "secret" not in stderr


def test_what_excludes_or_needs_something_else_is_named(capsys):
    user = ["--prometheus.user=ann", "--prometheus.password-file=p"]
    for given, error in (
        ([*user, "--prometheus.bearer-token-file=t"], "not both"),
        (["--web.enable-actions"], "--web.enable-actions needs --alertmanager.url"),
    ):
        with pytest.raises(SystemExit) as ended:
            flags.parse(given)
        assert ended.value.code == 2
        assert error in capsys.readouterr().err


def test_what_changes_something_by_the_web_is_off_unless_it_is_asked_for():
    options = flags.parse([])
    assert (
        options.web_enable_lifecycle,
        options.web_enable_actions,
        options.web_listen_address,
    ) == (False, False, None)
