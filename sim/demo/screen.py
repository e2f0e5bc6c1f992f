"""What the reader sees: a live table of the fleet, and above it what happens, mail by mail.

Without a terminal the same lines are printed, and the table only when asked for.
"""

from __future__ import annotations

from types import TracebackType

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from demo.observation import Robot, Sight
from testbed.mail import Mail

STYLES = {"OK": "green", "WARN": "yellow", "ERROR": "bold red", "STALE": "magenta"}
WORST_FIRST = ("ERROR", "STALE", "WARN")


class Screen:
    """The terminal, or the stream of lines that stands in its place."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._live: Live | None = None
        self._foot = ""

    def open(self, foot: str) -> None:
        """Show the live table from now on, ``foot`` below it."""
        self._foot = foot
        if self._console.is_terminal:
            self._live = Live(console=self._console, auto_refresh=False)
            self._live.start()

    def close(self) -> None:
        """Leave the table as it is and end."""
        if self._live:
            self._live.stop()
            self._live = None

    def say(self, elapsed: float, sentence: str) -> None:
        """Tell what happened, and when: seconds since everything was ready."""
        self._console.print(
            f"[dim]{elapsed:6.1f} s[/] {escape(sentence)}", highlight=False, soft_wrap=True
        )

    def mail(self, elapsed: float, mail: Mail) -> None:
        """Show an email as it arrived."""
        head = f"From: {mail.sender}\nTo: {', '.join(mail.recipients)}\nSubject: {mail.subject}"
        self.say(elapsed, "mail server: an email arrives")
        self._console.rule("email", align="left")
        text = Text(f"{head}\n\n{mail.text.strip()}")
        self._console.print(text, soft_wrap=True)  # a link that is broken up cannot be followed
        self._console.rule()

    def show(self, sight: Sight) -> None:
        """Renew the live table; without a terminal, nothing."""
        if self._live:
            self._live.update(Group(_table(sight), Text(self._foot, style="dim")), refresh=True)

    def print_table(self, sight: Sight) -> None:
        """Print the table once, where there is no live one."""
        if not self._live:
            self._console.print(_table(sight))

    def __enter__(self) -> Screen:  # noqa: PYI034 - Self is not in Python 3.10
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def _table(sight: Sight) -> RenderableType:
    table = Table("robot", "state", "components", "trouble", "alert", "last message")
    for robot in sorted(sight.robots, key=lambda each: (len(each.name), each.name)):
        alerts = [each for each in sight.alerts if each.robot == robot.name]
        told = ", ".join(f"{each.name.removeprefix('RosDiagnostics')}" for each in alerts)
        trouble = "\n".join(
            f"{each.component}: {each.level}, {each.message}" for each in robot.troubles
        )
        age = "never" if robot.age is None else f"{robot.age:.0f} s ago"
        table.add_row(robot.name, _state(robot), str(robot.components), Text(trouble), told, age)
    return table


def _state(robot: Robot) -> Text:
    if not robot.up:
        return Text("SILENT", style="bold magenta")
    levels = {each.level for each in robot.troubles}
    worst = next((level for level in WORST_FIRST if level in levels), "OK")
    return Text(worst, style=STYLES[worst])
