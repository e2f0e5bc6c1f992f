"""The demo reports programs that ended; here with programs that do nothing."""

from collections.abc import Iterator

import pytest
from rich.console import Console

from demo.run import DemoRun
from demo.screen import Screen
from testbed import programs
from testbed.processes import Process
from testbed.site import Site


@pytest.fixture
def stack(tmp_path) -> Iterator[Site]:
    with Site(tmp_path) as site:
        for name in ("robots", "exporter", "Prometheus", "Alertmanager", "Grafana"):
            site.start_program(name, ["sleep", "600"])
        yield site


def process(stack: Site, name: str) -> Process:
    return next(each.process for each in stack.started if each.name == name)


@pytest.fixture
def demo_run(stack) -> DemoRun:
    return DemoRun(stack, Screen(Console()))


@pytest.mark.parametrize("dead", ["exporter", "Grafana"])
def test_a_program_that_was_killed_is_reported(stack, demo_run, dead, capsys):
    process(stack, dead).kill()

    assert demo_run.run(0.1) == [f"{dead} was killed by SIGKILL"]
    assert f"{dead} was killed by SIGKILL; the demo gives up" in capsys.readouterr().out


def test_a_scenarios_robots_do_not_end_before_the_demo(tmp_path):
    argv = programs.virtual_robots(10, 1, 7, tmp_path / "scenario.yaml")

    assert float(argv[argv.index("--duration") + 1]) > 10 * 365 * 86_400
