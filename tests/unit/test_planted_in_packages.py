"""Unit tests find mistakes: each that is planted in a package makes the named test fail."""

import sys
from pathlib import PurePosixPath

import pytest
import yaml

from support.called import called
from support.named_tests import find_missing
from support.planted import CHECKOUT, occurs_once, planted_checkout

MISTAKES = yaml.load(
    (CHECKOUT / "tests/data/planted_in_packages.yml").read_text(), yaml.CSafeLoader
)
EXPORTER = CHECKOUT / "exporter/ros_diagnostics_exporter"
TOOLS = CHECKOUT / "exporter/ros_diagnostics_tools"
# Each package of the exporter and of the tools, and the rules.
FOLDERS = sorted(
    str(folder.relative_to(CHECKOUT))
    for folder in (
        *(init.parent for of in (EXPORTER, TOOLS) for init in of.glob("*/__init__.py")),
        CHECKOUT / "prometheus/rules",
    )
)
LEAST = 10  # mistakes in each


@pytest.mark.slow
@pytest.mark.timeout(900)  # a pytest of its own, beside whatever the machine does
@pytest.mark.parametrize("mistake", MISTAKES, ids=lambda mistake: mistake["what"])
def test_a_planted_mistake_is_found(mistake, tmp_path):
    copy = tmp_path / "checkout"
    environment = planted_checkout(copy, mistake["file"], mistake["right"], mistake["wrong"])
    argv = [sys.executable, "-m", "pytest", "--quiet", "-p", "no:cacheprovider"]

    failed = pytest.ExitCode.TESTS_FAILED
    done = called([*argv, mistake["found_by"]], code=failed, cwd=copy, env=environment)

    assert f"FAILED {mistake['found_by']}" in done.stdout


@pytest.mark.parametrize("mistake", MISTAKES, ids=lambda mistake: mistake["what"])
def test_a_mistake_can_be_planted(mistake):
    """So that a change that moves one is noticed at once."""
    assert occurs_once((CHECKOUT / mistake["file"]).read_text(), mistake["right"])


def test_every_test_that_finds_a_mistake_exists(request: pytest.FixtureRequest):
    assert find_missing((each["found_by"] for each in MISTAKES), request.session) == set()


@pytest.mark.parametrize("folder", FOLDERS)
def test_mistakes_are_planted_in_each_package(folder):
    planted = [each for each in MISTAKES if PurePosixPath(each["file"]).is_relative_to(folder)]
    assert len(planted) >= LEAST


def test_no_mistake_is_planted_twice():
    planted = {(each["file"], each["right"], each["wrong"]) for each in MISTAKES}
    assert len(planted) == len({each["what"] for each in MISTAKES}) == len(MISTAKES)
