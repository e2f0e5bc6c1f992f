"""The rules' stories on the whole road: real DDS, virtual robots, exporters, blackbox, Prometheus.

All stories are played at once, on different robots of three fleets, clocks shortened ten times
(`stories/scaled.py`); each is judged from the series ALERTS of the whole run, so that nothing in
between is missed. PROMETHEUS=/path/to/prometheus plays them on another release.

They are played once, by the first process of the test run that needs them; the tests of the others
read what came of it.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest

from e2e.rule_scenarios import verdict as judge
from e2e.rule_scenarios.scenario import Story
from e2e.rule_scenarios.table import STORIES
from testbed.locks import claim
from testbed.polling import until

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1200)]

SECONDS = 900.0  # until another process has played them
# Each change of a part takes a message, a scrape and an evaluation to be seen: on a busy machine
# one may take so much longer than another.
LATE = 8.0


@pytest.fixture(scope="session")
def played(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What Prometheus recorded while all stories were played."""
    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent
    path = folder / "stories.json"

    def done_or_mine() -> Any:
        return path.exists() or claim(f"stories{path}")

    mine = until(done_or_mine, "the stories to be played", SECONDS, every=1)
    if mine is not True:
        with mine:
            _play(tmp_path_factory.mktemp("stories"), path)
    result: dict[str, Any] = json.loads(path.read_text())
    return result


def _play(folder: Path, path: Path) -> None:
    from e2e.rule_scenarios.runner import play  # imports ROS, and most processes only read

    result: dict[str, Any] = {"problem": "the stage broke down, see the test that played"}
    try:
        result = play(folder)
    finally:
        draft = path.with_suffix(".part")
        draft.write_text(json.dumps(result))
        draft.rename(path)


def test_every_story_came_to_its_end(played: dict[str, Any]):
    assert played["problem"] == ""


@pytest.mark.parametrize("story", STORIES, ids=lambda story: story.title)
def test_real(story: Story, played: dict[str, Any]):
    """Everything that had to be told was, once and in this order, and nothing else."""
    told = judge.changes(played, story)
    assert judge.by_step(told, story) == judge.expected(story), told


def test_nothing_was_told_that_belongs_to_no_story(played: dict[str, Any]):
    assert judge.strangers(played, STORIES) == set()


@pytest.mark.parametrize(
    ("story", "robot"),
    [pytest.param(story, robot, id=robot) for story in STORIES for robot in story.ranks],
)
def test_recorded_states(story: Story, robot: str, played: dict[str, Any]):
    began = played["began"][story.title][1]  # all was well then
    assert judge.ranks(played, robot, began) == story.ranks[robot]


def test_a_confirmed_warning_that_turns_critical_is_told_at_once(played: dict[str, Any]):
    """Sooner than confirm_after (6 s) after it was seen."""
    story = STORIES[0]
    told = {word: at for at, word in judge.changes(played, story)}
    seen = next(
        at
        for each in played["ranks"]
        if each["metric"]["robot"] == "worsens"
        for at, value in each["values"]
        if value == "3"
    )
    assert told["+ComponentCritical worsens Motor 1"] - seen < 6


def test_the_parts_of_availability_sum_to_the_whole(played: dict[str, Any]):
    """Of every robot, at the end of every slot (30 s here): whatever happened to it."""
    slots = {each["metric"]["robot"]: float(each["value"][1]) for each in played["slots"]}
    assert slots.keys() >= {robot for story in STORIES for robot in story.ranks}
    assert {robot: seconds for robot, seconds in slots.items() if abs(seconds - 30) > 1e-6} == {}


@pytest.mark.parametrize(
    "story", [story for story in STORIES if story.spends], ids=lambda story: story.title
)
def test_availability_of_a_known_history(story: Story, played: dict[str, Any]):
    """Each part took as long as the steps of the story that are spent in it."""
    began = played["began"][story.title]
    spent = judge.spent(played, story.robots[0])
    lasted = {
        part: sum(began[to] - began[since] for since, to in steps)
        for part, steps in story.spends.items()
    }
    assert {part: spent.get(part) for part in lasted} == pytest.approx(lasted, abs=LATE)


def test_time_that_nobody_looked_is_undetermined(played: dict[str, Any]):
    """While its exporter was stalled a robot was in no state; others, meanwhile, were."""
    story = next(story for story in STORIES if "gap" in story.robots)
    began = played["began"][story.title]
    stalled = story.steps.index(next(s for s in story.steps if "stage: stall exporter" in s.does))
    lasted = began[stalled + 1] - began[stalled]
    gap, other = (judge.spent(played, robot).get("undetermined", 0) for robot in ("gap", "worsens"))
    assert lasted - LATE < gap - other < lasted + 2 * LATE  # it is restarted later, too
