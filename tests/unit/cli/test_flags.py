from __future__ import annotations

import re
from pathlib import Path

import pytest
import yaml

from ros_diagnostics_exporter.cli import flags


def test_help_names_every_flag_of_its_examples_and_the_exit_codes(capsys):
    with pytest.raises(SystemExit) as ended:
        flags.parse(["--help"])
    assert ended.value.code == 0
    text = capsys.readouterr().out
    usage, _, examples = text.partition("The smallest fleet.yml")
    assert set(re.findall(r"--[a-z]+\.[a-z.]+", examples)) <= set(re.findall(r"--[a-z.]+", usage))
    assert "Exit codes: 0" in examples


def test_helps_scrape_config_is_the_job_that_the_shipped_rules_know():
    shipped = Path(__file__).parents[3] / "prometheus" / "prometheus.yml"
    jobs = [each["job_name"] for each in yaml.safe_load(shipped.read_text())["scrape_configs"]]
    example = re.search(r"scrape_configs: (\[.*?\n.*?\])$", flags.EPILOG, re.MULTILINE)
    (job,) = yaml.safe_load(example[1])
    assert job["job_name"] in jobs
    assert job["honor_labels"] is True


@pytest.mark.parametrize("path", ["metrics", "/{job}", "/a?b", ""])
def test_a_telemetry_path_that_is_none_is_refused(path, capsys):
    with pytest.raises(SystemExit) as ended:
        flags.parse(["--web.telemetry-path", path])
    assert ended.value.code == 2
    assert "is no path such as /metrics" in capsys.readouterr().err


def test_listen_addresses_may_be_repeated():
    given = ["--web.listen-address", ":1", "--web.listen-address", "[::1]:2"]
    assert flags.parse(given).listen_addresses == [":1", "[::1]:2"]


@pytest.mark.parametrize(
    ("url", "why"),
    [
        ("localhost:9093", "is no URL"),
        ("ftp://a", "is no URL"),
        ("http://", "is no URL"),
        ("http://ann:secret@a:9093", "--alertmanager.password-file"),
    ],
)
def test_a_url_of_alertmanager_that_is_none_or_tells_a_password_is_refused(url, why, capsys):
    with pytest.raises(SystemExit) as ended:
        flags.parse(["--alertmanager.url", url])
    assert ended.value.code == 2
    said = capsys.readouterr().err
    assert why in said
    assert "secret" not in said


def test_a_user_without_a_password_is_refused(capsys):
    with pytest.raises(SystemExit):
        flags.parse(["--alertmanager.url", "http://a:9093", "--alertmanager.user", "ann"])
    assert "--alertmanager.password-file" in capsys.readouterr().err
