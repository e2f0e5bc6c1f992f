"""A pair of exporters at a real Alertmanager: what one forgets, the other forgets."""

import time

import pytest

from ros_diagnostics_exporter.alertmanager import Alertmanager
from ros_diagnostics_exporter.forgetting import COMMENT, Forgetting
from ros_diagnostics_exporter.http_client import Client
from ros_diagnostics_exporter.model import Instant, Status
from support.state_driver import ERROR, StateDriver
from testbed import ports
from testbed.polling import until
from testbed.programs import MissingProgram
from testbed.servers import alertmanager, running


class Half:
    """One exporter of the pair, with a motor that is a fault."""

    def __init__(self, url: str) -> None:
        self.driver = StateDriver()
        self.driver.raw_every(1, 20, Status(ERROR, "Motor", "Hot"))
        assert self.faults() == 1
        self.alertmanager = Alertmanager([url])
        self.forgetting = Forgetting(self.driver.state, self.alertmanager)

    def faults(self) -> int:
        return len(self.driver.state.faults())

    def follows(self) -> bool:
        self.alertmanager.update("f", self.driver.now)
        self.forgetting.forget_passed_on(self.driver.now)
        return self.faults() == 0


def test_what_one_half_forgets_the_other_reads_from_alertmanager(tmp_path):
    config = tmp_path / "alertmanager.yml"
    config.write_text("{route: {receiver: none}, receivers: [{name: none}]}")
    address = f"127.0.0.1:{ports.free_port()}"
    try:
        server = alertmanager(tmp_path, config, address)
    except MissingProgram as missing:
        pytest.skip(str(missing))
    with running(server):
        one, other = (Half(f"http://{address}") for _ in range(2))
        now = Instant(one.driver.now.mono, time.time())  # Alertmanager wants a silence of today
        assert one.forgetting.forget("r", "Motor", now) == (1, True)
        until(other.follows, "the other half has forgotten it", 30)
        [silence] = Client(f"http://{address}").get("/api/v2/silences")
        assert silence["comment"] == COMMENT
