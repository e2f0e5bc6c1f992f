"""The demo's judgement of its programs, with programs that do nothing in their place."""

from __future__ import annotations

import pytest
from rich.console import Console

from demo import performance
from demo.liveness import GoneForGoodError
from demo.performance import Performance
from demo.screen import Screen
from testbed import configuration as site
from testbed import programs
from testbed.mail import Inbox
from testbed.stack import Server, Stack


@pytest.fixture
def stack(start_process, free_port) -> Stack:
    names = ("robots", "exporter", "Prometheus", "Alertmanager", "Grafana")
    servers = [Server(start_process(name, ["sleep", "600"])) for name in names]
    addresses = site.Addresses(*(f"127.0.0.1:{free_port()}" for _ in range(5)))
    return Stack(0, {}, addresses, Inbox(), *servers)


@pytest.fixture
def show(stack) -> Performance:
    return Performance(stack, Screen(Console()), with_story=False)


@pytest.mark.parametrize("dead", ["exporter", "Grafana"])
def test_a_program_that_has_died_is_reported(stack, show, dead, capsys):
    servers = (*stack.servers, stack.grafana)
    next(each for each in servers if each.name == dead).process.kill()

    assert show.play(0.1) == [f"{dead} was killed by SIGKILL"]
    assert f"{dead} was killed by SIGKILL; the demo gives up" in capsys.readouterr().out


def test_a_grafana_that_does_not_come_back_is_given_up(stack, monkeypatch):
    monkeypatch.setattr(performance, "PATIENCE", 0.0)
    stack.grafana.process.kill()

    with pytest.raises(GoneForGoodError, match="Grafana was killed by SIGKILL and did not come"):
        Performance(stack, Screen(Console()), with_story=False).play(5.0)


def test_a_scenarios_robots_do_not_end_before_the_demo(tmp_path):
    argv = programs.virtual_robots(10, 1, 7, tmp_path / "story.yaml")

    assert float(argv[argv.index("--duration") + 1]) > 10 * 365 * 86_400
