import pwd

import pytest

from ros_diagnostics_tools.main import main

CLOSED = ("--alertmanager", "http://127.0.0.1:1")
ORDER = ("robot_1", "--comment", "on it")


@pytest.mark.parametrize("lasts", ["-1d", "0d", "nan", "999999d", "long"])
def test_an_invalid_duration_is_rejected(lasts, run):
    said = run("ack", *ORDER, f"--for={lasts}", code=2).err
    assert f"'{lasts}' is not a duration such as" in said


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        pytest.param(["--help"], 0, "", id="help"),
        pytest.param(
            ["--list", *CLOSED], 3, "ros-diagnostics: cannot reach http://127.0.0.1:1/", id="list"
        ),
        pytest.param(ORDER, 2, "give your name with --author", id="who"),
        pytest.param([*ORDER, "--author", "me", *CLOSED], 3, "http://127.0.0.1:1/", id="author"),
    ],
)
def test_a_user_without_an_entry_in_passwd_needs_to_say_who_acknowledges(
    arguments, code, said, monkeypatch, capsys
):
    for name in ("LOGNAME", "USER", "LNAME", "USERNAME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(pwd, "getpwuid", {}.__getitem__)
    assert main(["ack", *arguments]) == code
    assert said in capsys.readouterr().err
