"""What `ros-diagnostics report` writes, and where; the numbers are those of e2e/test_report.py."""

import json

import pytest

from ros_diagnostics_tools.commands import report


def test_json_is_written_to_the_file_too(tmp_path, monkeypatch, run):
    monkeypatch.setattr(report, "_ask", lambda *_: {"fleet": "hall"})
    path = tmp_path / "week.json"

    assert run("report", "--week", "--output", "json", "--file", str(path)).out == ""

    assert json.loads(path.read_text()) == {"fleet": "hall"}


@pytest.mark.parametrize("smtp", ["mail", ":25", "mail:", "mail:65536", "mail:0", "mail:smtp"])
def test_a_mail_server_without_host_or_port_is_rejected(smtp, run):
    said = run("report", "--week", "--smtp", smtp, code=2).err
    assert f"{smtp!r} is not an address such as localhost:25" in said
