"""The histories: those that Nagios' manual is about, and some drawn at random."""

from __future__ import annotations

import random
from typing import Any

from conformance.history import Acknowledgement, Downtime, Escalation, History, Hours

SEED = 2014  # of the histories that are drawn

# Why a difference is on purpose.
STALE_HOLDS = "STALE (UNKNOWN in Nagios) is no news: what was CRITICAL is so until a fresh level"
OPEN_ENDS = "every PROBLEM has its RECOVERY, at the latest when flapping ends; Nagios sends none"
ALL_CHANGES = "every change of level counts as flapping; Nagios leaves soft states out"
TIME_COUNTS = "time in trouble counts, also in a short gap; Nagios counts results"
IN_DOWNTIME = "what is repaired in a downtime has its RECOVERY at the end; Nagios sends none"
NOT_TWICE = "what was notified before the flapping and lasts when it ends is not notified again"


ONE_CAUSE = "the outage of a site is one notification, with its robots; none for each of them"
OPEN_HOURS = "a warning that was notified has its RECOVERY, in the hours or not; Nagios sends none"
NEVER_LATER = "`warning_hours` delay warnings, never what is CRITICAL"
WORSE_COUNTS = "what gets worse is notified, acknowledged or not; an acknowledgement is of a state"
ONLY_SHOWN = "an acknowledgement is shown on pages and dashboards; nobody is sent a mail"
ONCE = "an escalation is sent once, and whoever received the PROBLEM receives its RECOVERY"

LATER, EARLIER = Hours("service", begin=True), Hours("service", begin=False)
ON, OFF = Hours("contact", begin=True), Hours("contact", begin=False)
SECOND = (Escalation("second", 2),)


def sticky(tick: int) -> tuple[Acknowledgement, ...]:
    """An acknowledgement of the one service until it is OK."""
    return (Acknowledgement("r/m", tick),)


def passing(tick: int) -> tuple[Acknowledgement, ...]:
    """An acknowledgement of the one service until its state changes."""
    return (Acknowledgement("r/m", tick, sticky=False),)


def one(name: str, track: str, attempts: int = 3, reason: str = "", **more: Any) -> History:
    """A history of one service on one host."""
    return History(name, {"r/m": track}, attempts=attempts, reason=reason, **more)


