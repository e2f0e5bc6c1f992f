"""Two Prometheus and two Alertmanagers on one fleet, whose mail server is down for a time.

Both Prometheus scrape the exporter and send alerts to both Alertmanagers: no mail is lost, and none
is sent twice but of faults during which the mail server was down, when both Alertmanagers retry.
"""

import shutil
from collections import Counter
from typing import Any

import pytest
import yaml

from support.alertmanager_cluster import PEER_TIMEOUT, clustered, sees_two
from support.mailbox import settled
from testbed import http, servers, short_clocks
from testbed.engine import Engine
from testbed.polling import until
from testbed.site import Site, free_address

PROBLEM = "** PROBLEM ** demo/robot_{} Motor 2 is CRITICAL"
RECOVERY = "** RECOVERY ** demo/robot_{} Motor 2 is no longer CRITICAL"


class Pairs:
    """The stack with two of each server, by name and number."""

    def __init__(self, stack: Site) -> None:
        self.stack = stack
        self.alertmanagers = [stack.alertmanager]
        self.prometheuses = [stack.prometheus]
        self._pair_alertmanagers([free_address() for _ in range(2)])
        self._pair_prometheuses()

    def _pair_alertmanagers(self, gossip: list[str]) -> None:
        """Start the second, and restart the first with the second as its peer."""
        first, folder = self.stack.alertmanager, self.stack.folder
        first.process.stop()
        config = folder / "alertmanager" / "alertmanager.yml"
        (folder / "1").mkdir()
        second = servers.alertmanager(folder / "1", config, free_address())
        self.alertmanagers.append(second)
        for server, addresses in ((first, gossip), (second, gossip[::-1])):
            server.process.argv = verbose(clustered(server.process.argv, *addresses))
            self.stack.start(server)
        addresses = [each.address for each in self.alertmanagers]
        until(lambda: all(map(sees_two, addresses)), "the pair of Alertmanagers", 60)

    def _pair_prometheuses(self) -> None:
        """Start the second; give both all Alertmanagers, and each its replica label."""
        folder = self.stack.folder
        targets = folder / "prometheus" / "targets" / "alertmanager.yml"
        addresses = [each.address for each in self.alertmanagers]
        targets.write_text(yaml.safe_dump([{"targets": addresses}]))
        shutil.copytree(folder / "prometheus", folder / "1" / "prometheus")
        for number, config in enumerate(
            (
                folder / "prometheus" / "prometheus.yml",
                folder / "1" / "prometheus" / "prometheus.yml",
            )
        ):
            label = {"external_labels": {"replica": str(number)}}
            short_clocks.edit(config, lambda content, label=label: content["global"].update(label))
        self.stack.prometheus.restart()
        self.prometheuses.append(
            self.stack.start(servers.prometheus(folder / "1", config, free_address()))
        )
        until(self._all_send_to_all, "both Prometheus, with the states of all robots", 90)

    def _all_send_to_all(self) -> bool:
        try:
            return all(
                len(engine.query("robot:ros_diagnostics_state:rank == 0")) == 3
                and len(_alertmanagers_of(engine.address)) == 2
                for engine in self._engines()
            )
        except http.Unanswered:
            return False

    def _engines(self) -> list[Engine]:
        return [Engine(each.address) for each in self.prometheuses]

    def have_given_up(self, robot: str) -> bool:
        """Whether the robot's alert has ended, and no Alertmanager tries to send it any more.

        An attempt that began while it fired sends that for ten seconds yet. Those of one alert come
        one after the other, so none does once one has begun with the end.
        """
        firing = FIRING.format(robot)
        return not any(each.query(firing) for each in self._engines()) and all(
            self._last_attempt(number, robot).endswith("[resolved]]") for number in range(2)
        )

    def _last_attempt(self, alertmanager: int, robot: str) -> str:
        """What it last tried to send of the robot's alerts, as it logs it."""
        log = self.alertmanagers[alertmanager].process.output()
        found = [
            line.rstrip('"')
            for line in log.splitlines()
            if "msg=flushing" in line and f'robot=\\"{robot}\\"' in line
        ]
        return found[-1] if found else ""

    def subjects(self) -> list[str]:
        """The mails about robots; after a minute there is one about the killed Alertmanager too."""
        return [each for each in self.stack.inbox.subjects() if " demo/robot_" in each]

    def settled(self, number: int) -> list[str]:
        """All subjects, once so many mails arrived and each server had time for one too many."""
        # An evaluation of the other Prometheus, group_interval, and the other's peer timeout.
        pause = 5 + 5 + 2 * PEER_TIMEOUT + 1
        return settled(self.subjects, number, within=90, pause=pause)


def verbose(argv: list[str]) -> list[str]:
    """The command line of an Alertmanager that logs what each attempt sends."""
    return [part.replace("--log.level=warn", "--log.level=debug") for part in argv]


def _alertmanagers_of(address: str) -> list[Any]:
    found = http.get_json(address, "/api/v1/alertmanagers")
    return list(found["data"]["activeAlertmanagers"])


@pytest.fixture
def pairs(stack: Site) -> Pairs:
    return Pairs(stack)


FIRING = 'ALERTS{{scope="component", robot="{}", alertstate="firing"}}'
FAILED = 'alertmanager_notifications_failed_total{integration="email"} > 0'


@pytest.mark.slow
def test_after_the_mail_server_was_down_nothing_is_lost_and_nothing_comes_more_than_twice(
    pairs: Pairs,
):
    stack = pairs.stack
    stack.fault("robot_2", "Motor 2", "error", "winding at 131 C")
    before = [PROBLEM.format(2)]
    assert pairs.settled(1) == before

    stack.mail_server.stop()
    stack.fault("robot_2", "Motor 2", "ok")
    stack.fault("robot_3", "Motor 2", "error")
    until(lambda: len(stack.query(FAILED)) == 2, "both Alertmanagers fail to send", 120)
    stack.fault("robot_1", "Motor 2", "error")
    until(lambda: stack.query(FIRING.format("robot_1")), "the alert of robot_1", 60)
    stack.fault("robot_1", "Motor 2", "ok")
    until(lambda: pairs.have_given_up("robot_1"), "nobody tries to send its alert", 120)

    stack.mail_server.start()
    afterwards = {RECOVERY.format(2), PROBLEM.format(3)}
    until(lambda: afterwards <= set(pairs.subjects()), lambda: f"{pairs.subjects()}", 120)
    found = Counter(pairs.settled(3)[1:])
    # Nobody was notified of robot_1: nobody needs its recovery.
    assert set(found) == afterwards
    assert max(found.values()) <= 2, found
    print(f"mails after the outage: {dict(found)}")

    stack.fault("robot_3", "Motor 2", "ok")
    number = len(pairs.subjects())
    recovery = RECOVERY.format(3)
    # Since the outage both no longer send at the same moments, so that an attempt of the second may
    # have begun before the end and send after the first has sent the recovery, or send it, too.
    once, again = [recovery], [recovery, PROBLEM.format(3), recovery]
    assert pairs.settled(number + 1)[number:] in (once, again, [recovery, recovery])
