"""One participant for all, one a robot, one domain a robot; and who leaves the graph when."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest

from testbed import domains
from testbed.processes import Process

DRIVER = "virtual_robot_driver"


def drivers(listener: Any) -> set[tuple[str, str]]:
    names = listener.node.get_node_names_and_namespaces()
    return {(name, namespace) for name, namespace in names if name.startswith(DRIVER)}


def test_a_fleet_shares_one_node(virtual_robots: Callable[..., Process], listener: Any) -> None:
    virtual_robots("--robots", "3")
    listener.until(lambda: drivers(listener) == {(f"{DRIVER}s", "/")}, "one driver node")


def test_each_robot_can_have_a_participant_of_its_own(
    virtual_robots: Callable[..., Process], listener: Any
) -> None:
    listener.listen("/robot_3/diagnostics")
    virtual_robots("--robots", "3", "--participants", "robot")
    expected = {(DRIVER, f"/robot_{n}") for n in (1, 2, 3)}
    listener.until(lambda: drivers(listener) == expected, "three driver nodes")
    listener.until(lambda: listener.of("/robot_3/diagnostics"), "a message")


def test_each_robot_can_have_a_domain_of_its_own(
    virtual_robots: Callable[..., Process], make_listener: Callable[[int], Any]
) -> None:
    with two_neighbouring_domains() as first:
        listeners = [make_listener(first), make_listener(first + 1)]
        for listening in listeners:
            listening.listen("/robot_1/diagnostics")
            listening.listen("/robot_2/diagnostics")
        virtual_robots("--robots", "2", "--participants", "domain", "--domain-id", str(first))
        for robot, listening in enumerate(listeners, start=1):
            own, other = f"/robot_{robot}/diagnostics", f"/robot_{3 - robot}/diagnostics"
            listening.until(lambda at=listening, t=own: len(at.of(t)) >= 2, f"{own} twice")
            assert listening.of(other) == []


def test_too_few_domains_are_an_error(command: Callable[..., Any]) -> None:
    done = command("--robots", "5", "--participants", "domain", "--domain-id", "230", code=2)
    assert "5 robots in a domain each, from 230, need domain 234" in done.stderr


@pytest.mark.parametrize("participants", ["fleet", "robot"])
def test_a_robot_that_leaves_is_gone_from_the_graph_and_comes_back(
    virtual_robots: Callable[..., Process], listener: Any, tmp_path: Path, participants: str
) -> None:
    scenario = tmp_path / "scenario.yaml"
    scenario.write_text(
        "robots: [{count: 2}]\nevents: [{at: 4, robot: robot_1, what: leave, for: 4}]\n"
    )
    virtual_robots("--scenario", str(scenario), "--participants", participants)

    def publishers(robot: str) -> int:
        return len(listener.node.get_publishers_info_by_topic(f"/{robot}/diagnostics"))

    listener.until(lambda: publishers("robot_1") == 1, "robot_1 in the graph")
    listener.until(lambda: publishers("robot_1") == 0, "robot_1 out of the graph")
    assert publishers("robot_2") == 1
    listener.until(lambda: publishers("robot_1") == 1, "robot_1 in the graph again")


def test_a_scenario_ends_after_its_duration_and_notes_its_events(
    command: Callable[..., Any], tmp_path: Path
) -> None:
    scenario = tmp_path / "scenario.yaml"
    scenario.write_text("duration: 2\nevents: [{at: 1, robot: robot_2, what: crash}]\n")
    done = command("--scenario", str(scenario))
    assert done.stderr == ""
    assert "ready: 10 virtual robots in domain " in done.stdout
    assert "     1.0 s  robot_2: crash\n" in done.stdout


def test_settings_are_read_again_when_the_file_changes(
    virtual_robots: Callable[..., Process], listener: Any, tmp_path: Path
) -> None:
    settings = tmp_path / "robot.yaml"
    settings.write_text("total_errors: 0\n")
    listener.listen("/robot_1/diagnostics")
    process = virtual_robots("--robots", "1", "--settings", str(settings))

    def errors() -> int:
        received = listener.of("/robot_1/diagnostics")
        return sum(s.level == b"\2" for s in received[-1].status) if received else -1

    listener.until(lambda: errors() == 0, "no errors")
    settings.write_text("total_errors: 3\n")
    listener.until(lambda: errors() == 3, "three errors")
    settings.write_text("total_errors: 99\n")
    process.wait_for_output("total_errors .* is 99.*\n.*keeping the previous settings")
    settings.write_text("total_errors: 1\n")
    listener.until(lambda: errors() == 1, "one error")


@contextmanager
def two_neighbouring_domains() -> Iterator[int]:
    """Lease domains until two of them are neighbours; yields the lower."""
    with ExitStack() as leases:
        taken: set[int] = set()
        while True:
            domain = leases.enter_context(domains.lease())
            taken.add(domain)
            for first in (domain - 1, domain):
                if {first, first + 1} <= taken:
                    yield first
                    return
