"""Three hours of the simulation on real servers: the mailbox has the mails of its ledger."""

import re
import signal
import time
from collections import Counter
from pathlib import Path

import pytest
import yaml

from e2e.simulated import plan
from simulation.hours import ROBOTS, TICKS, hours, mails
from simulation.story import Event, Story
from testbed.polling import until
from testbed.site import Site

SEED = 3
LATE = 90.0  # seconds that a mail may take on a busy machine
TOO_MANY = 20.0  # seconds after the last expected mail, in which one too many would arrive
RELOADED = "reloaded the config: SIGHUP"
_OF_FAULTS = re.compile(r"\*\* (PROBLEM|RECOVERY|REMOVED|FLAPPING) \*\*")


class Hours:
    """The running site, and the time since the history's begin."""

    def __init__(self, site: Site, story: Story) -> None:
        self._site = site
        self._story = story
        self._done: list[tuple[Event, float]] = []
        self.mails = site.inbox.subjects
        site.start_mail_server()
        exporter = site.start_exporter(site.write("fleet.yml", self._fleet()))
        site.start_prometheus()
        site.start_alertmanager(recorder=exporter.address, links=True)
        site.wait_until_ready()
        site.write("simulated.yaml", yaml.safe_dump(plan.KIND))
        site.write("simulated.analyzers.yaml", yaml.safe_dump(plan.ANALYZERS))
        scenario = site.write("hours.yaml", plan.scenario(story, "./simulated.yaml"))
        robots = site.start_robots(scenario=scenario).process
        robots.wait_for_output(f"ready: {ROBOTS} virtual robots", 60)
        # The robots' time starts when they write this line.
        self._began = robots.log_path.stat().st_mtime + plan.START

    def reach(self, tick: float) -> None:
        """Wait for this tick of the history."""
        at = self._began + tick * plan.SECONDS
        until(lambda: time.time() >= at, f"tick {tick:g}", at - time.time() + 60)

    def act(self, event: Event) -> None:
        """Do what happens to the exporter."""
        self.reach(event.at)
        exporter = self._site.exporter.process
        if event.what == "restart":
            exporter.kill()
            self.reach(event.at + int(str(event.how[0])))
            exporter.start()
            return
        self._done.append((event, time.time()))
        self._configure()

    def _fleet(self) -> str:
        return plan.fleet_config(self._story, self._site.domain_id, self._done)

    def _configure(self) -> None:
        self._site.write("fleet.yml", self._fleet())
        exporter = self._site.exporter.process
        before = exporter.output().count(RELOADED)
        exporter.signal(signal.SIGHUP)
        until(lambda: exporter.output().count(RELOADED) > before, exporter.describe, 60)


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_three_hours_of_the_simulation(tmp_path: Path):
    story = hours(SEED)
    expected = plan.subjects(mails(story))
    with Site(tmp_path) as site:
        played = Hours(site, story)
        for event in story.events:
            if event.what in plan.ACTS:
                played.act(event)
        played.reach(TICKS)

        def missing() -> list[str]:
            return sorted((expected - Counter(played.mails())).elements())

        until(lambda: not missing(), lambda: f"{missing()}; arrived: {played.mails()}", LATE)
        played.reach(TICKS + TOO_MANY / plan.SECONDS)
        found = played.mails()
    of_faults = [each for each in found if _OF_FAULTS.match(each)]
    assert Counter(of_faults) == expected
    others = [each for each in found if each not in of_faults]
    assert [each for each in others if "** MAINTENANCE **" not in each] == []
    assert_problems_come_before_recoveries(of_faults)


def assert_problems_come_before_recoveries(found: list[str]) -> None:
    lasting: Counter[str] = Counter()
    for subject in found:
        if "** REMOVED **" in subject:
            about = subject.split(" ** ")[1].removesuffix("is no longer monitored")
            lasting.update({what: -1 for what in +lasting if what.strip().startswith(about)})
            continue
        ended = "no longer" in subject or "stopped" in subject
        what = re.sub(r"\*\* \w+ \*\*|no longer |stopped|started", "", subject)
        lasting[what] += -1 if ended else 1
        assert lasting[what] in (0, 1), subject
