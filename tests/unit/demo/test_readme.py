"""What README.md and docs/architecture.md show and name exists, and works as shown."""

import re
import subprocess
import sysconfig
from pathlib import Path

import pytest

from demo.steps import MOTOR, problems
from support.configs import load_text

CHECKOUT = Path(__file__).parents[3]
README = (CHECKOUT / "README.md").read_text()
DOCUMENTS = [
    CHECKOUT / name
    for name in (
        *("README.md", "CONTRIBUTING.md", "docs/architecture.md", "docs/CHANGELOG.md"),
        *("docs/on-call.md", "docs/deployment.md", "docs/one-hall.md", "docs/subnets.md"),
        *("docs/kubernetes.md", "docs/ros.md"),
    )
]
COMMANDS = Path(sysconfig.get_path("scripts"))


ONE_HALL = (CHECKOUT / "docs" / "one-hall.md").read_text()


def blocks(language: str, text: str = README) -> list[str]:
    return re.findall(rf"^ *```{language}\n(.*?)^ *```", text, re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("shown", [*blocks("yaml"), *blocks("yaml", ONE_HALL)])
def test_the_fleet_yml_is_valid(tmp_path, shown):
    load_text(tmp_path, shown)


def test_every_command_of_run_exists():
    usage = subprocess.run(["./run", "help"], cwd=CHECKOUT, capture_output=True, check=True)
    commands = set(re.findall(r"^  (\w+)", usage.stdout.decode(), re.MULTILINE))

    for document in DOCUMENTS:
        assert set(re.findall(r"\./run ([a-z]+)", document.read_text())) <= commands


def test_every_bench_exists():
    text = "".join(path.read_text() for path in [*DOCUMENTS, *(CHECKOUT / "docs").glob("*.md")])
    listed = subprocess.run(["./run", "bench"], cwd=CHECKOUT, capture_output=True, check=True)
    named = set(re.findall(r"\./run bench (\w+)", text))

    assert named
    assert named <= set(listed.stdout.decode().split())


def test_every_command_is_installed():
    named = set(
        re.findall(r"\b(ros-diagnostics(?:-(?!robot)\w+)?|virtual-robots|check_ros_\w+)", README)
    )

    assert len(named) >= 3
    assert not [name for name in named if not (COMMANDS / name).exists()]


def test_the_output_shown_is_that_of_the_demo():
    (problem,) = problems([MOTOR])

    assert f"Subject: {problem}" in README
    assert MOTOR.message in README
