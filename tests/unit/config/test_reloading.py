"""The config is read in a thread of its own, so a file that hangs delays nothing else."""

import logging
import threading
import time

import pytest

from ros_diagnostics_exporter.config import reloader as reloading
from ros_diagnostics_exporter.config.errors import ConfigError
from ros_diagnostics_exporter.config.load import load
from ros_diagnostics_exporter.config.reloader import Reloader
from ros_diagnostics_exporter.files import MAX_UNSTABLE, FileWatcher
from ros_diagnostics_exporter.model import Instant
from support.replaced import replace_text
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
            readers=[self],
            record=self.events.append,
            clocks=lambda: Instant(time.monotonic() + self.later, time.time() + self.later),
        )

    def write(self, name: str) -> None:
        self.path.write_text(CONFIG.format(name))

    def configure(self, fleet, now) -> None:
        assert now.wall <= time.time() + self.later
        self.fleets.append(fleet)

    @property
    def names(self) -> list[str]:
        return [fleet.robots[0].name for fleet in self.fleets]


@pytest.fixture
def site(tmp_path, monkeypatch):
    monkeypatch.setattr(reloading, "INTERVAL", 0.02)
    made = Site(tmp_path / "fleet.yml")
    made.reloader.start()
    yield made
    made.reloader.stop(30)
    assert not made.reloader.loop.alive


@pytest.fixture
def hanging(monkeypatch):
    """Reading the config hangs until this is set."""
    answers = threading.Event()

    def hang(*given):
        answers.wait(60)
        return load(*given)

    monkeypatch.setattr(reloading, "load", hang)
    yield answers
    answers.set()


def test_a_change_is_applied(site):
    site.write("r2")
    until(lambda: site.names == ["r2"], "r2 is applied")
    until(lambda: [event.after for event in site.events] == ["read"], "it is an event")
    assert site.reloader.successful


def test_a_requested_reload_is_done_when_it_returns(site):
    site.write("r2")
    site.reloader.reload("a request")
    assert site.names[-1] == "r2"


def test_an_invalid_config_is_an_error_and_an_event_and_the_next_valid_one_is_applied(site, caplog):
    site.path.write_text("fleet: f\n" + "".join(f"k{number}: 1\n" for number in range(30)))
    with pytest.raises(ConfigError, match="is not a key"):
        site.reloader.reload("a request")
    assert not site.reloader.successful
    rejected = [event for event in site.events if event.after == "rejected"]
    assert rejected
    assert all(len(event.message.splitlines()) == 4 for event in rejected)
    assert "and 10 more problems" in caplog.text

    site.write("r2")
    until(lambda: site.names == ["r2"], "r2 is applied")
    assert site.reloader.successful


def test_a_config_that_is_set_back_after_it_was_invalid_is_a_success(site):
    site.path.write_text("fleet: [")
    until(lambda: not site.reloader.successful, "it is rejected")
    site.write("r1")
    until(lambda: site.reloader.successful, "it is what it was at the start")
    assert [event.after for event in site.events] == ["rejected", "read"]


def test_a_reload_fails_while_files_hang_and_succeeds_later(site, hanging, caplog, monkeypatch):
    monkeypatch.setattr(reloading, "TIMEOUT", 0.2)
    site.write("r2")
    with pytest.raises(ConfigError, match=r"fleet.yml: has not been read after 0 s; check whether"):
        site.reloader.reload("a request")
    until(lambda: not site.reloader.successful, "a reload that hangs is no success")
    for _ in range(3):
        site.reloader.tick()
    assert caplog.text.count("no reload is possible until its disk") == 1
    for _ in range(100):  # they do not wait any more
        with pytest.raises(ConfigError, match="has not been read"):
            site.reloader.reload("a request")
    assert not site.fleets

    hanging.set()
    until(lambda: "r2" in site.names, "r2 is applied")
    until(lambda: site.reloader.successful, "and that is a success")


def test_nothing_is_applied_once_it_is_stopped(site, hanging):
    site.reloader.request("a request")
    until(lambda: site.reloader.loop.hangs(0) and site.reloader._next is None, "it reads")
    site.reloader.stop(0)
    hanging.set()
    site.reloader.stop(30)
    assert not site.fleets


def test_a_bug_is_logged_and_the_next_reload_works(site, monkeypatch, caplog):
    with monkeypatch.context() as patch, caplog.at_level(logging.ERROR):
        patch.setattr(reloading, "load", lambda *_given: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            site.reloader.reload("a request")
    assert not site.reloader.successful
    assert "reload failed; keeping the previous configuration" in caplog.text

    site.reloader.reload("a request")
    assert site.reloader.successful


@pytest.mark.parametrize("change", ["write", "replace", "add to folder", "remove"])
def test_a_change_of_a_file_or_folder_is_told_once_and_after_it_came_to_rest(tmp_path, change):
    file, folder = tmp_path / "fleet.yml", tmp_path / "robots.d"
    file.write_text("a")
    folder.mkdir()
    watch = FileWatcher((file, folder))
    assert not watch.changed()

    if change == "write":
        file.write_text("longer")
    elif change == "replace":
        (tmp_path / "new").write_text("b")
        (tmp_path / "new").replace(file)
    elif change == "add to folder":
        (folder / "r.yml").write_text("name: r")
    else:
        file.unlink()

    assert [watch.changed() for _ in range(4)] == [False, True, False, False]


def test_a_file_that_changes_while_it_is_read_is_read_again(tmp_path):
    file, other = tmp_path / "fleet.yml", tmp_path / "robots.yml"
    for path in (file, other):
        path.write_text("a")
    watch = FileWatcher((file,))
    watch.mark()
    file.write_text("longer, and written after the exporter has read it")
    watch.watch((file, other))

    assert [watch.changed() for _ in range(3)] == [True, False, False]


def test_a_file_that_never_stops_changing_does_not_hide_other_changes(tmp_path):
    unstable, other = tmp_path / "a.yml", tmp_path / "b.yml"
    for path in (unstable, other):
        path.write_text("")
    watcher = FileWatcher((unstable, other))
    other.write_text("changed")

    reported = []
    for turn in range(3 * MAX_UNSTABLE):
        unstable.write_text("x" * turn)
        reported.append(watcher.changed())
    assert sum(reported) == 3
    assert reported.index(True) < MAX_UNSTABLE


def test_a_reload_without_a_change_is_no_event(site):
    mean_same = CONFIG.format("r1")
    for turn in range(5):
        before = site.reloader.time
        replace_text(site.path, mean_same + "#" * turn)
        until(lambda before=before: site.reloader.time > before, "it is read again")
    assert not site.events
    assert not site.fleets
