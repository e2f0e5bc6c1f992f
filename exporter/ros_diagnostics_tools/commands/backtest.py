"""``ros-diagnostics-backtest``: what the exporter would have notified of, from recordings."""

from __future__ import annotations

import argparse
import json
import re
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, closing, nullcontext
from pathlib import Path
from typing import Any, TextIO

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn
from rich.table import Column, Table

from ros_diagnostics_exporter import __version__, durations
from ros_diagnostics_exporter.config.errors import ConfigError
from ros_diagnostics_exporter.config.fleet import Fleet
from ros_diagnostics_exporter.config.load import load
from ros_diagnostics_exporter.texts import one_line, printable
from ros_diagnostics_tools.backtest import compare, report, suggest
from ros_diagnostics_tools.backtest.event_log import is_event_log
from ros_diagnostics_tools.backtest.ledger import confirm_after
from ros_diagnostics_tools.backtest.openmetrics import Samples
from ros_diagnostics_tools.backtest.recordings import (
    RecordingError,
    Recordings,
    RecordingSource,
)
from ros_diagnostics_tools.backtest.replay import Replay, Result, play

PROGRAM = "ros-diagnostics-backtest"
EXIT_FAILURE = 1
EXIT_USAGE = 2
SHOW_EVERY = 500  # messages between two steps of the progress bar
JOB = {"job": "ros-diagnostics", "instance": "backtest"}

EPILOG = """\
Record on the robot, judge on any machine (no ROS needed):

  ros2 bag record /diagnostics_agg
  ros-diagnostics-backtest --config.file fleet.yml rosbag2_2026_11_01-08_00_00

Into the history of Prometheus:

  ros-diagnostics-backtest --config.file fleet.yml --openmetrics month.om BAG
  promtool tsdb create-blocks-from openmetrics month.om /var/lib/prometheus/data

Exit codes: 0 judged, 1 a recording cannot be read or holds nothing of this fleet, 2 invalid flag or
configuration file.
"""


class NothingJudgedError(Exception):
    """No topic of the recordings belongs to a robot of the configuration."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Judge recordings and print the result; the exit code."""
    parser = _parser()
    options = parser.parse_args(arguments)
    if options.format == "csv" and (options.compare or options.suggest):
        parser.error("--format csv has notifications only: take --format json")
    try:
        _run(options)
    except ConfigError as error:
        print(error, file=sys.stderr)  # noqa: T201
        return EXIT_USAGE
    except (RecordingError, NothingJudgedError, OSError) as error:
        print(f"{PROGRAM}: {printable(str(error))}", file=sys.stderr)  # noqa: T201
        return EXIT_FAILURE
    except (KeyboardInterrupt, BrokenPipeError):
        return 0
    return 0


def _run(options: argparse.Namespace) -> None:
    fleet = load(options.config_file)
    other = None if options.compare is None else load(options.compare)
    domain_id = _domain(fleet, options)
    sources = [_source(bag, fleet, domain_id, options.namespace or "") for bag in options.bags]
    with ExitStack() as stack:
        recordings = stack.enter_context(closing(Recordings(sources)))
        out = None
        if options.openmetrics is not None:
            out = stack.enter_context(options.openmetrics.open("w", encoding="utf-8"))
        judged = _Judged(options, fleet, other, recordings, out)
        judged.play()
        _print(options, judged)


def _domain(fleet: Fleet, options: argparse.Namespace) -> int | None:
    """The domain that recordings without one of their own are of; None where it is not clear."""
    if options.domain_id is not None:
        return int(options.domain_id)
    return fleet.domain_ids[0] if len(fleet.domain_ids) == 1 else None


def _source(bag: str, fleet: Fleet, domain_id: int | None, namespace: str) -> RecordingSource:
    if is_event_log(Path(bag)):
        return RecordingSource(Path(bag), fleet=fleet)
    path, at = Path(bag), re.fullmatch(r"(.+)@([0-9]{1,3})", bag)
    if at is not None and not path.exists():
        path, domain_id = Path(at[1]), int(at[2])
    if domain_id is None:
        raise RecordingError(
            f"{bag}: the configuration has several DDS domains: say in which it was recorded, with "
            f"--domain-id N for all recordings or {bag}@N for this one"
        )
    return RecordingSource(path, domain_id, namespace)


