"""A small model of the alerts of an exporter's faults, and of people who acknowledge them.

An alert is what is served of a fault, until that ends. It escalates in two steps, which the silence
of an acknowledgement suppresses; never the alert itself, nor a step that was sent before.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from datetime import datetime, timezone
from typing import Any

from ros_diagnostics_exporter import acknowledging
from ros_diagnostics_exporter.acknowledging import Acknowledgeable
from ros_diagnostics_exporter.faults.model import Fault, as_texts, fault_of
from ros_diagnostics_exporter.firing import read as read_firing
from ros_diagnostics_exporter.metrics.exposition import Exposition
from ros_diagnostics_exporter.silences import (
    ESCALATION,
    IDENTITY,
    Acknowledgement,
    Alert,
    Silence,
    moment,
    since_text,
    valid,
)
from ros_diagnostics_exporter.silences import read as read_silences
from simulation.fleet_files import FLEET
from support.state_driver import StateDriver

STEPS = {"1": 60.0, "2": 300.0}  # of the escalation, seconds after the begin


def humanized(unix: float) -> str:
    """A time as rules write it, which cut it off at thousandths."""
    milliseconds = int(unix * 1000)
    date = datetime.fromtimestamp(milliseconds // 1000, timezone.utc)
    fraction = f".{milliseconds % 1000:03}".rstrip("0").rstrip(".")
    return f"{date:%Y-%m-%d %H:%M:%S}{fraction} +0000 UTC"


@dataclass
class _Taken:
    """An acknowledgement, and the steps that were sent before it."""

    silence: dict[str, Any]
    sent: frozenset[str]


@dataclass
class Alerts:
    """The alerts that fire by the id of their fault, what was sent of them, and the silences."""

    firing: dict[str, Alert] = field(default_factory=dict)
    sent: dict[str, set[str]] = field(default_factory=dict)
    _taken: dict[str, _Taken] = field(default_factory=dict)
    _all: list[dict[str, Any]] = field(default_factory=list)  # silences, as Alertmanager has them

    def end(self, fault: str) -> None:
        """A fault ended, and with it its alert."""
        for each in (self.firing, self.sent, self._taken):
            each.pop(fault, None)

    def faults(self, driver: StateDriver) -> list[Fault]:
        """What an exporter without its database reads of the alerts that fire."""
        return read_firing(self.firing.values(), driver.state.fleet)

    def keep(self, faults: list[Fault], driver: StateDriver, *, is_settled: bool) -> None:
        """Without its database, the exporter has these, of which some may have begun anew."""
        fleet = driver.state.fleet
        began = {fault_of(fleet, as_texts(each.identity, {})): each.since for each in faults}
        for fault, alert in list(self.firing.items()):
            is_known = fault in began or is_settled
            if is_known and humanized(began.get(fault, 0.0)) != since_text(alert.annotations):
                self.end(fault)

    # -- what people do ----------------------------------------------------------------------

    def acknowledge(self, number: int, lasts: float, wall: float) -> None:
        """Somebody acknowledges one of the faults that nobody has, for some seconds."""
        known = acknowledging.problems([*self.firing.values(), *self._escalations()])
        taken = self._silences(wall)
        known = [each for each in known if acknowledging.acknowledged(each, taken) is None]
        if not known:
            return
        problem = known[number % len(known)]
        fault = next(name for name, each in self.firing.items() if _is_of(problem, each))
        start = datetime.fromtimestamp(wall, timezone.utc)
        silence = acknowledging.silence(problem, "ann", "on it", start, lasts)
        self._all.append(silence)
        self._taken[fault] = _Taken(silence, frozenset(self.sent.get(fault, ())))

    def remove(self, number: int, wall: float) -> None:
        """Somebody removes an acknowledgement."""
        if self._taken:
            fault = sorted(self._taken)[number % len(self._taken)]
            end = datetime.fromtimestamp(wall, timezone.utc).isoformat()
            self._taken[fault].silence["endsAt"] = end

    def _escalations(self) -> Iterator[Alert]:
        for fault, steps in self.sent.items():
            for step in steps:
                labels = _escalation(self.firing[fault], step)
                yield self.firing[fault].model_copy(update={"labels": labels})

    def _silences(self, wall: float) -> list[Silence]:
        """Those in force."""
        found = valid(Silence, [each | {"status": {"state": "active"}} for each in self._all])
        return [each for each in found if each.starts_at <= wall < each.ends_at]

    # -- what holds --------------------------------------------------------------------------

    def scrape(self, driver: StateDriver) -> None:
        """Take what is served, and send the steps that are due and that nobody has acknowledged.

        Raises:
            AssertionError: A fault is another than before, or a step is sent, or not, wrongly.
        """
        wall = driver.now.wall
        silences = self._silences(wall)
        in_force: list[Acknowledgement] = read_silences(silences, FLEET)
        driver.exposition = Exposition(driver.state, acknowledged=lambda: in_force)
        samples = driver.samples()
        shown = {dict(labels)["fault"] for labels in samples.get(_ACKNOWLEDGED, ())}
        for labels, start in samples.get(_START, {}).items():
            named = dict(labels)
            fault, text = named["fault"], humanized(start)
            new = _alert(named, text)
            old = self.firing.setdefault(fault, new)
            assert _identity(old) == _identity(new), f"{old.labels} became {new.labels}"
            assert old.annotations == new.annotations, f"{named} is since {text}, was {old}"
            taken = self._taken.get(fault)
            is_taken = taken is not None and _ends(taken) > wall
            assert is_taken is (fault in shown), f"{named} is shown as acknowledged: {shown}"
            assert not any(_matches(each, new.labels) for each in silences), "its end is no mail"
            for step, after in STEPS.items():
                silenced = any(_matches(each, _escalation(new, step)) for each in silences)
                wanted = is_taken and taken is not None and step not in taken.sent
                assert silenced is wanted, f"step {step} of {named} is silenced: {silenced}"
                if wall - start >= after and not silenced:
                    self.sent.setdefault(fault, set()).add(step)


_START = "fault_start_timestamp_seconds"
_ACKNOWLEDGED = "fault_acknowledged_timestamp_seconds"


def _alert(labels: dict[str, str], since: str) -> Alert:
    """A fault's alert; its evidence is of no interest here."""
    kept = {name: text for name, text in labels.items() if name != "evidence"}
    annotations = {"evidence": f"since {since}"}
    named = {"alertname": "RosDiagnosticsFault", **kept}
    return Alert.model_validate(
        {"labels": named, "annotations": annotations, "status": {"state": "active"}}
    )


def _escalation(alert: Alert, step: str) -> dict[str, str]:
    since = since_text(alert.annotations)
    return alert.labels | {"alertname": ESCALATION, "step": step, "since": since}


def _identity(alert: Alert) -> dict[str, str]:
    return {name: alert.labels.get(name, "") for name in IDENTITY}


def _ends(taken: _Taken) -> float:
    end = moment(taken.silence["endsAt"])
    assert end is not None, taken.silence
    return end


def _is_of(problem: Acknowledgeable, alert: Alert) -> bool:
    return all(problem.labels.get(name, "") == text for name, text in _identity(alert).items())


def _matches(silence: Silence, labels: dict[str, str]) -> bool:
    for each in silence.matchers:
        text = labels.get(each.name, "")
        same = re.fullmatch(each.value, text) if each.is_regex else each.value == text
        if bool(same) is not each.is_equal:
            return False
    return True
