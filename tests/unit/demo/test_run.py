"""The demo reports programs that ended; here with programs that do nothing."""

from __future__ import annotations

import pytest
from rich.console import Console

from demo import run
from demo.liveness import ProgramEndedError
from demo.run import DemoRun
from demo.screen import Screen
from testbed import configuration, programs
from testbed.mail import Inbox, MailServer
from testbed.servers import Server
from testbed.stack import Stack


@pytest.fixture
def stack(start_process, free_port) -> Stack:
    names = ("robots", "exporter", "Prometheus", "Alertmanager", "Grafana")
    servers = [Server(start_process(name, ["sleep", "600"])) for name in names]
    addresses = configuration.Addresses(*(f"127.0.0.1:{free_port()}" for _ in range(5)))
    inbox = Inbox()
    robots, *others = servers
    mail_server = MailServer(addresses.smtp, inbox)
    return Stack(0, {}, addresses, inbox, mail_server, robots, (), *others)


@pytest.fixture
def demo_run(stack) -> DemoRun:
    return DemoRun(stack, Screen(Console()), inject=False)


@pytest.mark.parametrize("dead", ["exporter", "Grafana"])
def test_a_program_that_was_killed_is_reported(stack, demo_run, dead, capsys):
    servers = (*stack.servers, stack.grafana)
    next(each for each in servers if each.name == dead).process.kill()

    assert demo_run.run(0.1) == [f"{dead} was killed by SIGKILL"]
    assert f"{dead} was killed by SIGKILL; the demo gives up" in capsys.readouterr().out


def test_a_grafana_that_does_not_come_back_ends_the_demo(stack, monkeypatch):
    monkeypatch.setattr(run, "PATIENCE", 0.0)
    stack.grafana.process.kill()

    with pytest.raises(ProgramEndedError, match="Grafana was killed by SIGKILL and did not come"):
        DemoRun(stack, Screen(Console()), inject=False).run(5.0)


def test_a_scenarios_robots_do_not_end_before_the_demo(tmp_path):
    argv = programs.virtual_robots(10, 1, 7, tmp_path / "scenario.yaml")

    assert float(argv[argv.index("--duration") + 1]) > 10 * 365 * 86_400