class _Judged:
    """The recordings, judged by one or two configurations."""

    def __init__(
        self,
        options: argparse.Namespace,
        fleet: Fleet,
        other: Fleet | None,
        recordings: Recordings,
        out: TextIO | None,
    ) -> None:
        self._recordings = recordings
        self._quiet = options.quiet or not sys.stderr.isatty()
        self.statistics = suggest.Statistics() if options.suggest else None
        self._samples = None
        if out is not None:
            self._samples = Samples(out, options.openmetrics_interval, JOB)
        self.first = Replay(
            fleet,
            recordings,
            # An event log has neither the gaps between messages nor the values.
            observe=self.statistics.observe
            if self.statistics and not recordings.has_event_log
            else None,
            each_tick=self._samples.scrape if self._samples else None,
        )
        self.second = None if other is None else Replay(other, recordings)
        self.seconds = 0.0

    def play(self) -> None:
        """Judge all messages."""
        replays = [self.first, *([] if self.second is None else [self.second])]
        begin = time.perf_counter()
        with nullcontext() if self._quiet else _progress(self._recordings.count) as advance:
            for number, _message in enumerate(play(self._recordings, replays)):
                if advance is not None and number % SHOW_EVERY == 0:
                    advance(number)
        self.result = self.first.result()
        self.other = None if self.second is None else self.second.result()
        self.seconds = time.perf_counter() - begin
        if self._samples is not None:
            self._samples.close()
        _warn(self.result, self._recordings.unknown)

    def comparison(self) -> compare.Comparison | None:
        """What the other configuration changes; None without one."""
        if self.other is None or self.second is None:
            return None
        state = self.second.state
        return compare.compare(
            self.result, self.other, lambda each: confirm_after(state, each.robot, each.component)
        )

    def suggestions(self) -> list[suggest.Suggestion] | None:
        """What fleet.yml might say; None where nobody asked."""
        if self.statistics is None:
            return None
        return suggest.suggest(self.result, self.statistics, self.first.state)


def _warn(result: Result, robots: Sequence[str]) -> None:
    """Name the topics, and robots of event logs, that nobody judged; fail if there is no other."""
    unknown = ", ".join(map(one_line, (*result.unknown, *robots)))
    if not result.messages:
        raise NothingJudgedError(
            f"the configuration has no robot for the recorded topics ({unknown}): add it, or put "
            "them below a namespace with --namespace"
        )
    if unknown:
        print(f"{PROGRAM}: of no robot of the configuration: {unknown}", file=sys.stderr)  # noqa: T201


