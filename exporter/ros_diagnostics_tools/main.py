"""``ros-diagnostics``: one command for people, with a file in ``commands/`` for each subcommand."""

from __future__ import annotations

import json
import socket
import sys
from collections.abc import Sequence
from importlib import import_module
from keyword import iskeyword
from typing import Any

import click
from click.shell_completion import CompletionItem

from ros_diagnostics_exporter import __version__
from ros_diagnostics_exporter.config.errors import ConfigError
from ros_diagnostics_exporter.http_client import AnsweredError, UnreachableError
from ros_diagnostics_exporter.texts import printable
from ros_diagnostics_tools.errors import (
    INTERRUPTED,
    NO,
    UNREACHABLE,
    USAGE,
    NotDoneError,
    UnusableError,
)

PROGRAM = "ros-diagnostics"
# Subcommand -> what it does. A module is imported when its subcommand is used: completion is quick.
COMMANDS = {
    "status": "Show the fleet: each robot's state and problems.",
    "why": "Explain who was notified of a robot, or why nobody was.",
    "history": "Show what happened to a robot.",
    "report": "Write or mail the weekly report of a fleet.",
    "capabilities": "Show what a robot can do, and what it would lose next.",
    "missions": "Show whether robots do their work.",
    "faults": "List the present faults.",
    "ack": "Acknowledge an alert, so that it does not escalate.",
    "downtime": "Plan a downtime of robots or of one component.",
    "forget": "Remove a robot or a component that is gone for good.",
    "watch": "Accept a robot's present nodes and topics as expected.",
    "oncall": "Who is on call: build, check and show the rota.",
    "backtest": "Replay recordings: what would have been notified?",
    "import": "Create a fleet.yml from Autoware's diagnostic graph.",
    "mail-relay": "Attach recordings to Alertmanager's mails.",
    "nagios": "Migrate from Nagios: import its files, compare notifications.",
    "check-config": "Check fleet.yml.",
    "mcp": "Answer an assistant's questions about the fleet, read only.",
    "test-page": "Send a test alert through the real routes.",
}


class Commands(click.Group):
    """The subcommands, each imported when it is used."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002 - as click calls it
        """Their names, in the order of the help."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        """One of them."""
        if cmd_name not in COMMANDS:
            return None
        name = cmd_name.replace("-", "_") + "_" * iskeyword(cmd_name)
        module = import_module(f"ros_diagnostics_tools.commands.{name}")
        command: click.Command = module.command
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002
        """List them without importing them."""
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        """Complete their names without importing them."""
        if incomplete.startswith("-"):
            return click.Command.shell_complete(self, ctx, incomplete)
        return [
            CompletionItem(name, help=text)
            for name, text in COMMANDS.items()
            if name.startswith(incomplete)
        ]


EPILOG = f"""\b
Examples:
  {PROGRAM} status --state critical,silent
  {PROGRAM} why robot_3 --at 14:30
  {PROGRAM} ack robot_3 "Motor 1" --comment "spare part ordered"

\b
Exit codes: 0 done; {NO} not done, or the answer is no; {USAGE} wrong arguments or an invalid file;
{UNREACHABLE} a server does not answer; {INTERRUPTED} Ctrl-C.

\b
Completion, in ~/.bashrc:
  eval "$(_ROS_DIAGNOSTICS_COMPLETE=bash_source {PROGRAM})"
in ~/.zshrc with zsh_source; for fish see docs/commands.md.
"""


@click.group(
    cls=Commands,
    epilog=EPILOG,
    context_settings={"help_option_names": ["-h", "--help"], "show_default": True},
)
@click.version_option(__version__, prog_name=PROGRAM)
def command() -> None:
    """Ask a ROS diagnostics exporter about its fleet, and act on what it says."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a subcommand; the exit code."""
    try:
        return _run(None if arguments is None else list(arguments))
    except ConfigError as error:
        print(error, file=sys.stderr)  # noqa: T201
        return USAGE
    except UnusableError as error:
        return _fail(error, USAGE)
    except NotDoneError as error:
        return _fail(error, NO)
    except UnreachableError as error:
        # A server that answers with an error has been reached: it does not know, or refuses.
        return _fail(_in_words(error), NO if isinstance(error, AnsweredError) else UNREACHABLE)
    except OSError as error:
        return _fail(error, NO)


def _run(arguments: list[str] | None) -> int:
    try:
        code: Any = command.main(arguments, PROGRAM, standalone_mode=False)
    except click.NoSuchOption as error:
        _named(error, sys.argv[1:] if arguments is None else arguments).show()
        return USAGE
    except click.ClickException as error:
        error.show()
        return USAGE
    except (click.Abort, KeyboardInterrupt):
        return INTERRUPTED
    return int(code or 0)


def _named(error: click.NoSuchOption, arguments: Sequence[str]) -> click.UsageError:
    """The error; of a negative number, which is taken for options, one that names the way out."""
    given = next((each for each in arguments if each.startswith(error.option_name)), "")
    if not given[1:2].isdigit():
        return error
    text = (
        f"{given!r} begins with a minus, as an option does. Durations and numbers have none: "
        f"write {given[1:]}. A name that begins with a minus stands behind --"
    )
    return click.UsageError(text, error.ctx)


_OTHERS = "For another address: --url (exporter), --alertmanager, --prometheus"


def _in_words(error: UnreachableError) -> str:
    """What the server says is wrong, or what to do about one that does not answer."""
    if isinstance(error, AnsweredError):
        said = _error_of(error.body)
        return f"{said} ({error})" if said else str(error)
    if isinstance(error.__cause__, (ConnectionError, TimeoutError, socket.gaierror)):
        return f"cannot reach {error}. Does it run? {_OTHERS}"
    return str(error)


def _error_of(body: bytes) -> str:
    """The text of an error as the exporter answers it; "" if the body is another."""
    try:
        answer = json.loads(body)
    except ValueError:
        return ""
    return str(answer.get("error", "")) if isinstance(answer, dict) else ""


def _fail(error: Exception | str, code: int) -> int:
    print(f"{PROGRAM}: {printable(str(error))}", file=sys.stderr)  # noqa: T201
    return code


if __name__ == "__main__":
    sys.exit(main())
