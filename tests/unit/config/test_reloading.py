"""The config is read in a thread of its own: what hangs or changes without end harms nobody."""

from __future__ import annotations

import logging
import threading
import time

import pytest

from ros_diagnostics_exporter.config import reloader as reloading
from ros_diagnostics_exporter.config.errors import ConfigError
from ros_diagnostics_exporter.config.load import load
from ros_diagnostics_exporter.config.reloader import Reloader
from ros_diagnostics_exporter.config.watcher import RESTLESS, Watch
from ros_diagnostics_exporter.model import Instant
from testbed.polling import until

CONFIG = "fleet: f\nrobots:\n  - {{name: {}, domain_id: 1}}\n"


class Site:
    """A reloader over a fleet.yml; its clock is the machine's, ``later`` seconds ahead."""

    def __init__(self, path) -> None:
        self.path = path
        self.later = 0.0
        self.fleets = []
        self.events = []
        self.write("r1")
        self.reloader = Reloader(
            path,
            load(path),
            apply=self.fleets.append,
            record=self.events.append,
            clocks=lambda: Instant(time.monotonic() + self.later, time.time() + self.later),
        )

    def write(self, name: str) -> None:
        self.path.write_text(CONFIG.format(name))

    @property
    def names(self) -> list[str]:
        return [fleet.robots[0].name for fleet in self.fleets]


@pytest.fixture
def site(tmp_path, monkeypatch):
    monkeypatch.setattr(reloading, "LOOK", 0.02)
    made = Site(tmp_path / "fleet.yml")
    made.reloader.start()
    yield made
    made.reloader.stop(30)
    assert not made.reloader._thread.is_alive()


@pytest.fixture
def hanging(monkeypatch):
    """Reading the config hangs until this is set."""
    answers = threading.Event()

    def hang(path):
        answers.wait(60)
        return load(path)

    monkeypatch.setattr(reloading, "load", hang)
    yield answers
    answers.set()


def test_a_change_is_applied(site):
    site.write("r2")
    until(lambda: site.names == ["r2"], "r2 is applied")
    until(lambda: [event.after for event in site.events] == ["read"], "it is an event")
    assert site.reloader.successful


def test_a_reload_that_was_asked_for_is_done_when_it_returns(site):
    site.write("r2")
    site.reloader.reload("somebody asked")
    assert site.names[-1] == "r2"


def test_a_wrong_config_is_raised_and_is_one_event_and_the_next_right_one_is_applied(site, caplog):
    site.path.write_text("fleet: f\n" + "".join(f"k{number}: 1\n" for number in range(30)))
    with pytest.raises(ConfigError, match="is not a key"):
        site.reloader.reload("somebody asked")
    assert not site.reloader.successful
    refused = [event for event in site.events if event.after == "refused"]
    assert refused
    assert all(len(event.message.splitlines()) == 4 for event in refused)
    assert "and 10 more problems" in caplog.text

    site.write("r2")
    until(lambda: site.names == ["r2"], "r2 is applied")
    assert site.reloader.successful


def test_while_the_files_hang_a_reload_is_an_error_and_later_it_is_done(
    site, hanging, caplog, monkeypatch
):
    monkeypatch.setattr(reloading, "ANSWER", 0.2)
    site.write("r2")
    with pytest.raises(ConfigError, match=r"fleet.yml: has not been read after 0 s; see whether"):
        site.reloader.reload("somebody asked")
    until(lambda: not site.reloader.successful, "a reload that hangs is no success")
    for _ in range(3):
        site.reloader.tick()
    assert caplog.text.count("the config cannot change until its disk") == 1
    for _ in range(100):  # they do not wait any more
        with pytest.raises(ConfigError, match="has not been read"):
            site.reloader.reload("somebody asked")
    assert not site.fleets

    hanging.set()
    until(lambda: "r2" in site.names, "r2 is applied")
    until(lambda: site.reloader.successful, "and that is a success")


def test_nothing_is_applied_once_it_is_stopped(site, hanging):
    site.reloader.request("somebody asked")
    until(lambda: site.reloader._busy_since is not None and site.reloader._next is None, "it reads")
    site.reloader.stop(0)
    hanging.set()
    site.reloader.stop(30)
    assert not site.fleets


def test_a_fault_of_our_own_is_logged_and_the_next_reload_works(site, monkeypatch, caplog):
    with monkeypatch.context() as patch, caplog.at_level(logging.ERROR):
        patch.setattr(reloading, "load", lambda _path: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            site.reloader.reload("somebody asked")
    assert not site.reloader.successful
    assert "reading the config failed" in caplog.text

    site.reloader.reload("somebody asked")
    assert site.reloader.successful


def test_a_file_that_changes_without_end_keeps_no_other_from_being_read(tmp_path):
    restless, other = tmp_path / "a.yml", tmp_path / "b.yml"
    for path in (restless, other):
        path.write_text("")
    watch = Watch((restless, other))
    other.write_text("changed")

    told = []
    for turn in range(3 * RESTLESS):
        restless.write_text("x" * turn)
        told.append(watch.look())
    assert sum(told) == 3
    assert told.index(True) < RESTLESS


def test_reading_again_what_means_the_same_is_no_event(site):
    mean_same = CONFIG.format("r1")
    for turn in range(5):
        whole = site.path.with_suffix(".new")  # or it could be read before it is written
        whole.write_text(mean_same + "#" * turn)
        before = site.reloader.time
        whole.replace(site.path)
        until(lambda before=before: site.reloader.time > before, "it is read again")
    assert not site.events
    assert not site.fleets
