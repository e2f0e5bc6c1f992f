"""A run of the demo on a stack that is ready: injects and clears faults, checks the emails."""

from __future__ import annotations

import time
from collections.abc import Sequence

from demo.liveness import Liveness
from demo.screen import Screen
from demo.snapshot import Snapshot, changes, take_snapshot
from demo.steps import Fault, Pace, Step, finished, mail_errors, next_step, out_of_time
from testbed.site import Site

INTERVAL = 0.5  # seconds between two snapshots
PATIENCE = 20.0  # seconds that a program may be down


class DemoRun:
    """Breaks and repairs things, prints each change, and checks the emails at the end.

    Without ``faults`` the robots run a scenario of their own, and emails are not checked.
    """

    def __init__(self, stack: Site, screen: Screen, faults: Sequence[Fault] = ()) -> None:
        self._faults = faults
        self._stack = stack
        self._screen = screen
        self._liveness = Liveness(stack.started, PATIENCE)
        self._step = Step.HEALTHY
        self._step_began = 0.0
        self._snapshot = take_snapshot(stack.addresses)
        self._mails_shown = 0
        self._began = time.monotonic()

    def run(self, seconds: float | None) -> list[str]:
        """Run for ``seconds`` (None: until interrupted); return the errors.

        Raises:
            ProgramEndedError: A program ended and nobody started it again.
            RuntimeError: The robots reject the fault.
        """
        self._screen.print_table(self._snapshot)
        while seconds is None or self._elapsed() < seconds:
            self._print_changes()
            if self._faults and self._liveness.all_up:
                self._advance()
            self._screen.update(self._snapshot)
            time.sleep(INTERVAL)
        self._print_changes()
        self._screen.print_table(self._snapshot)
        errors = self._liveness.down()
        if self._faults:
            errors += mail_errors(self._stack.inbox.mails(), self._faults)
            if errors and self._step is not Step.FINISHED:
                errors.append(out_of_time(self._step))
        return errors

    def _elapsed(self) -> float:
        return time.monotonic() - self._began

    def _print_changes(self) -> None:
        for line in self._liveness.check(self._elapsed()):
            self._screen.print_event(self._elapsed(), line)
        before, self._snapshot = self._snapshot, self._next_snapshot()
        for line in changes(before, self._snapshot):
            self._screen.print_event(self._elapsed(), line)
        for mail in self._stack.inbox.mails()[self._mails_shown :]:
            self._screen.print_mail(self._elapsed(), mail)
            self._mails_shown += 1

    def _advance(self) -> None:
        mails = self._stack.inbox.mails()
        since = self._elapsed() - self._step_began
        now = next_step(self._step, since, mails, self._faults, Pace())
        if now is self._step:
            return
        self._step, self._step_began = now, self._elapsed()
        if now is Step.BROKEN:
            for fault in self._faults:
                self._set(fault, fault.what, fault.message, "fails")
        elif now is Step.REPAIRED:
            for fault in self._faults:
                self._set(fault, "ok", "", "is repaired")
        elif now is Step.FINISHED:
            self._screen.print_event(self._elapsed(), finished(self._faults))

    def _set(self, fault: Fault, what: str, message: str, happens: str) -> None:
        self._screen.print_event(
            self._elapsed(), f"virtual robots: {fault.robot} {fault.component} {happens}"
        )
        self._stack.fault(fault.robot, fault.component, what, message)

    def _next_snapshot(self) -> Snapshot:
        """Take a snapshot; while the exporter does not answer, with the robots of the last one."""
        now = take_snapshot(self._stack.addresses)
        if now.robots or "exporter" not in now.unreachable:
            return now
        return Snapshot(self._snapshot.robots, now.alerts, now.unreachable)