SOFT_AND_HARD = [
    one("all is well", "ooooo"),
    one("CRITICAL for max_check_attempts results", "occco"),
    one("WARNING for max_check_attempts results", "owwwo"),
    one("CRITICAL that goes on", "occccccccc"),
    one("one attempt only", "oco", 1),
    one("five attempts, four bad results", "occcco", 5),
    one("five attempts, five bad results", "occccco", 5),
    one("a recovery while soft", "occoo"),
    one("a recovery while soft, twice, then hard", "occoccoccco"),
    one("hard again after a recovery", "occcoccco"),
    one("hard from the first result on", "cccoo"),
    one("a short recovery between two hard states", "occcocco"),
]
LEVELS = [
    one("soft WARNING turns CRITICAL: one clock", "owwcco"),
    one("soft CRITICAL turns WARNING: one clock", "occwwo"),
    one("hard WARNING turns CRITICAL at once", "owwwco"),
    one("hard CRITICAL turns WARNING", "occcwwo"),
    one("WARNING, CRITICAL, WARNING, OK, all hard", "wwwcccwwwo"),
    one("CRITICAL, WARNING, CRITICAL", "cccwcwco"),
    one("WARNING and CRITICAL in turn, soft", "owcwo", 4),
    one("WARNING and CRITICAL in turn, hard", "owcwcwcwco", 2),
    one("hard WARNING, one CRITICAL, back to OK", "wwwcooo"),
    one("UNKNOWN for max_check_attempts results", "ouuuo"),
    one("hard UNKNOWN turns CRITICAL", "uuuco"),
    one("hard WARNING turns UNKNOWN", "wwwuo"),
    one("hard CRITICAL turns UNKNOWN", "cccuuo", reason=STALE_HOLDS),
    one("soft CRITICAL turns UNKNOWN", "ocuuo", reason=STALE_HOLDS),
]
FLAPPING = [
    one("flapping, and it ends well", "oc" * 12 + "o" * 25, 1, flapping=True),
    one("flapping, and it ends CRITICAL", "oc" * 12 + "c" * 25, 1, flapping=True),
    one("changes that are too rare for flapping", ("o" * 6 + "c" * 6) * 4, 1, flapping=True),
    one("flapping between WARNING and CRITICAL", "wc" * 12 + "c" * 25, 1, NOT_TWICE, flapping=True),
    one("flapping twice", ("oc" * 10 + "o" * 25) * 2, 1, flapping=True),
    one(
        "CRITICAL before it flaps, well when it ends",
        "ococococccco" + "oc" * 8 + "o" * 25,
        1,
        flapping=True,
    ),
    one("soft states only, in turn", "occ" * 10 + "o" * 25, 3, ALL_CHANGES, flapping=True),
]
HOSTS = [
    History("a host is down", {}, {"r": "uudddduu"}),
    History("a host is down, not for long enough", {}, {"r": "uudduuu"}),
    History("a host is down with one attempt", {}, {"r": "uduu"}, attempts=1),
    History("a host is down twice", {}, {"r": "udddudddu"}),
    History(
        "a host is down, its services fail with it",
        {"r/m": "oocccooo", "r/l": "oocccooo"},
        {"r": "uuddduuu"},
    ),
    History(
        "a host is down, nothing comes of its services", {"r/m": "oo...ooo"}, {"r": "uuddduuu"}
    ),
    History(
        "a service is CRITICAL before its host is down",
        {"r/m": "ccccc....cco"},
        {"r": "uuuuudddduuu"},
    ),
    History(
        "a service is CRITICAL before its host is down, and well after",
        {"r/m": "cccc...ooo"},
        {"r": "uuuuddduuu"},
    ),
    History("a service fails when its host is back", {"r/m": "oo...cccco"}, {"r": "uuddduuuuu"}),
    History(
        "a service is soft when its host goes down",
        {"r/m": "occ....ccco"},
        {"r": "uuudddduuuu"},
    ),
    History(
        "a service fails, and its host is down for one result",
        {"r/m": "oc.coo"},
        {"r": "uuduuu"},
        reason=TIME_COUNTS,
    ),
    History("a host flaps", {}, {"r": "ud" * 12 + "u" * 25}, attempts=1, flapping=True),
    History(
        "the host comes and goes faster than it is hard", {"r/m": "o.o.o.o.oo"}, {"r": "ududududuu"}
    ),
]
SEVERAL = [
    History("two services fail together", {"r/m": "occcco", "r/l": "occcco"}),
    History("two services fail one after the other", {"r/m": "occccoooo", "r/l": "oooccccoo"}),
    History("two services, one soft", {"r/m": "occcco", "r/l": "occooo"}),
    History("two hosts, the same service on both", {"r/m": "occcco", "s/m": "ooccco"}),
    History(
        "two hosts, one down", {"r/m": "occcco", "s/m": "o...oo"}, {"s": "uddduu", "r": "uuuuuu"}
    ),
    History("two hosts down at once", {}, {"r": "uddddu", "s": "uddddu"}),
]
DOWNTIMES = [
    History("a fault within a downtime", {"r/m": "oooocccooooo"}, downtimes=(Downtime("r", 2, 9),)),
    History(
        "a fault that outlives a downtime",
        {"r/m": "oooocccccccco"},
        downtimes=(Downtime("r", 2, 8),),
    ),
    History(
        "a fault before a downtime, well after it",
        {"r/m": "occcccccccoo"},
        downtimes=(Downtime("r", 5, 8),),
    ),
    History(
        "a fault before a downtime, repaired in it",
        {"r/m": "occcccoooooo"},
        downtimes=(Downtime("r", 5, 9),),
        reason=IN_DOWNTIME,
    ),
    History(
        "a fault across a whole downtime", {"r/m": "occcccccccco"}, downtimes=(Downtime("r", 4, 8),)
    ),
    History("a downtime without a fault", {"r/m": "oooooooo"}, downtimes=(Downtime("r", 2, 5),)),
    History(
        "a host down in a downtime", {}, {"r": "uuuddddduuu"}, downtimes=(Downtime("r", 2, 9),)
    ),
    History(
        "a soft fault when a downtime begins",
        {"r/m": "ooccccccccco"},
        downtimes=(Downtime("r", 3, 7),),
    ),
]
FRESHNESS = [
    History("a result that is not renewed", {"r/m": "ooo......o"}, attempts=1, freshness=3),
    History("a result that is renewed in time", {"r/m": "oo.oo.oo.o"}, attempts=1, freshness=3),
    History("a CRITICAL that is not renewed", {"r/m": "occ......o"}, attempts=1, freshness=3),
    History("a WARNING that is not renewed", {"r/m": "oww......o"}, attempts=1, freshness=3),
]
RESTARTS = [
    one("a restart while all is well", "oooooccco", restarts=(3,)),
    one("a restart while soft", "oocccccoo", restarts=(3,)),
    one("a restart while CRITICAL", "occccccoo", restarts=(5,)),
    one("a restart while CRITICAL, repaired meanwhile", "occcc.ooo", restarts=(5,)),
    one("a restart while WARNING, which then turns CRITICAL", "owwwwcccoo", restarts=(4,)),
    History("a restart while a host is down", {}, {"r": "udddddduuu"}, restarts=(5,)),
    one("a restart while flapping", "oc" * 12 + "o" * 25, 1, flapping=True, restarts=(20,)),
]
BEHIND = {f"r{number}": "ap" for number in range(5)}


