"""A site with the day's short durations, and what the day's events do to its servers."""

import json
import re
import signal
import time
import urllib.request
from pathlib import Path
from typing import Any

from aiosmtpd.smtp import SMTP, Envelope, Session

from e2e.day.plan import ESCALATE, LATE, START, Event, fleet_config, scenario
from e2e.day.record import Line, of_event
from ros_diagnostics_tools.main import main
from support.sns import Phone, with_text_messages
from testbed import short_clocks
from testbed.mail import Inbox
from testbed.polling import until
from testbed.site import Site

INTERVAL = 2  # seconds, of scrapes, evaluations and groups
BEGAN = re.compile(r" \d\d:\d\d UTC")  # in a text message


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
    """The running site, and the time since the day's first event."""

    def __init__(self, site: Site, inbox: RejectingInbox, sns_server: str, phone: Phone) -> None:
        self.site = site
        self.inbox = inbox
        self.phone = phone
        self.began = 0.0
        site.start_mail_server()
        site.start_exporter(site.write("fleet.yml", fleet_config(site.domain_id)))

        def escalate_soon(prometheus: Path) -> None:
            short_clocks.set_escalation(prometheus / "rules", {"1": f"{ESCALATE}s"})

        site.start_prometheus(interval=INTERVAL, edit=escalate_soon)

        def enable_text_messages(config: dict[str, Any]) -> None:
            enabled = with_text_messages(sns_server)
            config.update(route=enabled["route"], receivers=enabled["receivers"])
            config["route"]["group_interval"] = f"{INTERVAL}s"

        site.start_alertmanager(
            "--data.maintenance-interval=1s",  # else a killed one forgets what it has sent
            recorder=site.exporter.address,
            edit=enable_text_messages,
            links=True,
        )
        site.wait_until_ready()

    def start_robots(self) -> None:
        """Start the six of the scenario."""
        robots = self.site.start_robots(scenario=self.site.write("day.yaml", scenario())).process
        robots.wait_for_output("ready: 6 virtual robots", 30)
        # The robots' time starts when they write this line.
        self.began = robots.log_path.stat().st_mtime + START

    def messages(self) -> list[tuple[float, str, str]]:
        """What has arrived: second of the day, mail or SMS, and subject or first sentence.

        Of a text message without the time at which the trouble began.
        """
        mails = [(each.received - self.began, "mail", each.subject) for each in self.inbox.mails()]
        texts = [
            (each.received - self.began, "SMS", BEGAN.sub("", each.text.partition(".")[0]) + ".")
            for each in self.phone.texts()
        ]
        return sorted(mails + texts)

    def recorded(self) -> list[Line]:
        """What the exporter has recorded of notifications."""
        url = f"http://{self.site.addresses.exporter}/api/v1/events?kind=notified&limit=1000"
        with urllib.request.urlopen(url, timeout=10) as answer:
            return sorted(map(of_event, json.load(answer)["events"]))

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
            "restart prometheus": lambda _: self.site.prometheus.restart(),
            "kill alertmanager": self.kill_alertmanager,
            "reject mails": self.reject_mails,
            "cut off": self.cut_off,
        }[event.act](event)

    def acknowledge(self, event: Event) -> None:
        url = f"http://{self.site.addresses.alertmanager}"
        assert main(["ack", event.robot, "--comment", "part ordered", "--alertmanager", url]) == 0

    def maintain(self, event: Event) -> None:
        now = time.time()
        config = fleet_config(self.site.domain_id, (now, now + (event.lasts or 0)))
        self.site.exporter.config.write_text(config)
        self.site.exporter.process.signal(signal.SIGHUP)

    def kill_exporter(self, event: Event) -> None:
        self.site.exporter.process.kill()
        self.reach(event.at + 8)
        self.site.exporter.process.start()

    def kill_alertmanager(self, event: Event) -> None:
        self.site.alertmanager.process.kill()
        self.reach(event.at + 8)
        self.site.alertmanager.restart()

    def reject_mails(self, event: Event) -> None:
        self.inbox.rejects = True
        self.reach(event.at + (event.lasts or 0))
        self.inbox.rejects = False

    def cut_off(self, event: Event) -> None:
        self.site.robots.process.signal(signal.SIGSTOP)
        self.reach(event.at + (event.lasts or 0))
        self.site.robots.process.signal(signal.SIGCONT)
