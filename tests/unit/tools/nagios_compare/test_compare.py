"""Nagios' log and the exporter's record beside one another."""

import io
import json
import sys
from pathlib import Path
from typing import Any

import pytest

from ros_diagnostics_tools.nagios.comparison.log import read
from ros_diagnostics_tools.nagios.comparison.notice import Notice, changes

DAY = 1_767_225_600  # 2026-01-01
MOTOR = {"scope": "component", "robot": "r1", "group": "/Motor", "component": "Motor 2"}


pytestmark = pytest.mark.usefixtures("in_utc")
COMPARE = ("nagios", "compare")


class Site:
    """The files of a site: Nagios' log, and events of the exporter."""

    def __init__(self, folder: Path, run: Any) -> None:
        self.log = folder / "nagios.log"
        self.events = folder / "events.json"
        self.archives: list[Path] = []
        self._run = run
        self._lines: list[bytes] = []
        self._events: list[dict[str, Any]] = []
        self.write(f"[{DAY}] Nagios 4.4.6 starting... (PID=1)")

    def write(self, line: str | bytes) -> None:
        """Add a line to Nagios' log."""
        self._lines.append(line if isinstance(line, bytes) else line.encode())

    def nagios(self, at: int, state: str, what: str = "r1;Motor", to: str = "ops") -> None:
        """Nagios notifies a contact."""
        scope = "SERVICE" if ";" in what else "HOST"
        self.write(f"[{DAY + at}] {scope} NOTIFICATION: {to};{what};{state};by-mail;over current")

    def here(self, at: int, after: str = "firing", state: str = "critical", **more: Any) -> None:
        """Alertmanager notifies a receiver."""
        event = {"id": len(self._events), "time": DAY + at, "kind": "notified", "after": after}
        self._events.append({**event, "state": state, **MOTOR, "receiver": "email", **more})

    def compare(self, *options: str, code: int = 0) -> dict[str, Any]:
        """What the command prints as JSON."""
        return json.loads(self.run("--output", "json", *options, code=code))

    def run(self, *options: str, code: int = 0) -> str:
        """What the command prints, with this exit code."""
        self.log.write_bytes(b"\n".join([*self._lines, f"[{DAY + 86400}] end".encode(), b""]))
        self.events.write_text(json.dumps({"events": self._events}))
        given = ["--events", str(self.events), "--since", "2026-01-01", *options]
        return self._run(
            *COMPARE, *given, "--", *map(str, (self.log, *self.archives)), code=code
        ).out


@pytest.fixture
def site(tmp_path, run) -> Site:
    return Site(tmp_path, run)


def differences(found: dict[str, Any]) -> list[tuple[str, str, str]]:
    """What differs: where, about what, of which state."""
    return [
        (side, each["service"] or each["robot"], each["state"])
        for side in ("only_in_nagios", "only_here", "late", "explained")
        for each in found[side]
    ]


def test_a_fault_and_its_recovery_on_both_sides_are_the_same(site):
    site.nagios(100, "CRITICAL")
    site.here(90)
    site.nagios(500, "OK")
    site.here(480, "resolved")
    found = site.compare()
    assert (found["same"], differences(found)) == (2, [])


def test_what_only_one_of_them_notified_and_what_was_late_is_listed(site):
    site.nagios(100, "CRITICAL")
    site.here(1000, state="warning", component="Laser 1", group="/Laser")
    site.nagios(2000, "WARNING", "r1;Laser")
    site.here(5000, group="/Arm", component="Arm")
    found = site.compare("--within", "30m", code=1)
    assert differences(found) == [
        ("only_in_nagios", "Motor", "CRITICAL"),
        ("only_here", "Arm", "CRITICAL"),
        ("late", "Laser", "WARNING"),
    ]
    assert found["late"][0]["later_here"] == -1000


def test_the_table_has_dates_and_a_last_line_with_all_counts(site):
    site.nagios(100, "CRITICAL")
    site.here(400)
    site.here(5000, "resolved")
    lines = [line.rstrip() for line in site.run(code=1).splitlines()]
    assert lines[1].split()[:5] == ["2026-01-01", "00:01:40", "r1", "Motor", "CRITICAL"]
    assert lines[1].endswith("5m later here")
    assert lines[-1] == (
        "2026-01-01 00:00:00 to 2026-01-02 00:00:00: 0 the same, 0 only in Nagios, 1 only here, "
        "1 at another time, 0 in a larger one here"
    )


def test_several_contacts_receivers_reminders_and_escalations_count_once(site):
    for at in (100, 3700, 7300):
        site.nagios(at, "CRITICAL")
        site.nagios(at, "CRITICAL", to="boss")
    site.here(90)
    site.here(91, receiver="sms")
    site.here(1000, step="1", receiver="escalation-1")
    site.here(90_000, step="0", receiver="reminder")

    assert site.compare()["same"] == 1