def behind(name: str, parent: str, track: str, **others: Any) -> History:
    """A history of five hosts behind a parent, all with the same track but for ``others``."""
    hosts = {"ap": parent, **{each: others.pop(each, track) for each in BEHIND}}
    return History(name, {}, hosts, parents=BEHIND, **others)


PARENTS = [
    behind("all hosts behind a parent that is down", "uudddduu", "uudddduu"),
    behind(
        "all hosts behind a parent that is down, and unreachable hosts are notified",
        "uudddduu",
        "uudddduu",
        unreachable=True,
        reason=ONE_CAUSE,
    ),
    behind("one host behind a parent that answers", "uuuuuuuu", "uuuuuuuu", r0="uudddduu"),
    behind(
        "one host stays down when its parent is back",
        "uudddduuuuuuuu",
        "uudddduuuuuuuu",
        r0="uudddddddddddu",
    ),
    behind(
        "one host is down before its parent",
        "uuuuuudddduuuu",
        "uuuuuudddduuuu",
        r0="uudddddddduuuu",
    ),
    behind("the parent is down for less than max_check_attempts", "uudduuu", "uudduuu"),
]
PERIODS = [
    one("WARNING before the service's hours lasts until they begin", "owwwwwwwwwo", 2, hours=LATER),
    one("WARNING before the service's hours is over then", "owwwoooooo", 2, hours=LATER),
    one("WARNING within the service's hours", "oooooooowwwwo", 2, hours=LATER),
    one("WARNING after the service's hours", "oooooooowwwwo", 2, hours=EARLIER),
    one(
        "WARNING within the service's hours, OK after them",
        "owwwwwwwwwo",
        2,
        OPEN_HOURS,
        hours=EARLIER,
    ),
    one(
        "CRITICAL before the service's hours is over then", "occccooo", 2, NEVER_LATER, hours=LATER
    ),
]
# Played on a real Alertmanager: they are about whom it notifies.
CONTACT_HOURS = [
    one("CRITICAL before the contact's hours lasts until they begin", "occcccccccccc", 1, hours=ON),
    one("CRITICAL before the contact's hours is over then", "occooooooo", 1, hours=ON),
    one("CRITICAL within the contact's hours", "oooooooooccco", 1, hours=ON),
    one("CRITICAL within the contact's hours, OK after them", "occcccccccccco", 1, hours=OFF),
    one("CRITICAL after the contact's hours", "oooooooooccco", 1, hours=OFF),
]
REPEATED = [
    one("CRITICAL, notified again and again", "occccccccco", 1, repeat=2),
    one("WARNING, notified again and again", "owwwwwwwwwo", 1, repeat=2),
    one("WARNING, notified again, turns CRITICAL", "owwwwwccccccco", 1, repeat=2),
    one("CRITICAL is over before it is notified again", "occooooo", 1, repeat=4),
    History("DOWN, notified again and again", {}, {"r": "uddddddddduu"}, 1, repeat=2),
]
ACKNOWLEDGED = [
    one("acknowledged, sticky", "occccccccco", 1, repeat=2, acknowledgements=sticky(1)),
    one("acknowledged, not sticky", "occccccccco", 1, repeat=2, acknowledgements=passing(1)),
    one(
        "acknowledged after it was notified again",
        "occccccccccccco",
        1,
        repeat=2,
        acknowledgements=sticky(5),
    ),
    one(
        "acknowledged WARNING turns CRITICAL, not sticky",
        "owwwcccccccco",
        1,
        repeat=2,
        acknowledgements=passing(1),
    ),
    one(
        "acknowledged WARNING turns CRITICAL, sticky",
        "owwwcccccccco",
        1,
        WORSE_COUNTS,
        repeat=2,
        acknowledgements=sticky(1),
    ),
    one(
        "acknowledged, repaired, and broken again",
        "occccoocccccco",
        1,
        repeat=2,
        acknowledgements=sticky(1),
    ),
    one(
        "acknowledged, and others are notified of that",
        "occccccccco",
        1,
        ONLY_SHOWN,
        repeat=2,
        acknowledgements=(Acknowledgement("r/m", 1, notify=True),),
    ),
    History(
        "a host's DOWN is acknowledged",
        {},
        {"r": "uddddddddduu"},
        1,
        repeat=2,
        acknowledgements=(Acknowledgement("r", 1),),
    ),
]
ESCALATED = [
    one("escalated from the second on", "occccccco", 1, ONCE, repeat=2, escalations=SECOND),
    one(
        "escalated from the second on and from the third on",
        "occcccccccco",
        1,
        ONCE,
        repeat=2,
        escalations=(Escalation("second", 2, 2), Escalation("manager", 3)),
    ),
    one("over before it is escalated", "occooooo", 1, repeat=2, escalations=SECOND),
    one(
        "acknowledged before it is escalated",
        "occccccco",
        1,
        repeat=2,
        escalations=SECOND,
        acknowledgements=sticky(1),
    ),
]
PEOPLE = [*CONTACT_HOURS, *REPEATED, *ACKNOWLEDGED, *ESCALATED]


