"""Runs all rule scenarios at once, each step when the one before has settled.

The result is plain data, written to a file for the tests, which may run in other processes.
"""

import time
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from e2e.rule_scenarios.all_scenarios import SCENARIOS
from e2e.rule_scenarios.recording import name_of, owns
from e2e.rule_scenarios.scenario import Scenario, Step
from e2e.rule_scenarios.stack import ScenarioSite, running
from testbed.polling import until

SECONDS = 480  # for all; less than half of it on two idle cores


@dataclass
class Progress:
    """How far a scenario is: when each step began, and what the present one waits for."""

    scenario: Scenario
    began: list[float] = field(default_factory=list)
    waits_for: str = ""

    @property
    def step(self) -> Step:
        return self.scenario.steps[len(self.began) - 1]

    @property
    def finished(self) -> bool:
        return len(self.began) > len(self.scenario.steps)


class Run:
    """All scenarios on one site."""

    def __init__(self, site: ScenarioSite) -> None:
        self.site = site
        self.engine = site.engine
        self.progress = [Progress(scenario) for scenario in SCENARIOS]
        self.started = time.time()

    def run(self) -> None:
        """Run all scenarios.

        Raises:
            TimeoutError: Some did not end in time; the text names them.
        """
        for each in self.progress:
            self._next(each)

        def finished() -> bool:
            alerts = self.engine.alerts()
            for each in self.progress:
                if not each.finished and self._settled(each, alerts):
                    self._next(each)
            return all(each.finished for each in self.progress)

        until(finished, self._unfinished, SECONDS, every=0.5)

    def result(self) -> dict[str, Any]:
        """What Prometheus recorded of the run, and of some seconds after it."""
        recorded_until = "min(timestamp(robot:ros_diagnostics_state:rank))"
        ended = time.time()
        until(lambda: self.engine.query(f"{recorded_until} > {ended + 4}"), "the last states", 90)
        now = time.time()

        def recorded(expr: str) -> list[dict[str, Any]]:
            return self.engine.query_range(expr, self.started, now, 1)

        return {
            "began": {each.scenario.title: each.began for each in self.progress},
            "until": now,
            "alerts": recorded('ALERTS{alertstate="firing", fleet!=""}'),
            "ranks": recorded("robot:ros_diagnostics_state:rank"),
        }

    def _next(self, progress: Progress) -> None:
        progress.began.append(time.time())
        if not progress.finished:
            self.site.do(progress.step.actions)

    def _settled(self, progress: Progress, alerts: list[dict[str, Any]]) -> bool:
        step = progress.step
        mine = [each for each in alerts if owns(progress.scenario, each["labels"])]
        firing = {name_of(each["labels"]) for each in mine if each["state"] == "firing"}
        descriptions = {
            name_of(each["labels"]): " ".join(each["annotations"].values()) for each in mine
        }
        progress.waits_for = ""
        if firing != step.alerts:
            differs = _listed(firing ^ step.alerts)
            progress.waits_for = f"{_listed(step.alerts)}; differs: {differs}"
        for alert, words in step.descriptions.items():
            if words not in descriptions.get(alert, ""):
                progress.waits_for = f"{words!r} in {descriptions.get(alert)!r}"
        expr = step.until.replace("BEGAN", str(progress.began[-1]))
        if not progress.waits_for and expr and not self.engine.query(expr):
            progress.waits_for = expr
        return not progress.waits_for

    def _unfinished(self) -> str:
        return "\n".join(
            f"{each.scenario.title!r}, step {len(each.began) - 1}: {each.waits_for}"
            for each in self.progress
            if not each.finished
        )


def run_all(folder: Path) -> dict[str, Any]:
    """Run all scenarios in ``folder``; returns what Prometheus recorded, as plain data."""
    with running(folder) as site:
        run = Run(site)
        problem = ""
        try:
            run.run()
        except TimeoutError as error:
            problem = str(error)
        return run.result() | {"problem": problem}


def _listed(names: Iterable[str]) -> str:
    return ", ".join(sorted(names)) or "nothing"