def test_a_service_is_in_the_worst_state_of_its_components(site):
    site.nagios(100, "WARNING")
    site.here(100, state="warning", component="Motor 1")
    site.nagios(1000, "CRITICAL")
    site.here(1000)
    site.here(1500, component="Motor 3")
    site.here(2000, "resolved")
    site.nagios(3000, "WARNING")
    site.here(3000, "resolved", component="Motor 3")
    site.nagios(4000, "OK")
    site.here(4000, "resolved", state="warning", component="Motor 1")
    found = site.compare()
    assert (found["same"], differences(found)) == (4, [])


def test_a_warning_that_ends_with_the_critical_above_it_is_one_recovery(site):
    site.nagios(100, "WARNING")
    site.here(100, state="warning")
    site.nagios(400, "CRITICAL")
    site.here(400)
    site.nagios(1000, "OK")
    site.here(1000, "resolved")
    site.here(1005, "resolved", state="warning")
    site.compare()


def test_the_pattern_of_a_service_is_given_where_it_is_not_its_name(site):
    site.nagios(100, "CRITICAL", "r1;drives of the base")
    site.here(100)
    site.compare(code=1)
    site.compare("--service", "drives of the base=/motor")


def test_what_is_stale_is_critical_as_in_nagios(site):
    site.nagios(100, "CRITICAL")
    site.here(100, state="stale")
    site.compare()


def test_archives_in_any_order_end_with_their_last_line(tmp_path):
    paths = [tmp_path / name for name in ("new.log", "old.log")]
    for path, at in zip(paths, (2_000, 1_000), strict=True):
        path.write_text(f"[{at}] LOG ROTATION: DAILY\n[{at + 5}] end\n")
    log = read(paths)
    assert (log.begin, log.end) == (1_000.0, 2_005.0)


def test_only_a_state_that_changes_is_a_change():
    states = ("CRITICAL", "CRITICAL", "OK", "CRITICAL")
    notices = [Notice(float(at), "r1", "Motor", state) for at, state in enumerate(states)]
    assert [each.time for each in changes(notices)] == [0.0, 2.0, 3.0]


def test_a_silent_robot_is_a_host_down_and_its_services_unknown(site):
    site.nagios(100, "DOWN", "r1")
    site.nagios(110, "UNKNOWN")
    site.here(105, state="silent", scope="robot", group="", component="")
    site.nagios(900, "UP", "r1")
    site.nagios(900, "OK")
    site.here(905, "resolved", state="silent", scope="robot", group="", component="")
    site.compare()


def test_a_silent_site_explains_its_hosts(site):
    site.here(50, component="Motor 9")
    site.nagios(50, "CRITICAL")
    site.nagios(100, "DOWN", "r1")
    of_site = {"scope": "site", "site": "hall", "robot": "", "group": "", "component": ""}
    site.here(105, state="silent", **of_site)
    site.here(900, "resolved", state="silent", **of_site)
    site.nagios(910, "UP", "r1")
    site.nagios(5000, "DOWN", "r1")
    found = site.compare(code=1)
    assert differences(found) == [
        ("only_in_nagios", "r1", "DOWN"),
        ("explained", "r1", "DOWN"),
        ("explained", "r1", "UP"),
    ]
    assert found["explained"][0]["here"] == "site hall"


def test_hosts_that_are_no_robots_and_other_kinds_are_counted_and_not_compared(site):
    site.here(100)
    site.nagios(100, "CRITICAL")
    site.nagios(100, "DOWN", "router")
    site.nagios(200, "ACKNOWLEDGEMENT (CRITICAL)")
    site.nagios(300, "DOWNTIMESTART (OK)")
    assert site.compare()["notes"] == {
        "hosts that are no robots here": "1 notifications of Nagios not compared",
        "ACKNOWLEDGEMENT": "1 notifications of Nagios not compared",
        "DOWNTIMESTART": "1 notifications of Nagios not compared",
    }


def test_a_log_of_which_no_host_is_a_robot_here_agrees_with_nothing(site):
    for at in (100, 200, 300):
        site.nagios(at, "CRITICAL", "unknown;Motor")
    assert "0 the same" in site.run(code=2)
    site.nagios(400, "OK", "r1;Motor")
    site.here(400, "resolved")
    site.here(390)
    site.nagios(390, "CRITICAL")
    site.run()


def test_archives_overlap_and_come_in_any_order_over_a_year(site, tmp_path):
    archive = tmp_path / "nagios-12-31-2025-00.log"
    before = DAY - 3600
    line = "[{}] SERVICE NOTIFICATION: ops;r1;Motor;{};by-mail;x\n"
    archive.write_text(line.format(before, "CRITICAL") + line.format(DAY + 100, "OK"))
    site.write(line.format(DAY + 100, "OK").rstrip())
    site.here(-3600)
    site.here(100, "resolved")
    site.archives = [archive, archive]
    assert site.compare("--since", "2025-12-01")["same"] == 2


