"""A running stack with the day's short durations, and what the day's events do to its servers."""

from __future__ import annotations

import json
import signal
import time
import urllib.request
from typing import Any

from aiosmtpd.smtp import SMTP, Envelope, Session

from e2e.day.plan import ESCALATE, LATE, START, Event, fleet_config, scenario
from e2e.day.record import Line, of_event
from ros_diagnostics_tools.commands import ack
from support import short_clocks
from support.sns import Phone, with_text_messages
from testbed import configuration, http, programs
from testbed.mail import Inbox
from testbed.polling import until
from testbed.stack import Server, Stack

INTERVAL = 2  # seconds, of scrapes, evaluations and groups


class RejectingInbox(Inbox):
    """An inbox that rejects mails for a time, with the answer to try again later."""

    rejects = False

    async def handle_MAIL(  # noqa: N802 - aiosmtpd's name
        self, _server: SMTP, _session: Session, envelope: Envelope, sender: str, options: list[str]
    ) -> str:
        if self.rejects:
            return "451 4.3.0 try again later"
        envelope.mail_from = sender
        envelope.mail_options.extend(options)
        return "250 OK"


class Day:
    """The running stack, and the time since the day's first event."""

    def __init__(self, stack: Stack, inbox: RejectingInbox, sns_server: str, phone: Phone) -> None:
        self.stack = stack
        self.inbox = inbox
        self.sns_server = sns_server
        self.phone = phone
        self.folder = stack.prometheus.process.log_path.parent
        self.began = 0.0

    def messages(self) -> list[tuple[float, str, str]]:
        """What has arrived: second of the day, mail or SMS, and subject or first sentence."""
        mails = [(each.received - self.began, "mail", each.subject) for each in self.inbox.mails()]
        texts = [
            (each.received - self.began, "SMS", each.text.partition(".")[0] + ".")
            for each in self.phone.texts()
        ]
        return sorted(mails + texts)

    def recorded(self) -> list[Line]:
        """What the exporter has recorded of notifications."""
        url = f"http://{self.stack.addresses.exporter}/api/v1/events?kind=notified&limit=1000"
        with urllib.request.urlopen(url, timeout=10) as answer:
            return sorted(map(of_event, json.load(answer)["events"]))

    def shorten_durations(self) -> None:
        """Write the short durations to the configuration, and reload it."""
        prometheus = self.folder / "prometheus"
        short_clocks.set_interval(prometheus, INTERVAL)
        short_clocks.set_escalation(prometheus / "rules", {"1": f"{ESCALATE}s"})
        short_clocks.edit(
            self.folder / "alertmanager" / "alertmanager.yml", self._enable_text_messages
        )
        (self.folder / "fleet.yml").write_text(fleet_config(self.stack.domain_id))
        for server in (self.stack.prometheus, self.stack.exporter):
            server.process.signal(signal.SIGHUP)
        # Else a killed one forgets what it has sent.
        process = self.stack.alertmanager.process
        process.argv = [*process.argv, "--data.maintenance-interval=1s"]
        restart(self.stack.alertmanager)

    def _enable_text_messages(self, config: dict[str, Any]) -> None:
        enabled = with_text_messages(self.sns_server)
        config.update(route=enabled["route"], receivers=enabled["receivers"])
        configuration.set_addresses(config, self.stack.addresses)
        config["route"]["group_interval"] = f"{INTERVAL}s"

    def start_robots(self) -> None:
        """Replace the robots by the six of the scenario."""
        robots = self.stack.robots.process
        robots.stop()
        path = self.folder / "day.yaml"
        path.write_text(scenario())
        where = ["--domain-id", str(self.stack.domain_id)]
        robots.log_path = self.folder / "day.log"  # the old log already has the line "ready"
        robots.argv = [programs.own("virtual-robots"), "--scenario", str(path), *where]
        robots.start()
        robots.wait_for_output("ready: 6 virtual robots", 30)
        # The robots' time starts when they write this line.
        self.began = robots.log_path.stat().st_mtime + START

    def reach(self, at: float) -> None:
        """Wait for this second of the day."""
        until(lambda: time.time() >= self.began + at, f"second {at} of the day", 120)

    def act(self, event: Event) -> None:
        """Do what the event says to the servers."""
        if event.after:
            until(lambda: event.after in {each[2] for each in self.messages()}, event.after, LATE)
        {
            "wait": lambda _: None,
            "acknowledge": self.acknowledge,
            "maintain": self.maintain,
            "kill exporter": self.kill_exporter,
            "restart prometheus": lambda _: restart(self.stack.prometheus),
            "kill alertmanager": self.kill_alertmanager,
            "reject mails": self.reject_mails,
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

    def kill_alertmanager(self, event: Event) -> None:
        self.stack.alertmanager.process.kill()
        self.reach(event.at + 8)
        restart(self.stack.alertmanager)

    def reject_mails(self, event: Event) -> None:
        self.inbox.rejects = True
        self.reach(event.at + (event.lasts or 0))
        self.inbox.rejects = False

    def cut_off(self, event: Event) -> None:
        self.stack.robots.process.signal(signal.SIGSTOP)
        self.reach(event.at + (event.lasts or 0))
        self.stack.robots.process.signal(signal.SIGCONT)


def restart(server: Server) -> None:
    server.process.stop()
    server.process.start()
    until(lambda: http.answers(server.address, "/-/ready"), f"{server.name} is ready", 60)
