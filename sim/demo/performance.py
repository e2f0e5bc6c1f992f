"""One performance of the demo, on a stack that is ready: the story, and what comes of it."""

from __future__ import annotations

import time

from demo import script as story
from demo.changes import changes
from demo.liveness import Watch
from demo.observation import Sight, look
from demo.screen import Screen
from demo.script import Fault, Pace, Step
from testbed.stack import Stack

EVERY = 0.5  # seconds between two looks
PATIENCE = 20.0  # seconds that a program may be gone


class Performance:
    """Breaks and repairs the motor, tells each change, and judges the emails at the end.

    ``with_story`` False: what happens is the robots' own scenario; no email is expected or wrong.
    """

    def __init__(self, stack: Stack, screen: Screen, *, with_story: bool = True) -> None:
        self._with_story = with_story
        self._stack = stack
        self._screen = screen
        self._fault = Fault()
        self._watch = Watch(stack.programs, PATIENCE)
        self._step = Step.WELL
        self._step_began = 0.0
        self._sight = look(stack.addresses)
        self._mails_shown = 0
        self._began = time.monotonic()

    def play(self, seconds: float | None) -> list[str]:
        """Play for ``seconds`` (None: until interrupted); return what went wrong in sentences.

        Raises:
            GoneForGoodError: A program died for good.
            RuntimeError: The robots do not take the fault.
        """
        self._screen.print_table(self._sight)
        while seconds is None or self._elapsed() < seconds:
            self._tell_what_happened()
            if self._with_story and self._watch.all_live:
                self._go_on_with_the_story()
            self._screen.show(self._sight)
            time.sleep(EVERY)
        self._tell_what_happened()
        self._screen.print_table(self._sight)
        wrong = self._watch.still_gone()
        if self._with_story:
            wrong += story.verdict(self._stack.inbox.mails(), self._fault)
            if wrong and self._step is not Step.OVER:
                wrong.append(story.cut_short(self._step))
        return wrong

    def _elapsed(self) -> float:
        return time.monotonic() - self._began

    def _tell_what_happened(self) -> None:
        for sentence in self._watch.look(self._elapsed()):
            self._screen.say(self._elapsed(), sentence)
        before, self._sight = self._sight, _keep_what_is_not_seen(self._sight, self._stack)
        for sentence in changes(before, self._sight):
            self._screen.say(self._elapsed(), sentence)
        for mail in self._stack.inbox.mails()[self._mails_shown :]:
            self._screen.mail(self._elapsed(), mail)
            self._mails_shown += 1

    def _go_on_with_the_story(self) -> None:
        mails = self._stack.inbox.mails()
        since = self._elapsed() - self._step_began
        now = story.step(self._step, since, mails, self._fault, Pace())
        if now is self._step:
            return
        self._step, self._step_began = now, self._elapsed()
        if now is Step.BROKEN:
            self._set("error", self._fault.message, "breaks")
        elif now is Step.REPAIRED:
            self._set("ok", "", "is repaired")
        elif now is Step.OVER:
            self._screen.say(self._elapsed(), "the story is told: one problem, one recovery")

    def _set(self, level: str, message: str, what: str) -> None:
        fault = self._fault
        self._screen.say(self._elapsed(), f"robot: {fault.component} of {fault.robot} {what}")
        self._stack.fault(fault.robot, fault.component, level, message)


def _keep_what_is_not_seen(before: Sight, stack: Stack) -> Sight:
    """Look; while the exporter does not answer, its robots stand as they were seen last."""
    now = look(stack.addresses)
    if now.robots or "exporter" not in now.silent:
        return now
    return Sight(before.robots, now.alerts, now.silent)
