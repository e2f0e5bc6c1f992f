"""Whether a Prometheus reads the faults: if none does, pages and `status` say since when."""

import pytest

from ros_diagnostics_exporter.config.fleet import Fleet
from ros_diagnostics_exporter.fleet_texts import unread_text
from ros_diagnostics_exporter.model import Instant, Part
from ros_diagnostics_exporter.service import Service
from ros_diagnostics_exporter.web.pages import landing

STARTED = 43_380.0  # 12:03:00 UTC
UPTIME = 1_000.0  # of the machine: no time is measured from its start
UNREAD = "Prometheus has not read the faults since 12:0{}:00 UTC: nobody is notified"


class Clock:
    """The service's clocks, which a test sets."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.second, self.set_by = 0.0, 0.0
        monkeypatch.setattr("ros_diagnostics_exporter.service.read_clocks", self.read)

    def read(self) -> Instant:
        return Instant(UPTIME + self.second, STARTED + self.second + self.set_by)


@pytest.fixture
def clock(monkeypatch):
    return Clock(monkeypatch)


@pytest.fixture
def service(clock, tmp_path):
    return Service(Fleet("f", exporter="x"), tmp_path / "fleet.yml", None)


def said(service: Service) -> str:
    return unread_text(service.fleet_snapshot())


def test_it_is_said_since_when_no_prometheus_reads_the_faults(service, clock):
    clock.second = 150.0  # two scrapes of a minute may fail
    assert said(service) == ""
    clock.second = 151.0
    assert said(service) == UNREAD.format(3)  # since the start

    service.render_metrics(False, frozenset({Part.FAULTS}))
    assert said(service) == ""

    clock.second = 240.0
    service.render_metrics(False, frozenset({Part.ROBOTS}))  # no fault is in it
    clock.second = 331.0
    text = said(service)
    assert text == "Prometheus has not read the faults since 12:05:31 UTC: nobody is notified"
    assert f"<p class=alarm role=alert>{text}</p>" in landing(service.fleet_snapshot(), "/metrics")


def test_a_clock_that_is_set_stops_no_prometheus(service, clock):
    service.render_metrics(False, frozenset({Part.FAULTS}))
    clock.second, clock.set_by = 2.0, 86_400.0
    assert said(service) == ""
