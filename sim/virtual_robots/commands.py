"""What each command does, wired together from the other files; options come from cli.py.

Imports ROS; cli.py imports it only when a command that needs it is called.
"""

from __future__ import annotations

import argparse
import signal
import sys
import threading
from collections import Counter
from pathlib import Path
from types import FrameType

from virtual_robots.bags import BagWriter, Recorded, read_recordings, recorded_topics
from virtual_robots.bags_ros import Playback, Recorder
from virtual_robots.control import Control, set_parameter
from virtual_robots.documents import DocumentError
from virtual_robots.fleet import Fleet
from virtual_robots.kinds import kind_path
from virtual_robots.members import Happening, Note, RobotSpec
from virtual_robots.player import Player
from virtual_robots.ros import chosen_domain_id, ros_context
from virtual_robots.scenario import load_scenario, plan
from virtual_robots.transport import Participants, Transport


def run(options: argparse.Namespace) -> None:
    """Publish a fleet until SIGINT or SIGTERM, or until its duration is over."""
    fleet, duration = fleet_of(options)
    domain_id = chosen_domain_id(options.domain_id)
    stop = stop_on_signals()
    transport = Transport(list(fleet.members), domain_id, Participants(options.participants))

    def take(happening: Happening, started: float) -> None:
        if isinstance(happening, Note):
            say(f"{happening.at:8.1f} s  {happening.text}")
        else:
            transport.take(happening, started)

    player = Player(fleet, take, complain)
    for name, member in fleet.members.items():
        if not member.spec.absent:
            transport.appear(name)
    with ros_context(domain_id) as context:
        control = Control(context, player.inject)
        say(f"ready: {len(fleet.members)} virtual robots in {_domains(options, domain_id, fleet)}")
        player.play(stop, duration)
        control.close()
    transport.close()


def fault(options: argparse.Namespace) -> None:
    """Set the parameter that stands for a component."""
    order = f"{options.level}: {options.message}" if options.message else options.level
    domain_id = chosen_domain_id(options.domain_id)
    set_parameter(domain_id, f"{options.robot}.{options.component}", order)


def replay(options: argparse.Namespace) -> None:
    """Publish recorded diagnostics on their topics."""
    topics = recorded_topics(options.files)
    stop = stop_on_signals()

    def renamed(topic: str) -> str:
        return f"/{options.namespace.strip('/')}{topic}" if options.namespace else topic

    with ros_context(chosen_domain_id(options.domain_id)) as context:
        playback = Playback(context, topics, renamed)
        say(f"ready: replays {', '.join(renamed(topic) for topic in topics)}")
        if not playback.wait_for_subscribers(options.wait, stop):
            complain(f"not every topic has a subscriber after {options.wait:g} s; begins")
        count = 0
        while not stop.is_set():
            count += playback.play(read_recordings(options.files), options.rate, stop)
            if not options.loop:
                break
        playback.close()
    say(f"{count} messages replayed")


def record(options: argparse.Namespace) -> None:
    """Write the diagnostics of a domain into a bag until SIGINT or SIGTERM, or for a duration."""
    writer = BagWriter(options.output, options.storage)
    stop = stop_on_signals()
    counted: Counter[str] = Counter()

    def take(message: Recorded) -> None:
        counted[message.topic] += 1
        writer.write(message)

    with ros_context(chosen_domain_id(options.domain_id)) as context:
        recorder = Recorder(context, options.topic or ["*"], take, _say_recorded)
        say(f"ready: records into {options.output}")
        recorder.record(stop, options.duration or float("inf"))
        recorder.close()
    writer.close()
    say(f"{counted.total()} messages of {len(counted)} topics recorded")


def fleet_of(options: argparse.Namespace) -> tuple[Fleet, float]:
    """The fleet that the options describe, and how long it shall play (seconds)."""
    version = None if options.aggregator == "none" else options.aggregator
    duration = options.duration or float("inf")
    if options.scenario is None:
        fleet = Fleet(_specs(options), options.seed or 0, version)
    else:
        scenario = load_scenario(options.scenario)
        seed = scenario.model.seed if options.seed is None else options.seed
        fleet = Fleet(scenario.specs, seed, version)
        plan(scenario, fleet)
        duration = options.duration or scenario.model.duration or float("inf")
    for text in fleet.complaints:
        complain(text)
    return fleet, duration


def stop_on_signals() -> threading.Event:
    """An event that SIGINT and SIGTERM set."""
    stop = threading.Event()

    def on_signal(_number: int, _frame: FrameType | None) -> None:
        stop.set()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, on_signal)
    return stop


def say(text: str) -> None:
    """A line on stdout, at once: others wait for it."""
    print(text, flush=True)  # noqa: T201 - a command's answer


def complain(text: str) -> None:
    """A line on stderr."""
    print(text, file=sys.stderr, flush=True)  # noqa: T201 - a command's answer


def _say_recorded(topic: str) -> None:
    say(f"records {topic}")


def _specs(options: argparse.Namespace) -> list[RobotSpec]:
    kind = kind_path(options.kind)
    settings: Path | None = options.settings
    if settings is not None and options.kind != "thesis":
        raise DocumentError(f"{settings}: --settings is for --kind thesis only")
    return [RobotSpec(f"robot_{n}", kind, settings) for n in range(1, options.robots + 1)]


def _domains(options: argparse.Namespace, first: int, fleet: Fleet) -> str:
    if options.participants == Participants.DOMAIN.value and len(fleet.members) > 1:
        return f"domains {first} to {first + len(fleet.members) - 1}"
    return f"domain {first}"
