"""Plays all stories at once, each step when the one before it has settled, and keeps what was told.

What comes out is plain data, so that it can be written to a file: the tests, which may run in
other processes, read it there.
"""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from e2e.rule_scenarios.scenario import Step, Story
from e2e.rule_scenarios.stack import Stage, running
from e2e.rule_scenarios.table import STORIES
from e2e.rule_scenarios.verdict import name_of, owns
from support.prometheus_site import Site
from testbed.polling import until

SECONDS = 480  # for all; on two idle cores they take less than half of it


@dataclass
class Performance:
    """A story on its way: the step that it is in, when each began, and what keeps it."""

    story: Story
    began: list[float] = field(default_factory=list)
    waits_for: str = ""

    @property
    def step(self) -> Step:
        return self.story.steps[len(self.began) - 1]

    @property
    def finished(self) -> bool:
        return len(self.began) > len(self.story.steps)


class Play:
    """All stories on one stage."""

    def __init__(self, stage: Stage, site: Site) -> None:
        self.stage = stage
        self.site = site
        self.performances = [Performance(story) for story in STORIES]
        self.started = time.time()

    def run(self) -> None:
        """Play all to their end, as far as they come in time."""
        for performance in self.performances:
            self._next(performance)

        def played() -> bool:
            alerts = self.site.alerts()
            for each in self.performances:
                if not each.finished and self._settled(each, alerts):
                    self._next(each)
            return all(each.finished for each in self.performances)

        until(played, self._unfinished, SECONDS, every=0.5)

    def result(self) -> dict[str, Any]:
        """What Prometheus recorded of the run, once the last slot of availability is complete."""
        slot = "min(timestamp(robot:ros_diagnostics_part_seconds:sum5m))"
        ended = time.time()
        until(lambda: self.site.query(f"{slot} > {ended + 4}"), "the last slot", 90, every=1)
        now = time.time()
        window = f"[{int(now - self.started) + 30}s]"

        def recorded(expr: str) -> list[dict[str, Any]]:
            return self.site.query_range(expr, self.started, now, 1)

        return {
            "began": {each.story.title: each.began for each in self.performances},
            "until": now,
            "alerts": recorded('ALERTS{alertstate="firing", fleet!=""}'),
            "ranks": recorded("robot:ros_diagnostics_state:rank"),
            "parts": self.site.query(
                "sum by (fleet, robot, part)"
                f" (sum_over_time(robot:ros_diagnostics_part_seconds:sum5m{window}))"
            ),
            "slots": self.site.query(
                "sum by (fleet, robot) (robot:ros_diagnostics_part_seconds:sum5m)"
            ),
            "version": self.site.query("prometheus_build_info")[0]["metric"]["version"],
        }

    def _next(self, performance: Performance) -> None:
        performance.began.append(time.time())
        if not performance.finished:
            self.stage.perform(performance.step.does)

    def _settled(self, performance: Performance, alerts: list[dict[str, Any]]) -> bool:
        step = performance.step
        mine = [each for each in alerts if owns(performance.story, each["labels"])]
        firing = {name_of(each["labels"]) for each in mine if each["state"] == "firing"}
        said = {name_of(each["labels"]): each["annotations"]["description"] for each in mine}
        performance.waits_for = ""
        if firing != step.alerts:
            differs = _listed(firing ^ step.alerts)
            performance.waits_for = f"{_listed(step.alerts)}; differs: {differs}"
        for alert, words in step.says.items():
            if words not in said.get(alert, ""):
                performance.waits_for = f"{words!r} in {said.get(alert)!r}"
        expr = step.until.replace("BEGAN", str(performance.began[-1]))
        if not performance.waits_for and expr and not self.site.query(expr):
            performance.waits_for = expr
        return not performance.waits_for

    def _unfinished(self) -> str:
        return "\n".join(
            f"{each.story.title!r}, step {len(each.began) - 1}: {each.waits_for}"
            for each in self.performances
            if not each.finished
        )


def play(folder: Path) -> dict[str, Any]:
    """Play all stories in ``folder``; returns what was recorded of them, as plain data."""
    with running(folder) as (stage, site):
        stories = Play(stage, site)
        problem = ""
        try:
            stories.run()
        except TimeoutError as error:
            problem = str(error)
        return stories.result() | {"problem": problem}


def _listed(names: Iterable[str]) -> str:
    return ", ".join(sorted(names)) or "nothing"
