"""The canary comes back through real servers; if not, the heartbeat to the outside stops."""

import json
import re
import signal
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import yaml

from support import heartbeat
from testbed import short_clocks
from testbed.configuration import CHECKOUT
from testbed.polling import until
from testbed.site import Site
from testbed.stack import Plan, running

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]

COUNT = "sum(ros_diagnostics_canary_notification_seconds_count)"
LOST = 'ALERTS{alertname="RosDiagnosticsCanaryLost", alertstate="firing"}'
LOST_AFTER = 30  # seconds, instead of two minutes
LOST_SUBJECT = "is waiting for its test notification"
QUIET = 20.0  # seconds without a heartbeat, which is posted every 3 to 5, until it has stopped
SOON = 120.0  # seconds in which anything here happens on a busy machine


class Watched(NamedTuple):
    """The stack, and what receives its heartbeat."""

    stack: Site
    outside: heartbeat.Heartbeat
    folder: Path

    def edit(self, change: Any) -> None:
        """Change Alertmanager's configuration while it runs."""
        short_clocks.edit(self.folder / "alertmanager" / "alertmanager.yml", change)
        self.stack.alertmanager.process.signal(signal.SIGHUP)

    def stops(self) -> None:
        """Wait until nothing has been posted for a while."""
        until(lambda: self.outside.quiet > QUIET, "the heartbeat stops", SOON)

    def beats(self) -> None:
        """Wait for two further heartbeats."""
        before = len(self.outside.beats)
        until(lambda: len(self.outside.beats) >= before + 2, "the heartbeat", SOON)


@pytest.fixture
def watched(tmp_path: Path) -> Iterator[Watched]:
    with running(tmp_path, Plan(robots=3)) as stack, heartbeat.listening() as outside:
        watched = Watched(stack, outside, tmp_path)
        hurry(tmp_path / "prometheus" / "rules")
        watched.edit(lambda config: uncomment_heartbeat(config, outside.url))
        fleet = tmp_path / "fleet.yml"
        fleet.write_text(f"{fleet.read_text()}canary: 1m\n")
        for server in (stack.prometheus, stack.exporter):
            server.process.signal(signal.SIGHUP)
        yield watched


def hurry(rules: Path) -> None:
    """Let the alert about a lost canary fire after seconds."""
    path = rules / "monitoring.yml"
    text = path.read_text()
    rule = re.search(r"- alert: RosDiagnosticsCanaryLost\n.*?(?=\n\n|\Z)", text, re.DOTALL)
    assert rule
    assert rule[0].count("> 120") == 1
    path.write_text(text.replace(rule[0], rule[0].replace("> 120", f"> {LOST_AFTER}")))
    for name in ("monitoring.yml", "servers.yml"):
        short_clocks.edit(rules / name, lambda it: it["groups"][0].update(interval="2s"))


def uncomment_heartbeat(config: dict[str, Any], url: str) -> None:
    """Enable the commented route as shipped, with shorter times."""
    shipped = (CHECKOUT / "alertmanager" / "alertmanager.yml").read_text()
    first = r"- matchers: \[alertname = RosDiagnosticsWatchdog\]"
    lines = re.search(rf"    # ({first}(\n    # .*)*)", shipped)
    assert lines
    [route] = yaml.safe_load(lines[1].replace("    # ", ""))
    assert route["receiver"] == "heartbeat"
    route |= {"group_interval": "2s", "repeat_interval": "3s"}
    config["route"]["routes"].insert(0, route)
    receiver(config, "heartbeat")["url"] = url


def receiver(config: dict[str, Any], name: str) -> dict[str, Any]:
    """The webhook of a receiver."""
    [found] = [each for each in config["receivers"] if each["name"] == name]
    [webhook] = found["webhook_configs"]
    return webhook


def count(stack: Site) -> float:
    """How many canaries Prometheus knows of."""
    found = stack.query(COUNT)
    return found[0].value if found else 0.0


def seen_by_people(stack: Site) -> list[Any]:
    """What any place that people look at has of the canary."""
    found: list[Any] = []
    for path in ("faults", "events?limit=1000", "fleet"):
        url = f"http://{stack.addresses.exporter}/api/v1/{path}"
        with urllib.request.urlopen(url, timeout=10) as answer:
            content = json.load(answer)
        lists = [content.get("faults", []), content.get("events", [])]
        lists += [each["problems"] for each in content.get("robots", [])]
        found += [each for many in lists for each in many if "anary" in json.dumps(each)]
    return found + [mail.subject for mail in stack.inbox.mails()]


def test_the_canary_comes_back_again_and_again_and_nobody_else_sees_it(watched):
    stack = watched.stack
    alert = 'ALERTS{alertname="RosDiagnosticsCanary", alertstate="firing"}'
    until(lambda: stack.query(alert), "the canary's alert", SOON)
    until(lambda: count(stack) >= 1, "the canary", SOON)
    until(lambda: not stack.query(alert), "its end", SOON)
    until(lambda: count(stack) >= 2, "the next canary", 60 + SOON)

    mean = stack.query(f"sum(ros_diagnostics_canary_notification_seconds_sum) / {COUNT}")
    assert 0 < mean[0].value < LOST_AFTER
    found = stack.query('ros_diagnostics_canary_notification_seconds_bucket{le="60.0"}')
    assert [each.value for each in found] == [count(stack)]
    assert seen_by_people(stack) == []
    assert stack.query(LOST) == []
    watched.beats()


def test_the_heartbeat_stops_while_alertmanager_is_down_or_the_canary_does_not_come_back(watched):
    stack = watched.stack
    until(lambda: count(stack) >= 1, "the canary", SOON)
    watched.beats()
    assert stack.query(LOST) == []
    path = watched.folder / "alertmanager" / "alertmanager.yml"
    right = receiver(yaml.safe_load(path.read_text()), "canary")["url"]
    # Posted elsewhere, so that Alertmanager itself has no reason to complain.
    with heartbeat.listening() as elsewhere:
        watched.edit(lambda config: receiver(config, "canary").update(url=elsewhere.url))
        until(lambda: elsewhere.beats, "a canary that is posted elsewhere", 60 + SOON)
        until(lambda: stack.query(LOST), "the alert about the canary", SOON)
        watched.stops()
    subjects = stack.inbox.subjects
    until(lambda: LOST_SUBJECT in "".join(subjects()), lambda: f"its mail: {subjects()}", SOON)

    watched.edit(lambda config: receiver(config, "canary").update(url=right))
    until(lambda: not stack.query(LOST), "the canary is back", SOON)
    watched.beats()

    stack.alertmanager.process.stop()
    watched.stops()
    stack.alertmanager.process.start()
    watched.beats()
