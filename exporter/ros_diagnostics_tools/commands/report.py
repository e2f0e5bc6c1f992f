"""``ros-diagnostics report``: the weekly report of a fleet, as HTML to print or by mail."""

from __future__ import annotations

import json
import smtplib
import sys
from datetime import datetime
from email.message import EmailMessage
from pathlib import Path
from typing import Any

import click

from ros_diagnostics_exporter.api.occurrences import KINDS, occurrences
from ros_diagnostics_exporter.api.week import BEFORE, known
from ros_diagnostics_exporter.events import MOMENTS
from ros_diagnostics_exporter.http_client import Client
from ros_diagnostics_tools.flag_types import PATH, Address
from ros_diagnostics_tools.report.availability import DAY, Recorded
from ros_diagnostics_tools.report.numbers import DAYS, numbers
from ros_diagnostics_tools.report.page import page, subject_line, text
from ros_diagnostics_tools.servers import Servers, with_servers
from ros_diagnostics_tools.times import Moment

PROMETHEUS_URL = "http://127.0.0.1:9090"


@click.command(
    epilog="""\b
Examples:
  ros-diagnostics report --week --file report.html
  ros-diagnostics report --week --mail-to shift@example.org --mail-from portal@example.org
"""
)
@click.option(
    "--week",
    is_flag=True,
    expose_value=False,
    help="Report the seven days before --until. This is the default, and the only period.",
)
@click.option(
    "--until",
    type=Moment(),
    default="0s",
    show_default=False,
    metavar="TIME",
    help="The end of the week: 10m (ago), 06:00, 2027-02-01.  [default: now]",
)
@click.option(
    "--target",
    type=click.FloatRange(0, 100),
    default=99.0,
    help="The availability that you aim at, in percent.",
)
@click.option(
    "--prometheus",
    metavar="URL",
    default=PROMETHEUS_URL,
    help="The Prometheus that has the rules of availability.",
)
@click.option("--file", type=PATH, help="Write to this file.  [default: stdout]")
@click.option("--mail-to", multiple=True, metavar="ADDRESS", help="Mail it to ADDRESS; repeatable.")
@click.option("--mail-from", metavar="ADDRESS", help="The sender, with --mail-to.")
@click.option("--smtp", type=Address(), default="127.0.0.1:25", help="Mail server.")
@click.option("--output", type=click.Choice(("html", "json")), default="html")
@with_servers
def command(
    *,
    servers: Servers,
    until: datetime,
    target: float,
    prometheus: str,
    file: Path | None,
    mail_to: tuple[str, ...],
    mail_from: str | None,
    smtp: tuple[str, int],
    output: str,
) -> None:
    """Report a week of the fleet beside the week before: availability, missions, faults.

    Availability and missions come from Prometheus, and the rest from the exporter's event log.
    """
    if mail_to and not mail_from:
        raise click.UsageError("--mail-to needs --mail-from")
    found = _ask(servers, Client(prometheus, **servers.options), until, target / 100)
    if file is not None or output == "json" or not mail_to:
        report = page(found) if output == "html" else f"{json.dumps(found, indent=2)}\n"
        if file is None:
            sys.stdout.write(report)
        else:
            file.write_text(report, "utf-8")
    if mail_to:
        message = EmailMessage()
        message["Subject"], message["From"] = subject_line(found), mail_from
        message["To"] = ", ".join(mail_to)
        message.set_content(text(found))
        message.add_alternative(page(found), subtype="html")
        with smtplib.SMTP(*smtp, timeout=30) as server:
            server.send_message(message)


def _ask(servers: Servers, prometheus: Client, until: datetime, target: float) -> dict[str, Any]:
    """The numbers of the week.

    Raises:
        UnreachableError: The exporter or Prometheus does not answer.
    """
    exporter, end = servers.exporter, until.timestamp()
    lasting = exporter.ask("/api/v1/faults", "faults")
    since = str(end - 2 * DAYS * DAY - BEFORE)
    events = [each for kind in KINDS for each in exporter.events(since, kind=kind)]
    week = str(end - DAYS * DAY)
    moments = [each for kind in MOMENTS for each in exporter.events(week, kind=kind)]
    recorded = Recorded(prometheus, lasting["fleet"])
    faults = known(occurrences(events), lasting["faults"])
    return numbers(recorded, faults, (end, lasting["events_since"]), target, moments)
