"""What is wrong with the exporter itself: each of its parts with a level, as robots report theirs.

The loop `tick` has them judged, so that Prometheus has to see no more than whether that one turns.
"""

from __future__ import annotations

import socket
from collections.abc import Iterator

from ros_diagnostics_exporter.faults.model import OwnReport
from ros_diagnostics_exporter.fleet.unmatched import GRACE
from ros_diagnostics_exporter.metrics.self_metrics import Exporter
from ros_diagnostics_exporter.model import Instant, Level, place
from ros_diagnostics_exporter.texts import first_few

HANGS = 60.0  # seconds without a turn of a loop, beside its interval
FULL = 0.9  # of the limit of series
RECENT = 600.0  # seconds for which it matters that something was rejected
SLOW = 300.0  # seconds that robots and other programs may take to start
NAMED = 3  # queries, entries, reasons
# Loops whose trouble is that of another part; without `tick` nothing is judged at all.
_OTHERS = ("tick", "storage", "config", "domain-")
_MATCHED = GRACE + 60.0  # seconds after the start until all that matches nothing is known


class SelfCheck:
    """The parts of one exporter, which starts ``now``."""

    def __init__(self, exporter: Exporter, now: Instant) -> None:
        self._exporter = exporter
        self._started = now
        self._host = socket.gethostname()
        self._rejected: dict[str, int] = {}
        self._rejected_at: dict[str, float] = {}  # reason -> when last, monotonic

    def reports(self, now: Instant) -> list[OwnReport]:
        """All parts as they are now; of what is wrong the message says on which host."""
        parts = [*self._files(now), *self._servers(now), *self._domains(), *self._loops(now)]
        guessed = self._exporter.rejected_logins.reason(now.mono)
        parts.append(_warning("logins", guessed, is_wrong=bool(guessed), confirm_after=0.0))
        parts += self._shards()
        parts += [self._unmatched(now), self._robots(now), self._series(), self._rejections(now)]
        return [
            each._replace(message=f"{each.message};\non host {self._host}")
            if each.level in (Level.WARN, Level.ERROR)
            else each
            for each in parts
        ]

    def _files(self, now: Instant) -> Iterator[OwnReport]:
        reloader, storage = self._exporter.reloader, self._exporter.storage
        why = "it could not be reloaded: the previous configuration is in force; the log says why"
        yield _warning("fleet.yml", why, is_wrong=not reloader.successful)
        if storage is not None:
            why = (
                "it cannot be written, so a restart would lose the latest changes; the log says why"
            )
            why = why if not storage.successful else storage.crowded_reason
            is_known = not storage.successful or storage.written_at >= self._started.wall
            is_wrong = storage.is_crowded or not storage.successful
            yield _warning("database", why, is_wrong=is_wrong, is_known=is_known)
            early = storage.early.reason(now)
            yield _warning("history", early, is_wrong=bool(early), confirm_after=0.0)

    def _servers(self, now: Instant) -> Iterator[OwnReport]:
        alertmanager, outcomes = self._exporter.alertmanager, self._exporter.outcomes()
        if alertmanager is not None:
            why = (
                "it does not answer: acknowledgements and downtimes are not followed, "
                "and nobody is notified unless Prometheus reaches it"
            )
            is_wrong = not alertmanager.answers(now)
            yield _warning("Alertmanager", why, is_wrong=is_wrong, confirm_after=SLOW)
        if outcomes:
            failed = [f"{each.query.name}: {each.error}" for each in outcomes if each.error]
            why = f"{len(failed)} of {len(outcomes)} have no answer: {_named(failed)}"
            is_known = bool(failed) or all(each.error is not None for each in outcomes)
            yield _warning("queries", why, is_wrong=bool(failed), is_known=is_known)

    def _domains(self) -> Iterator[OwnReport]:
        troubles, oddities = self._exporter.listener.troubles, self._exporter.listener.oddities
        for domain in self._exporter.state.fleet.domain_ids:
            why = troubles.get(domain, "it is not joined yet")
            odd = oddities.get(domain, "")
            level = Level.ERROR if why else Level.WARN if odd else Level.OK
            yield OwnReport(place(domain), level, why or odd)

    def _loops(self, now: Instant) -> Iterator[OwnReport]:
        for loop in self._exporter.loops():
            if not loop.name.startswith(_OTHERS):
                most = HANGS + loop.interval
                hangs = now.wall - max(loop.last_turn, self._started.wall) > most
                why = f"it has done nothing for {most:.0f} s: it hangs, or fails each time"
                yield OwnReport(f"loop {loop.name}", Level.ERROR if hangs else Level.OK, why)

    def _shards(self) -> Iterator[OwnReport]:
        others = self._exporter.others
        if others is None:
            return
        level, why = Level.OK, ""
        if others.error:
            level, why = Level.WARN, f"what the others count is not known: {others.error}"
        elif others.missing and others.is_first:
            flags = _named([f"--shard={each}" for each in others.missing])
            what = "its robots are monitored by nobody; start it, and list it for Prometheus"
            level, why = Level.ERROR, f"there is no exporter with {flags}: {what}"
        yield OwnReport("shards", level, why, SLOW)

    def _unmatched(self, now: Instant) -> OwnReport:
        state = self._exporter.state  # without robots that is what is wrong
        found = [str(each) for each in state.unmatched.entries] if state.robots else []
        is_known = bool(found) or now.mono - self._started.mono > _MATCHED
        why = f"{len(found)} have no effect: {_named(found)}"
        return _warning("entries of fleet.yml", why, is_wrong=bool(found), is_known=is_known)

    def _robots(self, now: Instant) -> OwnReport:
        state = self._exporter.state
        is_known = bool(state.robots) or state.settled(now)
        why = "none is known: fleet.yml declares none, and none is discovered"
        if state.unclaimed:
            why += f"; no entry of fleet.yml matches {_named(list(map(str, state.unclaimed)))}"
        is_wrong = not state.robots
        return _warning("robots", why, is_wrong=is_wrong, is_known=is_known, confirm_after=SLOW)

    def _series(self) -> OwnReport:
        served, limit = self._exporter.exposition.series, self._exporter.state.fleet.limits.series
        number = sum(served.values())
        why = f"{number:,} are served, and beyond {limit:,} they are rejected"
        return _warning("series", why, is_wrong=number > FULL * limit, is_known=bool(served))

    def _rejections(self, now: Instant) -> OwnReport:
        for reason, count in self._exporter.state.rejected.items():
            if count > self._rejected.get(reason, 0):
                self._rejected[reason], self._rejected_at[reason] = count, now.mono
        recent = [each for each, at in self._rejected_at.items() if now.mono - at < RECENT]
        why = f"messages of no known robot were rejected ({', '.join(sorted(recent))})"
        is_known = bool(recent) or now.mono - self._started.mono > RECENT
        wrong = bool(recent)
        return _warning("rejections", why, is_wrong=wrong, is_known=is_known, confirm_after=0.0)


def _warning(
    part: str, why: str, *, is_wrong: bool, is_known: bool = True, confirm_after: float = 60.0
) -> OwnReport:
    level = Level.WARN if is_wrong else Level.OK
    return OwnReport(part, level if is_known else Level.STALE, why, confirm_after)


def _named(texts: list[str]) -> str:
    return first_few(texts, NAMED, "; ")