def test_damaged_lines_are_counted_and_named_and_the_others_are_compared(site):
    site.here(100)
    site.nagios(100, "CRITICAL")
    site.write(b"\x00\x00\x00\x00")
    site.write("[17672] SERVICE NOTIFICATION: ops;r1")
    site.write("[x] SERVICE NOTIFICATION: ops;r1;Motor;OK;by-mail;x")
    site.write(b"[99999999999] \x1b[31m" + b"x" * 200_000)
    notes = site.compare()["notes"]
    assert notes["damaged"] == "1 notifications of Nagios not compared"
    # The NULs, the time that is none, and what is left of the line that is too long.
    assert notes["damaged lines"].startswith(f"5, the first: {site.log}:3: \\x00")


def test_a_log_in_latin_1_and_one_in_utf_8(site):
    site.here(100, component="Kühler", group="")
    line = "[{}] SERVICE NOTIFICATION: ops;r1;Kühler;{};by-mail;heiß"
    site.write(line.format(DAY + 100, "CRITICAL").encode("latin-1"))
    site.write(line.format(DAY + 900, "OK").encode())
    site.here(900, "resolved", component="Kühler", group="")
    assert site.compare()["same"] == 2


def test_names_that_control_a_terminal_are_printed_harmless(site):
    site.nagios(100, "CRITICAL", "r1;\x1b[31mMotor\u202e")
    site.here(5000, component="\x1b]0;x\x07")
    assert "\x1b" not in site.run(code=1) + site.run("--output", "json", code=1)


@pytest.mark.parametrize(
    ("content", "error"),
    [
        (None, "nagios.log: No such file or directory"),
        (b"", "nagios.log: no line is one of Nagios' log"),
        (b"\x1f\x8b\x08\x00compressed", "unpack a compressed archive"),
    ],
)
def test_no_log_is_one_clear_error(content, error, tmp_path, run):
    log = tmp_path / "nagios.log"
    if content is not None:
        log.write_bytes(content)
    (tmp_path / "events.json").write_text('{"events": []}')

    assert error in run(*COMPARE, str(log), "--events", str(tmp_path / "events.json"), code=2).err


@pytest.mark.parametrize(
    "content", ["", "[]", '{"events": [5]}', '{"events": [{"kind": "notified"}]}', "[" * 9999]
)
def test_no_events_are_one_clear_error(content, tmp_path, run):
    log, events = tmp_path / "nagios.log", tmp_path / "events.json"
    log.write_text(f"[{DAY}] start\n")
    events.write_text(content)

    assert "event" in run(*COMPARE, str(log), "--events", str(events), code=2).err


@pytest.mark.parametrize(
    ("option", "error"),
    [
        (("--since", "yesterday"), "'yesterday' is no time; write it as 10m"),
        (("--late", "5"), "'5' is not a duration such as 90s"),
        (("--service", "Motor"), "'Motor' is not SERVICE=PATTERN"),
    ],
)
def test_wrong_options(option, error, run):
    assert error in run(*COMPARE, "nagios.log", *option, code=2).err


def test_a_time_that_both_do_not_have_is_an_error(site, run):
    compare = (*COMPARE, str(site.log), "--events", str(site.events))
    run(*compare, code=2)
    site.run()
    said = run(*compare, "--since", "2027-01-01", code=2).err
    assert "nothing to compare: from 2027-01-01 00:00:00" in said


def test_the_exporter_is_asked_and_the_standard_input_is_read(serve, site, monkeypatch, run):
    wanted = []
    server = serve(find_events=lambda query: wanted.append(query.kind) or [])
    text = f"[{DAY}] HOST NOTIFICATION: ops;router;DOWN;by-mail;x\n".encode()
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(text)))

    said = run(*COMPARE, "-", at=server, code=2).out
    assert "hosts that are no robots here: 1 notif" in said
    assert wanted == ["notified"]


def test_what_follows_right_after_the_end_of_the_time_belongs_to_it(site):
    site.nagios(100, "CRITICAL")
    site.here(105)
    site.here(300, component="Laser 1", group="/Laser")
    found = site.compare("--until", "2026-01-01 00:01:42")
    assert (found["same"], found["only_here"]) == (1, [])


def test_what_was_notified_before_nagios_log_begins_is_not_compared(site):
    site.here(-3000, component="Laser 1", group="/Laser")
    site.nagios(5000, "CRITICAL")
    site.here(5005)
    found = site.compare("--since", "2025-12-01")
    assert (found["same"], found["only_here"]) == (1, [])


def test_a_service_that_the_log_does_not_have_is_named(site):
    site.nagios(100, "CRITICAL")
    site.here(105)
    notes = site.compare("--service", "no such one=Motor")["notes"]
    assert notes["service no such one"].startswith("no notification of Nagios has it;")
