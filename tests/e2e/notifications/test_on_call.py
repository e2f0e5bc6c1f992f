"""Mails to the person on call from a real Alertmanager, across handovers and clock changes.

Alertmanager's hours have minutes, and its clock is the real one. So handovers are at one of the
next full minutes, and `zic` makes zones whose clocks change then.
"""

import os
import shutil
import subprocess
from datetime import datetime, timedelta, timezone

import pytest

from ros_diagnostics_tools.commands import oncall
from ros_diagnostics_tools.main import main
from support.alerts import fault, post_alerts, reload
from support.oncall import with_marker
from testbed import servers
from testbed.configuration import CHECKOUT
from testbed.polling import until
from testbed.programs import own
from testbed.site import Site

UTC = timezone.utc
MINUTE, HOUR, DAY = timedelta(minutes=1), timedelta(hours=1), timedelta(days=1)
GROUP_INTERVAL = 5  # seconds, in the shipped alertmanager.yml
PEOPLE = ("anna", "ben", "carla", "dan", "eva", "finn")


def now() -> datetime:
    return datetime.now(UTC)


def next_minute(at_least: float) -> datetime:
    """The first full minute that is so many seconds ahead."""
    return (now() + timedelta(seconds=at_least, minutes=1)).replace(second=0, microsecond=0)


def wait_until(when: datetime) -> None:
    until(lambda: now() >= when, f"{when:%H:%M:%S}", (when - now()).total_seconds() + 10)


def problem(component: str) -> str:
    return f"** PROBLEM ** f/r1 {component} is CRITICAL"


def recovery(component: str) -> str:
    return f"** RECOVERY ** f/r1 {component} is no longer CRITICAL"


class OnCall:
    """An Alertmanager, not yet started, and the mails that it sends."""

    def __init__(self, site: Site) -> None:
        self._site = site
        self.address = site.addresses.alertmanager
        self.folder = site.folder / "alertmanager"
        shutil.copytree(CHECKOUT / "alertmanager", self.folder)
        config = self.folder / "alertmanager.yml"
        with_marker(config)
        config.write_text(config.read_text().replace("localhost:25", site.addresses.smtp))
        self._zones = site.folder / "zones"
        self._zones.mkdir()
        site.start_mail_server()

    def start(self, teams: str, *options: str, zone: str = "Asia/Kolkata") -> None:
        """Build with these teams and start Alertmanager."""
        people = "".join(f"  {name}: {{email: {name}@localhost}}\n" for name in PEOPLE)
        text = f"time_zone: {zone}\npeople:\n{people}{teams}"
        (self.folder / "oncall.yml").write_text(text)
        subprocess.run(
            [own("ros-diagnostics"), "oncall", "build", *options],
            cwd=self.folder,
            env=os.environ | {"PYTHONTZPATH": f"{self._zones}:/usr/share/zoneinfo"},
            check=True,
            timeout=60,
        )
        config = self.folder / "alertmanager-oncall.yml"
        server = servers.alertmanager(self._site.folder, config, self.address)
        self._site.start(server).wait_until_ready()

    def subjects(self, person: str) -> list[str]:
        """The subjects of all mails to the person, in the order of their arrival."""
        return self._site.inbox.subjects(f"{person}@localhost")

    def wait_for(self, person: str, *subjects: str, seconds: float = 30) -> None:
        """Wait until the person has exactly these mails, in any order."""
        until(
            lambda: sorted(self.subjects(person)) == sorted(subjects),
            lambda: f"{person} has {subjects}: {self.subjects(person)}",
            seconds,
        )

    def make_zone(self, name: str, change: datetime, before: int, after: int) -> None:
        """A zone whose clocks change at an instant; offsets from UTC in hours."""
        source = self._zones / f"{name}.zone"
        end = f"{change:%Y %b %d %H:%M}u"
        source.write_text(
            f"Zone\tTest/{name}\t{before}\t-\tT{before}\t{end}\n\t{after}\t-\tT{after}\n"
        )
        zic = shutil.which("zic") or "/usr/sbin/zic"
        subprocess.run([zic, "-d", self._zones, source], check=True, timeout=60)


@pytest.fixture
def on_call(site: Site) -> OnCall:
    return OnCall(site)


def team(name: str, matcher: str, since: datetime, people: str, zone: str = "UTC") -> str:
    """A team that hands over every day at the time of day of ``since``, in the zone."""
    return f"""
  - name: {name}
    matchers: [{matcher}]
    levels:
      first:
        receiver: on-call
        like: [email]
        shifts:
          - {{people: [{people}], since: {since:%Y-%m-%dT%H:%M}, every: day, time_zone: {zone}}}"""


