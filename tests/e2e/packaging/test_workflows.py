""".github/workflows: they call the project's own entry points, and actionlint accepts them."""

import os
import shutil
from pathlib import Path

import pytest
import yaml

from support.called import called
from support.go import go
from testbed.configuration import CHECKOUT

WORKFLOWS = CHECKOUT / ".github" / "workflows"
ACTIONLINT = "github.com/rhysd/actionlint/cmd/actionlint@v1.7.7"


@pytest.mark.parametrize(("name", "command"), [("ci", ".ci/run"), ("nightly", "./run nightly")])
def test_a_workflow_runs_what_a_person_would(name: str, command: str):
    (job,) = yaml.safe_load((WORKFLOWS / f"{name}.yml").read_text())["jobs"].values()
    (run,) = (step["run"] for step in job["steps"] if "run" in step)
    assert run.endswith(command)
    program = CHECKOUT / command.split(maxsplit=1)[0]
    assert os.access(program, os.X_OK)


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_actionlint_accepts_the_workflows_and_would_find_an_error(tmp_path: Path):
    actionlint = shutil.which("actionlint")
    if actionlint is None:
        go("install", ACTIONLINT, cwd=tmp_path, GOBIN=str(tmp_path))
        actionlint = str(tmp_path / "actionlint")
    command = [actionlint, "-shellcheck=", "-pyflakes="]
    shipped = sorted(WORKFLOWS.glob("*.yml"))
    assert called([*command, *shipped]).stdout == ""

    wrong = tmp_path / "wrong.yml"
    wrong.write_text(shipped[0].read_text().replace("runs-on", "run-on"))
    assert "run-on" in called([*command, wrong], code=1).stdout
