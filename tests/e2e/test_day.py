"""The day of six robots over the whole road: every mail that has to come, and no other.

With the environment variable A_DAY naming a file, the day is written there as a page
(docs/a-day.md).
"""

from __future__ import annotations

import os
import signal
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from aiosmtpd.smtp import SMTP, Envelope, Session

from e2e.day import DAY, START, Event, fleet_config, page, scenario
from fleet_demo import asking, programs
from fleet_demo.mail import Inbox
from fleet_demo.stack import Plan, Stack, running
from fleet_demo.waiting import until
from ros_diagnostics_exporter import ack

SETTINGS = {
    "exporter_down_after": 30,
    "restart_grace": 8,
    "escalate_first": 50,
}
INTERVAL = "2s"


class MoodyInbox(Inbox):
    """A mail server that can have a bad time: it asks to try again later."""

    refuses = False

    async def handle_MAIL(  # noqa: N802 - aiosmtpd's name
        self, _server: SMTP, _session: Session, envelope: Envelope, sender: str, options: list[str]
    ) -> str:
        if self.refuses:
            return "451 4.3.0 come again later"
        envelope.mail_from = sender
        envelope.mail_options.extend(options)
        return "250 OK"


def edit(path: Path, change: Callable[[Any], None]) -> None:
    content = yaml.safe_load(path.read_text())
    change(content)
    path.write_text(yaml.safe_dump(content, sort_keys=False))


def shorten(settings: dict[str, Any]) -> None:
    for rule in settings["groups"][0]["rules"]:
        name = rule["record"].split(":")[1]
        if name in SETTINGS:
            rule["expr"] = f"vector({SETTINGS[name]})"


class Day:
    """The running road with the day's clocks, and the time since its first event."""

    def __init__(self, stack: Stack, inbox: MoodyInbox, folder: Path) -> None:
        self.stack = stack
        self.inbox = inbox
        self.folder = folder
        self.began = 0.0

    def shorten_clocks(self) -> None:
        """Write the short clocks where people write them, and have them read."""
        prometheus = self.folder / "prometheus"
        edit(prometheus / "rules" / "settings.yml", shorten)
        times = {"scrape_interval": INTERVAL, "evaluation_interval": INTERVAL}
        edit(prometheus / "prometheus.yml", lambda it: it["global"].update(times))
        alertmanager = self.folder / "alertmanager" / "alertmanager.yml"
        edit(alertmanager, lambda it: it["route"].update(group_interval=INTERVAL))
        (self.folder / "fleet.yml").write_text(fleet_config(self.stack.domain_id))
        for server in (self.stack.prometheus, self.stack.alertmanager, self.stack.exporter):
            server.process.signal(signal.SIGHUP)

    def start_robots(self) -> None:
        """Let the six robots of the scenario take the place of those that were there."""
        robots = self.stack.robots.process
        robots.stop()
        story = self.folder / "day.yaml"
        story.write_text(scenario())
        where = ["--domain-id", str(self.stack.domain_id)]
        robots.argv = [programs.own("virtual-robots"), "--scenario", str(story), *where]
        robots.start()
        robots.wait_for_output("ready: 6 virtual robots", 30)
        self.began = time.time() + START

    def reach(self, at: float) -> None:
        """Wait until the day is so many seconds old."""
        until(lambda: time.time() >= self.began + at, f"second {at} of the day", 120)

    def act(self, event: Event) -> None:
        """Do what the event says to the servers."""
        {
            "acknowledge": self.acknowledge,
            "maintain": self.maintain,
            "kill exporter": self.kill_exporter,
            "restart prometheus": lambda _: restart(self.stack.prometheus),
            "restart alertmanager": lambda _: restart(self.stack.alertmanager),
            "refuse mails": self.refuse_mails,
            "cut off": self.cut_off,
        }[event.act](event)

    def acknowledge(self, event: Event) -> None:
        url = f"http://{self.stack.addresses.alertmanager}"
        assert ack.main([event.robot, "--comment", "part ordered", "--url", url]) == 0

    def maintain(self, _event: Event) -> None:
        now = time.time()
        config = fleet_config(self.stack.domain_id, (now, now + 30))
        (self.folder / "fleet.yml").write_text(config)
        self.stack.exporter.process.signal(signal.SIGHUP)

    def kill_exporter(self, event: Event) -> None:
        self.stack.exporter.process.kill()
        self.reach(event.at + 8)
        self.stack.exporter.process.start()

    def refuse_mails(self, event: Event) -> None:
        self.inbox.refuses = True
        self.reach(event.at + (event.lasts or 0))
        self.inbox.refuses = False

    def cut_off(self, event: Event) -> None:
        self.stack.robots.process.signal(signal.SIGSTOP)
        self.reach(event.at + (event.lasts or 0))
        self.stack.robots.process.signal(signal.SIGCONT)


def restart(server: Any) -> None:
    server.process.stop()
    server.process.start()
    until(lambda: asking.answers(server.address, "/-/ready"), f"{server.name} is ready", 30)


@pytest.fixture
def day(tmp_path: Path) -> Iterator[Day]:
    inbox = MoodyInbox()
    with running(tmp_path, Plan(robots=6), inbox) as stack:
        yield Day(stack, inbox, tmp_path)


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_the_day_of_six_robots(day: Day):
    """Each problem is followed by exactly one recovery; nothing is missing, nothing is extra."""
    day.shorten_clocks()
    day.start_robots()
    for event in sorted(DAY, key=lambda each: each.at):
        if event.act:
            day.reach(event.at)
            day.act(event)
    expected = Counter(subject for event in DAY for subject in event.mails)

    def missing() -> Counter[str]:
        return expected - Counter(mail.subject for mail in day.inbox.mails())

    until(lambda: not missing(), lambda: f"these mails: {dict(missing())}", 60)
    day.reach(time.time() - day.began + 15)  # what is too much would come now
    told = [(mail.received - day.began, mail.subject) for mail in day.inbox.mails()]
    if "A_DAY" in os.environ:
        Path(os.environ["A_DAY"]).write_text(page(told))
    assert Counter(subject for _, subject in told) == expected
    assert_problems_come_before_recoveries(told)


def assert_problems_come_before_recoveries(told: list[tuple[float, str]]) -> None:
    open_problems: Counter[str] = Counter()
    for _, subject in told:
        kind, _, rest = subject.removeprefix("** ").partition(" ** ")
        if kind == "PROBLEM":
            open_problems[rest.replace(" is ", " ")] += 1
        elif kind == "RECOVERY":
            open_problems[rest.replace(" is no longer ", " ")] -= 1
            assert open_problems[rest.replace(" is no longer ", " ")] >= 0, subject


def test_the_page_of_the_day_has_every_mail_of_the_list():
    written = (Path(__file__).resolve().parents[2] / "docs" / "a-day.md").read_text()
    expected = Counter(subject for event in DAY for subject in event.mails)

    assert Counter({each: written.count(f"`{each}`") for each in expected}) == expected
