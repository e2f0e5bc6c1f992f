"""The config at the command line: --config.check, and a config that cannot be used."""

from pathlib import Path

import pytest

from ros_diagnostics_exporter.cli.main import main
from ros_diagnostics_exporter.config.check import describe
from ros_diagnostics_exporter.config.load import load

EXAMPLE = Path(__file__).parents[3] / "docs" / "examples" / "one-robot.yml"
BAD = Path(__file__).parents[2] / "data/configs" / "bad-domain-id.yml"


def test_check_describes_the_config(capsys):
    assert main(["--config.check", "--config.file", str(EXAMPLE)]) == 0
    assert capsys.readouterr().out == describe(load(EXAMPLE))


@pytest.mark.parametrize("check", [["--config.check"], []], ids=["check", "start"])
def test_all_that_is_wrong_goes_to_stderr_and_the_exit_code_is_2(capsys, monkeypatch, check):
    monkeypatch.chdir(BAD.parent)
    assert main([*check, "--config.file", BAD.name]) == 2
    out, err = capsys.readouterr()
    assert (out, err) == ("", BAD.with_suffix(".txt").read_text(encoding="utf-8"))


@pytest.mark.parametrize("address", ["nonsense", ":99999", "::1:9877"])
def test_an_invalid_address_is_wrong_usage_and_not_retried(capsys, address):
    """Systemd starts the exporter again at exit code 1, when the port is taken."""
    assert main(["--config.file", str(EXAMPLE), "--web.listen-address", address]) == 2
    assert f"listen address '{address}' has" in capsys.readouterr().err