@pytest.mark.slow
def test_across_a_handover_and_across_clock_changes_everybody_gets_what_is_theirs(on_call: OnCall):
    """One team hands over at T.

    At T the clocks of a second team go forward by an hour, and it hands over half an hour after
    what they showed: at T. Those of a third go back by an hour, and it hands over at what they
    showed, which they show an hour after T: not at T.
    """
    change = next_minute(at_least=20)
    local = change.replace(tzinfo=None)
    on_call.make_zone("Forward", change, 1, 2)
    on_call.make_zone("Back", change, 2, 1)
    yesterday = local - DAY
    teams = "teams:" + "".join(
        (
            team("plain", "team = plain", yesterday, "anna, ben"),
            team(
                "forward", "team = forward", yesterday + HOUR + 30 * MINUTE, "carla, dan",
                "Test/Forward",
            ),
            team("back", "team = back", yesterday + 2 * HOUR, "eva, finn", "Test/Back"),
        )
    )  # fmt: skip
    on_call.start(teams)

    lasting = [fault("Lasting", team=name) for name in ("plain", "forward", "back")]
    post_alerts(on_call.address, *lasting)
    for person in ("anna", "carla", "eva"):
        on_call.wait_for(person, problem("Lasting"))
    assert now() < change, "the machine is too slow for this test"
    # Groups of which some are looked at just before T, some after it.
    short = [fault(f"Short {n}", team="plain") for n in range(GROUP_INTERVAL)]
    for n, each in enumerate(short):
        wait_until(change - timedelta(seconds=GROUP_INTERVAL + 2 - n))
        post_alerts(on_call.address, each)
    wait_until(change - timedelta(seconds=0.5))
    post_alerts(on_call.address, *short, resolved=True)

    # Who comes on call gets what lasts; who is not gets nothing.
    on_call.wait_for("ben", problem("Lasting"))
    on_call.wait_for("dan", problem("Lasting"))
    # What was resolved before T is a recovery for the person who had the problem.
    names = [f"Short {n}" for n in range(GROUP_INTERVAL)]
    pairs = [text(name) for name in names for text in (problem, recovery)]
    on_call.wait_for("anna", problem("Lasting"), *pairs)
    post_alerts(on_call.address, *lasting, resolved=True)
    for person in ("ben", "dan", "eva"):
        on_call.wait_for(person, problem("Lasting"), recovery("Lasting"))
    on_call.wait_for("anna", problem("Lasting"), recovery("Lasting"), *pairs)
    assert on_call.subjects("finn") == []


def test_after_the_end_of_what_was_built_everybody_is_notified(
    on_call: OnCall, monkeypatch: pytest.MonkeyPatch
):
    on_call.start("teams:" + team("plain", 'robot = "r1"', now() - 40 * DAY, "anna, ben"))
    monkeypatch.chdir(on_call.folder)
    then = now() - 15 * DAY
    monkeypatch.setattr(oncall, "_now", lambda: then)
    assert main(["oncall", "build", "--ahead", "2w"]) == 0
    reload(on_call.address)

    post_alerts(on_call.address, fault("Motor"))

    for person in ("anna", "ben"):
        on_call.wait_for(person, problem("Motor"))
    post_alerts(on_call.address, fault("Motor"), resolved=True)
    for person in ("anna", "ben"):
        on_call.wait_for(person, problem("Motor"), recovery("Motor"))


@pytest.mark.slow
@pytest.mark.timeout(480)
def test_who_is_back_after_minutes_gets_a_fault_that_ended_meanwhile_and_begins_again(
    on_call: OnCall,
):
    """Alertmanager remembers for days that a receiver got a problem, and not that it ended."""
    first = next_minute(at_least=30)
    teams = "teams:" + team("plain", 'robot = "r1"', now() - 8 * DAY, "anna")
    override = (
        f"\noverrides:\n  - {{person: ben, start: '{first.isoformat()}', "
        f"end: '{(first + 3 * MINUTE).isoformat()}'}}\n"
    )
    on_call.start(teams + override)
    post_alerts(on_call.address, fault("Motor"))
    on_call.wait_for("anna", problem("Motor"))
    assert now() < first, "the machine is too slow for this test"
    # What Alertmanager began to send before is ended: it tries 10 s to record it at the exporter.
    wait_until(first + MINUTE + timedelta(seconds=15))  # anna is not notified any more
    on_call.wait_for("ben", problem("Motor"))
    post_alerts(on_call.address, fault("Motor"), resolved=True)
    on_call.wait_for("ben", problem("Motor"), recovery("Motor"))
    assert on_call.subjects("anna") == [problem("Motor")]

    wait_until(first + 4 * MINUTE + timedelta(seconds=15))  # and neither is ben
    post_alerts(on_call.address, fault("Motor"))

    on_call.wait_for("anna", problem("Motor"), problem("Motor"))
    post_alerts(on_call.address, fault("Motor"), resolved=True)
    on_call.wait_for("anna", problem("Motor"), problem("Motor"), recovery("Motor"))
    assert on_call.subjects("ben") == [problem("Motor"), recovery("Motor")]
