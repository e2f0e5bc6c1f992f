"""A pair of Alertmanagers of which one is killed: no mail is lost, none is sent twice."""

import pytest
import yaml

from support.alertmanager_cluster import PEER_TIMEOUT, clustered, sees_two
from support.alerts import fault, post_alerts
from support.mailbox import settled
from testbed import configuration
from testbed.configuration import CHECKOUT
from testbed.polling import until
from testbed.programs import alertmanager
from testbed.servers import Server
from testbed.site import Site, free_address

PROBLEM = "** PROBLEM ** f/r1 Motor 1 is CRITICAL"
RECOVERY = "** RECOVERY ** f/r1 Motor 1 is no longer CRITICAL"

CONFIG = yaml.safe_load((CHECKOUT / "alertmanager" / "alertmanager.yml").read_text())
SHIPPED = CONFIG["route"]["group_interval"]


class Pair:
    """Two Alertmanagers in a cluster; alerts are sent to both, as Prometheus does."""

    def __init__(self, site: Site, group_interval: str) -> None:
        self.inbox = site.inbox
        site.start_mail_server()
        config = configuration.alertmanager(
            site.folder,
            site.addresses,
            edit=lambda it: it["route"].update(group_interval=group_interval),
        )
        gossip = [free_address() for _ in range(2)]
        self.halves: list[Server] = []
        for number, (mine, other) in enumerate([gossip, gossip[::-1]]):
            address = free_address()
            alone = alertmanager(config, address, site.folder / f"data{number}")
            argv = clustered(alone, mine, other)
            self.halves.append(site.start_program(f"half{number}", argv, address))
        until(lambda: all(sees_two(each.address) for each in self.halves), "the pair", 60)

    def post(self, *, resolved: bool = False) -> None:
        for each in self.halves:
            if each.process.alive:
                post_alerts(each.address, fault("Motor 1"), resolved=resolved)

    def settled(self, number: int) -> list[str]:
        """All subjects, once so many mails have arrived and each half had time for one too many."""
        return settled(self.inbox.subjects, number, within=60, pause=2 * PEER_TIMEOUT + 2)


@pytest.fixture
def pair(request: pytest.FixtureRequest, site: Site) -> Pair:
    """The pair; its parameter is group_interval, by default shorter than the shipped one."""
    return Pair(site, getattr(request, "param", "1s"))


@pytest.mark.parametrize("killed", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_with_one_half_killed_every_mail_is_sent_once(pair: Pair, killed: int):
    pair.post()
    assert pair.settled(1) == [PROBLEM]

    pair.halves[killed].process.kill()
    pair.post(resolved=True)
    assert pair.settled(2) == [PROBLEM, RECOVERY]

    pair.post()
    assert pair.settled(3) == [PROBLEM, RECOVERY, PROBLEM]


@pytest.mark.slow
@pytest.mark.parametrize("pair", [SHIPPED], indirect=True)
def test_with_both_running_no_problem_follows_a_recovery(pair: Pair):
    """With a peer timeout longer than group_interval, the second still sends what has ended."""
    pair.post()
    assert pair.settled(1) == [PROBLEM]

    pair.post(resolved=True)
    assert pair.settled(2) == [PROBLEM, RECOVERY]
