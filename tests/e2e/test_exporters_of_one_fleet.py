"""Exporters of one fleet: one for each subnet, and two that share the robots of a LAN."""

from collections.abc import Callable

import pytest

from ros_diagnostics_exporter.config.shard import Shard
from support.orders import Orders
from testbed.polling import until
from testbed.site import Exporter, Site

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]

FLEET = """
fleet: hall
exporter: {name}
profiles: {{default: {{stale_after: 4s, confirm_after: 2s}}}}
faults: {{restart_grace: 8s}}
robots:
  - {{name: {name}_1, namespace: /robot_1, domain_id: {domain}}}
  - {{name: {name}_2, namespace: /robot_2, domain_id: {domain}}}
"""
Alert = tuple[str, ...]  # name, exporter, robot


class Subnet:
    """Two virtual robots in a domain of their own, and the exporter that serves them."""

    def __init__(self, site: Site, name: str) -> None:
        self.name = name
        domain = site.lease()
        config = site.write(f"{name}.yml", FLEET.format(name=name, domain=domain))
        site.start_robots(2, domain_id=domain, name=f"{name}-robots")
        self._server = site.start_exporter(config, name=name, domain_id=domain)
        self.exporter = self._server.process
        self.orders = site.use(Orders(domain))

    def receives_both(self) -> bool:
        return len(self._server.receives()) == 2

    def motor(self, level: str) -> None:
        """Set the level of a motor of the first robot."""
        self.orders.give([("robot_1/Motor 1", level)])


class Alerts:
    """What fires about the fleet."""

    def __init__(self, site: Site) -> None:
        self.engine = site.engine

    def firing(self) -> set[Alert]:
        return {
            (
                labels["alertname"].removeprefix("RosDiagnostics"),
                labels.get("exporter", ""),
                labels.get("robot", ""),
            )
            for labels in self.engine.firing()
            if labels.get("fleet") == "hall"
        }

    def becomes(self, *alerts: Alert, keeps: Alert | None = None) -> None:
        """Wait until just these fire; ``keeps`` fires all the time."""

        def reached() -> bool:
            firing = self.firing()
            assert keeps is None or keeps in firing, f"{keeps} resolved: {firing}"
            return firing == set(alerts)

        until(reached, lambda: f"{alerts}; firing: {self.firing()}", 120, every=0.5)


class Subnets(Alerts):
    """Both subnets."""

    def __init__(self, site: Site) -> None:
        super().__init__(site)
        self.north, self.south = (Subnet(site, name) for name in ("north", "south"))
        site.start_alertmanager()


@pytest.fixture
def subnets(site: Site) -> Subnets:
    found = Subnets(site)
    for each in (found.north, found.south):
        until(each.receives_both, f"both robots of {each.name} are received", 120)
    site.start_prometheus(interval=1, tenth=True)
    site.wait_until_ready()
    return found


NORTH = ("ComponentCritical", "", "north_1")
SOUTH = ("ComponentCritical", "", "south_1")


def test_each_exporter_judges_its_robots_and_holds_their_faults_alone(subnets: Subnets):
    robots = subnets.engine.value
    count = 'sum(site_robot_group:ros_diagnostics_robots:count{fleet="hall"})'
    until(lambda: robots(count) == 4, "4", 60)
    subnets.north.motor("error")
    subnets.south.motor("error")
    subnets.becomes(NORTH, SOUTH)

    subnets.north.exporter.kill()
    subnets.becomes(NORTH, SOUTH, ("ExporterDown", "north", ""), keeps=NORTH)
    # What south serves and what it no longer serves is nothing that ends a fault of north's robots.
    subnets.south.motor("ok")
    subnets.becomes(NORTH, ("ExporterDown", "north", ""), keeps=NORTH)
    well = 'sum(site_robot_group:ros_diagnostics_robots:count{state="ok"})'
    until(lambda: robots(well) == 2, lambda: f"2 robots are OK, not {robots(well)}", 30)
    subnets.north.exporter.start()
    subnets.becomes(NORTH, keeps=NORTH)
    subnets.north.motor("ok")
    subnets.becomes()