class _progress:  # noqa: N801 - used as a function
    """A progress bar on standard error; what it gives is called with the number of messages."""

    def __init__(self, count: int) -> None:
        columns = (TextColumn("judging"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
        self._bar = Progress(*columns, console=Console(stderr=True), transient=True)
        self._task = self._bar.add_task("judging", total=count)

    def __enter__(self) -> Callable[[int], None]:
        """Show it, on a terminal."""
        self._bar.start()
        return lambda number: self._bar.update(self._task, completed=number)

    def __exit__(self, *_error: object) -> None:
        """Remove it."""
        self._bar.stop()


# -- output ------------------------------------------------------------------------------------


def _print(options: argparse.Namespace, judged: _Judged) -> None:
    if options.format == "csv":
        sys.stdout.write(report.as_csv(judged.result))
    elif options.format == "json":
        json.dump(_as_json(judged), sys.stdout, indent=2)
        print()  # noqa: T201
    else:
        _print_tables(judged)


def _as_json(judged: _Judged) -> dict[str, Any]:
    content = {**report.as_json(judged.result), "seconds": judged.seconds}
    comparison, suggestions = judged.comparison(), judged.suggestions()
    if comparison is not None:
        content["comparison"] = compare.as_json(comparison, judged.result.end, report.notification)
    if suggestions is not None:
        content["suggestions"] = [vars(each) for each in suggestions]
    return content


def _print_tables(judged: _Judged) -> None:
    console = Console(soft_wrap=not sys.stdout.isatty())
    comparison, suggestions = judged.comparison(), judged.suggestions()
    if comparison is not None:
        for line in compare.in_words(comparison):
            console.print(one_line(line), markup=False, highlight=False)
    elif suggestions is not None:
        _print_suggestions(console, suggestions)
    else:
        console.print(report.tables(judged.result, judged.seconds))
        return
    console.print()
    console.print(report.summary(judged.result, judged.seconds), markup=False, highlight=False)


def _print_suggestions(console: Console, found: list[suggest.Suggestion]) -> None:
    if not found:
        console.print("nothing to propose: the settings fit what was recorded")
        return
    titles = ("Profile", "Component", "Setting", "Now", "Proposed", "Reason")
    table = Table(*(Column(title, overflow="fold") for title in titles), box=None, pad_edge=False)
    for each in found:
        texts = each.profile, each.about, each.setting, each.current, each.proposed, each.reason
        table.add_row(*map(one_line, texts))
    console.print(table, markup=False)
    console.print("\nFor fleet.yml; entries of lists go before those that are there:\n")
    console.print(suggest.as_yaml(found), markup=False, highlight=False, soft_wrap=True)


# -- flags -------------------------------------------------------------------------------------


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog=PROGRAM,
        description="Judge recorded diagnostics as the exporter would have, and print of what it "
        "would have notified, and when.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
    parser.add_argument(
        "bags",
        nargs="+",
        metavar="BAG[@DOMAIN]",
        help="a rosbag2 folder, .db3, .mcap or .json recording of diagnostic_msgs/DiagnosticArray, "
        "or an exporter's database (a copy: its file --storage.path), of which levels and silences "
        "are judged; several are merged by time, and what lies between them counts as a stopped "
        "exporter",
    )
    _add_flags(parser)
    return parser


def _add_flags(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--config.file",
        dest="config_file",
        type=Path,
        default=Path("fleet.yml"),
        metavar="FILE",
        help="the fleet's configuration (default: %(default)s)",
    )
    parser.add_argument(
        "--compare",
        type=Path,
        metavar="FILE",
        help="another configuration: print in words what it would change",
    )
    parser.add_argument(
        "--suggest",
        action="store_true",
        help="propose confirm_after, stale_after and thresholds, with the reason for each",
    )
    parser.add_argument(
        "--openmetrics",
        type=Path,
        metavar="FILE",
        help="also write what Prometheus would have scraped, for promtool's create-blocks-from",
    )
    parser.add_argument(
        "--openmetrics.interval",
        dest="openmetrics_interval",
        type=_duration,
        default=15.0,
        metavar="DURATION",
        help="time between two of its scrapes (default: 15s)",
    )
    parser.add_argument(
        "--domain-id",
        dest="domain_id",
        type=int,
        choices=range(233),
        metavar="N",
        help="the DDS domain of the recordings (default: the configuration's, if it has one only)",
    )
    parser.add_argument(
        "--namespace",
        type=_namespace,
        metavar="NAME",
        help="put the recorded topics below this namespace, for what was recorded on the robot",
    )
    parser.add_argument(
        "--format",
        choices=("table", "json", "csv"),
        default="table",
        help="json has everything, csv the notifications (default: %(default)s)",
    )
    parser.add_argument("--quiet", action="store_true", help="show no progress bar")


def _duration(text: str) -> float:
    try:
        seconds = durations.parse(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{error} such as 15s or 1m") from error
    if seconds <= 0:
        raise argparse.ArgumentTypeError(f"{text!r} is no time between two scrapes: take 15s")
    return seconds


def _namespace(text: str) -> str:
    name = text.strip("/")
    if not re.fullmatch(r"[A-Za-z0-9_]+(/[A-Za-z0-9_]+)*", name):
        raise argparse.ArgumentTypeError(f"{text!r} is not a ROS namespace such as robot_1")
    return f"/{name}"


if __name__ == "__main__":
    sys.exit(main())
