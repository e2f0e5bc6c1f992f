"""The whole road with the day's short clocks, and what a day does to its servers."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml
from aiosmtpd.smtp import SMTP, Envelope, Session

from e2e.day.plan import LATE, SETTINGS, START, Event, fleet_config, scenario
from ros_diagnostics_exporter.cli import ack
from support.sns import Phone, with_text_messages
from testbed import http as asking
from testbed import programs
from testbed.mail import Inbox
from testbed.polling import until
from testbed.stack import Server, Stack

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


class Day:
    """The running road, and the time since the day's first event."""

    def __init__(self, stack: Stack, inbox: MoodyInbox, amazon: str, phone: Phone) -> None:
        self.stack = stack
        self.inbox = inbox
        self.amazon = amazon
        self.phone = phone
        self.folder = stack.prometheus.process.log_path.parent
        self.began = 0.0

    def told(self) -> list[tuple[float, str, str]]:
        """What has come: the second of the day, mail or SMS, and subject or first sentence."""
        mails = [(each.received - self.began, "mail", each.subject) for each in self.inbox.mails()]
        texts = [
            (each.received - self.began, "SMS", each.words.partition(".")[0] + ".")
            for each in self.phone.texts()
        ]
        return sorted(mails + texts)

    def shorten_clocks(self) -> None:
        """Write the short clocks where people write them, and have them read."""
        prometheus = self.folder / "prometheus"
        edit(prometheus / "rules" / "settings.yml", shorten)
        times = {"scrape_interval": INTERVAL, "evaluation_interval": INTERVAL}
        edit(prometheus / "prometheus.yml", lambda it: it["global"].update(times))
        edit(self.folder / "alertmanager" / "alertmanager.yml", self._switch_on_text_messages)
        (self.folder / "fleet.yml").write_text(fleet_config(self.stack.domain_id))
        for server in (self.stack.prometheus, self.stack.alertmanager, self.stack.exporter):
            server.process.signal(signal.SIGHUP)

    def _switch_on_text_messages(self, config: dict[str, Any]) -> None:
        switched_on = with_text_messages(self.amazon)
        config.update(route=switched_on["route"], receivers=switched_on["receivers"])
        config["route"]["group_interval"] = INTERVAL

    def start_robots(self) -> None:
        """Let the six robots of the scenario take the place of those that were there."""
        robots = self.stack.robots.process
        robots.stop()
        story = self.folder / "day.yaml"
        story.write_text(scenario())
        where = ["--domain-id", str(self.stack.domain_id)]
        robots.log_path = self.folder / "day.log"  # the other has a line that says ready
        robots.argv = [programs.own("virtual-robots"), "--scenario", str(story), *where]
        robots.start()
        robots.wait_for_output("ready: 6 virtual robots", 30)
        # The robots' clock starts just after this line was written, however late we read it.
        self.began = robots.log_path.stat().st_mtime + START

    def reach(self, at: float) -> None:
        """Wait until the day is so many seconds old."""
        until(lambda: time.time() >= self.began + at, f"second {at} of the day", 120)

    def act(self, event: Event) -> None:
        """Do what the event says to the servers, when it says so."""
        until(lambda: event.when in {"", *(each[2] for each in self.told())}, event.when, LATE)
        {
            "wait": lambda _: None,
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

    def maintain(self, event: Event) -> None:
        now = time.time()
        config = fleet_config(self.stack.domain_id, (now, now + (event.lasts or 0)))
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


def edit(path: Path, change: Callable[[Any], None]) -> None:
    content = yaml.safe_load(path.read_text())
    change(content)
    path.write_text(yaml.safe_dump(content, sort_keys=False))


def shorten(settings: dict[str, Any]) -> None:
    for rule in settings["groups"][0]["rules"]:
        name = rule["record"].split(":")[1]
        if name in SETTINGS:
            rule["expr"] = f"vector({SETTINGS[name]})"


def restart(server: Server) -> None:
    server.process.stop()
    server.process.start()
    until(lambda: asking.answers(server.address, "/-/ready"), f"{server.name} is ready", 60)
