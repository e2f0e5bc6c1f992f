"""``ros-diagnostics backtest``: what the exporter would have notified of, from recordings."""

from __future__ import annotations

import re
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TextIO

import click
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

from ros_diagnostics_exporter.config.fleet import Fleet
from ros_diagnostics_exporter.config.load import load
from ros_diagnostics_exporter.http_client import Client
from ros_diagnostics_exporter.model import ZENOH, Domain
from ros_diagnostics_exporter.sources.topic_entries import asked_names
from ros_diagnostics_exporter.texts import one_line
from ros_diagnostics_tools.backtest import compare, report, suggest, words
from ros_diagnostics_tools.backtest.event_log import is_event_log
from ros_diagnostics_tools.backtest.fault_recording import FaultRecording, too_short
from ros_diagnostics_tools.backtest.fault_recording import read as read_fault_recording
from ros_diagnostics_tools.backtest.formats import RecordingError
from ros_diagnostics_tools.backtest.history import confirm_after
from ros_diagnostics_tools.backtest.openmetrics import Samples
from ros_diagnostics_tools.backtest.recordings import Recordings, RecordingSource
from ros_diagnostics_tools.backtest.replay import Replay, Result, play
from ros_diagnostics_tools.errors import NotDoneError
from ros_diagnostics_tools.flag_types import PATH, Checked
from ros_diagnostics_tools.terminal import make_table, print_json, with_output
from ros_diagnostics_tools.times import Duration

SHOW_EVERY = 500  # messages between two steps of the progress bar
HOW = ("timeout", "user", "password_file", "bearer_token_file", "ca_file")
JOB = {"job": "ros-diagnostics", "instance": "backtest"}


@dataclass(frozen=True)
class BacktestOptions:
    """The command line."""

    bags: tuple[str, ...]
    config: Path | None
    compare: Path | None
    suggest: bool
    openmetrics: Path | None
    openmetrics_interval: float
    domain_id: int | None
    namespace: str | None
    output: str
    quiet: bool
    prometheus: str | None
    how: dict[str, Any]  # it is asked

    def client(self) -> Client | None:
        """What the queries are asked, if anything."""
        return None if self.prometheus is None else Client(self.prometheus, **self.how)


class NothingJudgedError(Exception):
    """No topic of the recordings belongs to a robot of the configuration."""


def _namespace(text: str) -> str:
    name = text.strip("/")
    if not re.fullmatch(r"[A-Za-z0-9_]+(/[A-Za-z0-9_]+)*", name):
        raise ValueError(f"{text!r} is not a ROS namespace such as robot_1")
    return f"/{name}"


@click.command(
    epilog="""\b
Record on the robot, judge on any machine (no ROS needed):
  ros2 bag record --topics /diagnostics_agg
  ros-diagnostics backtest --config fleet.yml rosbag2_2026_11_01-08_00_00

\b
Into the history of Prometheus:
  ros-diagnostics backtest --config fleet.yml --openmetrics month.om BAG
  promtool tsdb create-blocks-from openmetrics month.om /var/lib/prometheus/data
"""
)
@click.argument("bags", nargs=-1, required=True, metavar="BAG[@DOMAIN]...")
@click.option(
    "--config",
    type=PATH,
    help="The fleet's configuration.  [default: fleet.yml; of a recording, what is attached to it]",
)
@click.option(
    "--compare", type=PATH, help="Another configuration: print in words what it would change."
)
@click.option(
    "--suggest",
    is_flag=True,
    help="Propose confirm_after, stale_after and thresholds, with the reason for each.",
)
@click.option(
    "--openmetrics",
    type=PATH,
    help="Also write what Prometheus would have scraped, for promtool's create-blocks-from.",
)
@click.option(
    "--openmetrics-interval",
    type=Duration(),
    default="15s",
    help="Time between two of its scrapes.",
)
@click.option(
    "--domain-id",
    type=click.IntRange(0, 232),
    help="The DDS domain of the recordings.  [default: the configuration's, if it has one only]",
)
@click.option(
    "--namespace",
    type=Checked(_namespace),
    metavar="NAME",
    help="Put the recorded topics below this namespace, for recordings made on the robot.",
)
@click.option("--quiet", is_flag=True, help="Show no progress bar.")
@click.option(
    "--prometheus",
    metavar="URL",
    help="A Prometheus that has the series of that time: the configuration's `queries` are judged, "
    "too.",
)
@click.option("--timeout", type=Duration(), default="30s", help="How long to wait for an answer.")
@click.option("--user", metavar="NAME", help="User of that Prometheus.")
@click.option("--password-file", type=PATH, help="The user's password, in one line.")
@click.option("--bearer-token-file", type=PATH, help="A token, in place of user and password.")
@click.option("--ca-file", type=PATH, help="CA of its certificate.")
@with_output("csv")
def command(**given: Any) -> None:
    """Judge recorded diagnostics as the exporter would have, and print what it would have notified.

    BAG is a recording of diagnostic_msgs/DiagnosticArray: a rosbag2 folder, .mcap, .db3, .bag of
    ROS 1, or a .zip of them; messages as text: JSON, rosbridge's, the output of `ros2 topic echo`;
    or an exporter's database (a copy: its file --storage.path), of which levels and silences are
    judged. Several are merged by time; what lies between them counts as a stopped exporter.
    """
    how = {name: given.pop(name) for name in HOW}
    options = BacktestOptions(**given, how=how)
    if options.output == "csv" and (options.compare or options.suggest):
        raise click.UsageError("--output csv has notifications only: take --output json")
    try:
        _run(options)
    except (RecordingError, NothingJudgedError) as error:
        raise NotDoneError(str(error)) from error


