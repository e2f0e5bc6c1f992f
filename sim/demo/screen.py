"""The demo's output: a live table of the fleet and, above it, a line for each event, and the mails.

Without a terminal the lines are printed, and the table once at the beginning and at the end.
"""

from __future__ import annotations

from types import TracebackType

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from demo.snapshot import RobotStatus, Snapshot
from testbed.mail import Mail

STYLES = {"OK": "green", "WARN": "yellow", "ERROR": "bold red", "STALE": "magenta"}
WORST_FIRST = ("ERROR", "STALE", "WARN")


class Screen:
    """A terminal with a live table, or a stream of lines."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._live: Live | None = None
        self._foot = ""

    def open(self, foot: str) -> None:
        """Show the live table with ``foot`` below it."""
        self._foot = foot
        if self._console.is_terminal:
            self._live = Live(console=self._console, auto_refresh=False)
            self._live.start()

    def close(self) -> None:
        """Stop updating the table."""
        if self._live:
            self._live.stop()
            self._live = None

    def print_event(self, elapsed: float, text: str) -> None:
        """Print an event; ``elapsed`` is in seconds since everything was ready."""
        self._console.print(
            f"[dim]{elapsed:6.1f} s[/] {escape(text)}", highlight=False, soft_wrap=True
        )

    def print_mail(self, elapsed: float, mail: Mail) -> None:
        """Print an email."""
        head = f"From: {mail.sender}\nTo: {', '.join(mail.recipients)}\nSubject: {mail.subject}"
        self.print_event(elapsed, "mail server: received an email")
        self._console.rule("email", align="left")
        body = Text(f"{head}\n\n{mail.text.strip()}")
        self._console.print(body, soft_wrap=True)  # so that links stay whole
        self._console.rule()

    def update(self, snapshot: Snapshot) -> None:
        """Update the live table, if there is one."""
        if self._live:
            self._live.update(Group(_table(snapshot), Text(self._foot, style="dim")), refresh=True)

    def print_table(self, snapshot: Snapshot) -> None:
        """Print the table once, if there is no live one."""
        if not self._live:
            self._console.print(_table(snapshot))

    def __enter__(self) -> Screen:  # noqa: PYI034 - Self is not in Python 3.10
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def _table(snapshot: Snapshot) -> RenderableType:
    table = Table("robot", "state", "components", "problem", "alert", "last message")
    for robot in sorted(snapshot.robots, key=lambda each: (len(each.name), each.name)):
        alerts = [each for each in snapshot.alerts if each.robot == robot.name]
        names = ", ".join(f"{each.name.removeprefix('RosDiagnostics')}" for each in alerts)
        problems = "\n".join(
            f"{each.component}: {each.level}, {each.message}" for each in robot.problems
        )
        age = "never" if robot.age is None else f"{robot.age:.0f} s ago"
        table.add_row(robot.name, _state(robot), str(robot.components), Text(problems), names, age)
    return table


def _state(robot: RobotStatus) -> Text:
    if not robot.up:
        return Text("SILENT", style="bold magenta")
    levels = {each.level for each in robot.problems}
    worst = next((level for level in WORST_FIRST if level in levels), "OK")
    return Text(worst, style=STYLES[worst])
