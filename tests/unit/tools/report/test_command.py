"""What `ros-diagnostics report` writes, and where; the numbers are those of e2e/test_report.py."""

from __future__ import annotations

import json

import pytest

from ros_diagnostics_tools.commands import report
from ros_diagnostics_tools.main import main


def test_json_is_written_to_the_file_too(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(report, "_ask", lambda *_: {"fleet": "hall"})
    path = tmp_path / "week.json"

    assert main(["report", "--week", "--output", "json", "--file", str(path)]) == 0

    assert json.loads(path.read_text()) == {"fleet": "hall"}
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize("smtp", ["mail", ":25", "mail:", "mail:70000", "mail:0", "mail:smtp"])
def test_a_mail_server_without_host_or_port_is_rejected(smtp, capsys):
    assert main(["report", "--week", "--smtp", smtp]) == 2
    assert f"{smtp!r} is not an address such as localhost:25" in capsys.readouterr().err