SHARED = """
fleet: hall
profiles: {{default: {{stale_after: 4s, confirm_after: 8s}}}}
faults: {{restart_grace: 8s}}
discovery:
  - {{topic: "/{{robot}}/diagnostics_agg", domain_ids: [{domain}], labels: {{site: lan}}}}
"""
ROBOTS = {f"robot_{number}" for number in range(1, 9)}


def test_two_exporters_share_the_robots_of_a_lan(site: Site):
    """Each robot is served by one; that all are silent is one fault, though each has but a part."""
    config = site.write("fleet.yml", SHARED.format(domain=site.domain_id))
    robots = site.start_robots(len(ROBOTS))
    site.start_alertmanager()
    prometheus = f"--prometheus.url=http://{site.addresses.prometheus}"
    servers = [
        site.start_exporter(config, f"--shard={number}/2", prometheus, name=f"shard-{number}")
        for number in (1, 2)
    ]
    served = [set[str](), set[str]()]

    def all_served() -> bool:
        served[:] = [set(each.receives()) for each in servers]
        return served[0] | served[1] == ROBOTS

    until(all_served, lambda: f"all robots are received: {served}", 120)
    assert all(served)
    assert not served[0] & served[1]
    site.start_prometheus(interval=1, tenth=True)
    site.wait_until_ready()
    alerts, orders = Alerts(site), site.use(Orders(site.domain_id))
    broken = [min(each) for each in served]
    orders.give([(f"{name}/Motor 1", "error") for name in broken])
    alerts.becomes(*(("ComponentCritical", "", name) for name in broken))
    orders.give([(f"{name}/Motor 1", "ok") for name in broken])
    alerts.becomes()

    counted = 'count(ros_diagnostics_shard_robots{scope="common", state="present"} > 0)'
    until(lambda: alerts.engine.value(counted) == 2, "both say how many robots they have", 60)
    robots.process.stop()
    alerts.becomes(("FleetPartDown", "shard", ""))
    robots.process.start()
    alerts.becomes()


def test_a_robot_that_moves_to_a_third_exporter_keeps_its_fault(site: Site):
    """The third is started first; then both others start again, from their databases."""
    config = site.write("fleet.yml", SHARED.format(domain=site.domain_id))
    site.start_robots(len(ROBOTS))
    site.start_alertmanager()
    prometheus = f"--prometheus.url=http://{site.addresses.prometheus}"

    def make(number: int, count: int) -> Exporter:
        database = f"--storage.path={site.folder / f'shard-{number}.db'}"
        flags = (f"--shard={number}/{count}", prometheus, database)
        return site.make_exporter(config, *flags, name=f"exporter-{number}-of-{count}")

    two, three = ([make(number, count) for number in range(1, count + 1)] for count in (2, 3))
    for each in two:
        site.start(each)
    until(lambda: {name for each in two for name in each.receives()} == ROBOTS, "all", 120)
    site.start_prometheus(interval=1, tenth=True)
    alerts, orders = Alerts(site), site.use(Orders(site.domain_id))
    moves = min(name for name in ROBOTS if Shard(3, 3).has(name))
    fault = ("ComponentCritical", "", moves)
    orders.give([(f"{moves}/Motor 1", "error")])
    until(lambda: fault in alerts.firing(), "the fault fires", 60)

    def wait(reached: Callable[[], bool], what: str) -> None:
        def is_reached() -> bool:
            assert fault in alerts.firing(), "it has resolved"
            return reached()

        until(is_reached, what, 120, every=0.5)

    site.start(three[2])
    settled = 'ros_diagnostics_exporter_settled{exporter="shard-3"}'
    wait(lambda: alerts.engine.value(settled) == 1, "the third has settled")
    for old, new in zip(two, three, strict=False):
        old.process.stop()
        site.start(new)
        wait(lambda new=new: bool(new.receives()), f"{new.name} receives robots")
    wait(
        lambda: sorted(n for each in three for n in each.receives()) == sorted(ROBOTS), "each once"
    )
    assert moves in three[2].receives()
    orders.give([(f"{moves}/Motor 1", "ok")])
    until(lambda: fault not in alerts.firing(), "it is over", 60)