def _run(options: BacktestOptions) -> None:
    recording = read_fault_recording(Path(options.bags[0])) if len(options.bags) == 1 else None
    fleet = _fleet(options, recording)
    other = None if options.compare is None else load(options.compare)
    domain_id = _domain(fleet, options, recording)
    fleets = filter(None, (fleet, other))
    asked = asked_names(each for one in fleets for each in one.profiles.values())
    sources = [
        replace(_source(bag, fleet, domain_id, options.namespace or ""), asked=asked)
        for bag in options.bags
    ]
    with ExitStack() as stack:
        recordings = stack.enter_context(closing(Recordings(sources)))
        out = None
        if options.openmetrics is not None:
            out = stack.enter_context(options.openmetrics.open("w", encoding="utf-8"))
        judged = _Judged(options, fleet, other, recordings, out)
        judged.play(recording)
        _print(options, judged)


def _fleet(options: BacktestOptions, recording: FaultRecording | None) -> Fleet:
    """What to judge by."""
    if options.config is None and recording is not None:
        with TemporaryDirectory() as folder:
            path = Path(folder, "fleet.yml")
            path.write_bytes(recording.config)
            return load(path)
    return load(options.config or Path("fleet.yml"))


def _domain(
    fleet: Fleet, options: BacktestOptions, recording: FaultRecording | None
) -> Domain | None:
    """The domain that recordings without one of their own are of; None where it is not clear."""
    if options.domain_id is not None:
        return options.domain_id
    if recording is not None and len(recording.fault.get("domain_ids", ())) == 1:
        found = recording.fault["domain_ids"][0]
        return ZENOH if found == ZENOH else int(found)
    return fleet.domain_ids[0] if len(fleet.domain_ids) == 1 else None


def _source(bag: str, fleet: Fleet, domain_id: Domain | None, namespace: str) -> RecordingSource:
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
        options: BacktestOptions,
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
            prometheus=options.client(),
        )
        self.second = None
        if other is not None:
            self.second = Replay(other, recordings, prometheus=options.client())
        self.seconds = 0.0

    def play(self, recording: FaultRecording | None) -> None:
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
        self.warnings = _warnings(self.result, self._recordings)
        self.warnings += dict.fromkeys(
            each for of in replays for each in (*of.warnings, *of.past.warnings())
        )
        if recording is not None:
            for replay in replays:
                self.warnings += too_short(recording, replay.result(), replay.state)
        for each in self.warnings:
            print(f"ros-diagnostics: {each}", file=sys.stderr)  # noqa: T201

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


def _warnings(result: Result, recordings: Recordings) -> list[str]:
    """What of the recordings was not judged; raises NothingJudgedError if that is all."""
    unknown = ", ".join(map(one_line, (*result.unknown, *recordings.unknown)))
    warnings = list(map(one_line, recordings.warnings))
    if not result.messages:
        raise NothingJudgedError(
            f"the configuration has no robot for the recorded topics ({unknown}): add it, or put "
            "them below a namespace with --namespace"
        )
    if unknown:
        warnings.append(f"of no robot of the configuration: {unknown}")
    if result.undecodable:
        number = f"{result.undecodable} of {words.count(result.messages, 'message')}"
        warnings.append(f"{number} cannot be decoded: {one_line(result.reason)}")
    if result.undecodable == result.messages:
        raise NothingJudgedError("; ".join(warnings))
    return warnings


@contextmanager
def _progress(count: int) -> Iterator[Callable[[int], None]]:
    """A progress bar on standard error; what it gives is called with the number of messages."""
    columns = (TextColumn("judging"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("judging", total=count)
        yield lambda number: bar.update(task, completed=number)


# -- output ------------------------------------------------------------------------------------


def _print(options: BacktestOptions, judged: _Judged) -> None:
    if options.output == "csv":
        sys.stdout.write(report.as_csv(judged.result))
    elif options.output == "json":
        print_json(_as_json(judged))
    else:
        _print_tables(judged)


def _as_json(judged: _Judged) -> dict[str, Any]:
    content = {
        **report.as_json(judged.result),
        "warnings": judged.warnings,
        "seconds": judged.seconds,
    }
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


def _print_suggestions(console: Console, suggestions: list[suggest.Suggestion]) -> None:
    if not suggestions:
        console.print("nothing to propose: the settings fit what was recorded")
        return
    titles = ("Profile", "Component", "Setting", "Now", "Proposed", "Reason")
    table = make_table(*titles)
    for each in suggestions:
        texts = each.profile, each.about, each.setting, each.current, each.proposed, each.reason
        table.add_row(*map(one_line, texts))
    console.print(table, markup=False)
    console.print("\nFor fleet.yml; entries of lists go before those that are there:\n")
    console.print(suggest.as_yaml(suggestions), markup=False, highlight=False, soft_wrap=True)