def drawn(seed: int = SEED) -> list[History]:
    """Twenty histories drawn at random: levels, several services, hosts that come and go."""
    draw = random.Random(seed)
    made = []
    for number in range(20):
        attempts, length = draw.randint(1, 4), draw.randint(8, 20)
        stay = draw.choice((0.3, 0.5, 0.8))
        services = {"r/m": _track(draw, "owc", length, stay)}
        hosts = {}
        if number % 4 == 1:
            services["r/l"] = _track(draw, "owc", length, stay)
        if number % 4 == 2:
            hosts = {"s": _track(draw, "ud", length, stay)}
        flapping = number % 4 == 3
        if flapping:
            attempts = 1
            services["r/m"] = _track(draw, "oc", 40, stay) + services["r/m"][-1] * 25
        made.append(
            History(f"drawn {number + 1} of {seed}", services, hosts, attempts, flapping=flapping)
        )
    return made


def _track(draw: random.Random, letters: str, length: int, stay: float) -> str:
    found = letters[0]
    while len(found) < length:
        found += found[-1] if draw.random() < stay else draw.choice(letters)
    return found


WRITTEN = [
    *SOFT_AND_HARD,
    *LEVELS,
    *FLAPPING,
    *HOSTS,
    *PARENTS,
    *SEVERAL,
    *DOWNTIMES,
    *PERIODS,
    *FRESHNESS,
    *RESTARTS,
    *PEOPLE,
]
