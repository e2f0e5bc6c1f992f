"""What the flags become: clients, retention, and what a check of the config looks at."""

import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import pytest

from ros_diagnostics_exporter.cli import flags, main
from ros_diagnostics_exporter.config.load import load
from ros_diagnostics_exporter.http_client import Client
from support.called import called

FLEET = "fleet: f\nrobots: [{name: r, topic: /r/diagnostics, source: raw}]\n"
_CALLS = ("start", "stop")
FILES = {
    "user": "ann",
    "password_file": Path("p"),
    "bearer_token_file": Path("t"),
    "ca_file": Path("c"),
}


@pytest.fixture
def fleet_file(tmp_path):
    path = tmp_path / "fleet.yml"
    path.write_text(FLEET)
    return path


def given_to(monkeypatch, module_of_client):
    """The arguments of the clients that are made there."""
    made = []

    class Noted(Client):
        def __init__(self, url, **given):
            made.append((url, given))

    monkeypatch.setattr(f"{module_of_client}.Client", Noted)
    return made


def test_prometheus_is_asked_with_the_logins_of_its_flags(monkeypatch):
    made = given_to(monkeypatch, "ros_diagnostics_exporter.cli.main")
    given = ["--prometheus.url=http://p:9090", "--prometheus.ca-file=c"]
    main._prometheus(flags.parse([*given, "--prometheus.bearer-token-file=t"]))
    main._prometheus(flags.parse([*given, "--prometheus.user=ann", "--prometheus.password-file=p"]))
    for (url, found), expected in zip(
        made, ({"bearer_token_file", "ca_file"}, {"user", "password_file", "ca_file"}), strict=True
    ):
        assert url == "http://p:9090"
        assert {key: found[key] for key in FILES if found[key] is not None} == {
            key: FILES[key] for key in expected
        }


def test_alertmanager_is_asked_with_the_login_and_the_ca_of_its_flags(monkeypatch):
    made = given_to(monkeypatch, "ros_diagnostics_exporter.alertmanager")
    main._alertmanager(
        flags.parse(
            ["--alertmanager.url=http://a:9093", "--alertmanager.url=http://b:9093",
             "--alertmanager.user=ann", "--alertmanager.password-file=p",
             "--alertmanager.ca-file=c"]
        )
    )  # fmt: skip
    assert [url for url, _ in made] == ["http://a:9093", "http://b:9093"]
    for _, found in made:
        assert (found["user"], found["password_file"]) == ("ann", Path("p"))
        assert found["ca_file"] == Path("c")


def test_the_database_has_the_path_and_the_retention_of_the_flags(tmp_path):
    path = tmp_path / "x.db"
    given = ["--storage.retention.time=12h", "--storage.retention.size=2MB"]
    storage = main._storage(flags.parse([f"--storage.path={path}", *given]))
    assert storage is not None
    assert storage._path == path
    assert (storage._retention.seconds, storage._retention.size) == (43_200.0, 2 << 20)
    assert main._storage(flags.parse(["--storage.path=none"])) is None


def test_a_check_of_the_config_looks_at_that_of_the_web_too(fleet_file, tmp_path, capsys):
    web = tmp_path / "web.yml"
    web.write_text("basic_auth_user: {}\n")
    given = ["--config.check", f"--config.file={fleet_file}", f"--web.config.file={web}"]
    assert main.main(given) == 2
    assert "basic_auth_user" in capsys.readouterr().err


@pytest.mark.parametrize("error", [main.InUseError, main.RosMissingError])
def test_what_may_be_over_soon_is_1_so_that_systemd_starts_it_again(monkeypatch, error, capsys):
    def run(_options, _for_ros):
        raise error("not now")

    monkeypatch.setattr(main, "_run", run)
    assert main.main([]) == 1
    assert capsys.readouterr().err == "ros-diagnostics-exporter: not now\n"


def test_what_the_config_warns_of_is_logged_as_a_warning(fleet_file, monkeypatch, caplog):
    fleet = replace(load(fleet_file), warnings=("a rule matches nothing",))

    def check_ros():
        raise main.RosMissingError("no ROS")

    monkeypatch.setattr(main, "load", lambda *_given: fleet)
    monkeypatch.setattr(main, "check_ros", check_ros)
    with pytest.raises(main.RosMissingError):
        main._run(flags.parse([]), ())
    assert [(each.levelname, each.getMessage()) for each in caplog.records] == [
        ("WARNING", "a rule matches nothing")
    ]


def test_a_web_server_that_failed_ends_the_exporter_and_its_service(monkeypatch):
    """Without the web server nobody sees the faults."""
    calls = []

    class Played:
        """A server and a service; what is called of it is noted."""

        loop, addresses, alive, hangs = None, ("127.0.0.1:1",), False, False

        def __init__(self, name):
            self.state = SimpleNamespace(fleet=SimpleNamespace(name="f", domain_ids=(0,)))
            self.start, self.stop = (partial(calls.append, f"{each} {name}") for each in _CALLS)
            self.watch = lambda _loop: None

    monkeypatch.setattr(main, "Server", lambda _service, **_given: Played("server"))
    monkeypatch.setattr(main.signal, "signal", lambda *_: None)
    monkeypatch.setattr(main, "TURN", 0.0)
    with pytest.raises(main.WebEndedError):
        main._serve(flags.parse([]), [":0"], Played("service"))
    assert calls == ["start server", "start service", "stop server", "stop service"]


def test_what_few_sites_need_is_imported_where_it_is_used():
    seldom = {"zenoh", "mcap", "mcap_ros2", "lz4", "zstandard"}
    program = f"import sys, ros_diagnostics_exporter.cli.main; print({seldom} & sys.modules.keys())"
    assert called([sys.executable, "-c", program]).stdout == "set()\n"
