"""What `run` and `fault` do, wired together from the other files; options come from cli.py.

Imports ROS; cli.py imports it only when a command that needs it is called.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from virtual_robots.ros.contexts import chosen_domain_id, ros_context
from virtual_robots.ros.control import Control, set_parameter
from virtual_robots.ros.transport import Participants, Transport, too_many_for_localhost
from virtual_robots.schema.documents import DocumentError
from virtual_robots.simulation.fleet import Fleet
from virtual_robots.simulation.kinds import kind_path
from virtual_robots.simulation.members import Happening, Note, RobotSpec
from virtual_robots.simulation.player import Player
from virtual_robots.simulation.scenario import load_scenario, plan
from virtual_robots.terminal import complain, say, stop_on_signals


def run(options: argparse.Namespace) -> None:
    """Publish a fleet until SIGINT or SIGTERM, or until its duration is over."""
    fleet, duration = fleet_of(options)
    domain_id = chosen_domain_id(options.domain_id)
    stop = stop_on_signals()
    participants = Participants(options.participants)
    transport = Transport(
        list(fleet.members), domain_id, participants, aggregated=options.aggregator != "none"
    )
    if sentence := too_many_for_localhost(len(fleet.members), participants, os.environ):
        complain(sentence)

    def take(happening: Happening, started: float) -> None:
        if isinstance(happening, Note):
            say(f"{happening.at:8.1f} s  {happening.text}")
        else:
            transport.take(happening, started)

    player = Player(fleet, take, complain)
    for name, member in fleet.members.items():
        if member.present:
            transport.appear(name)
    with ros_context(domain_id) as context:
        control = Control(context, player.inject)
        say(f"ready: {len(fleet.members)} virtual robots in {_domains(options, domain_id, fleet)}")
        player.play(stop, duration)
        control.close()
    transport.close()


def fault(options: argparse.Namespace) -> None:
    """Set the parameter that stands for a component, or for a whole robot."""
    order = f"{options.level}: {options.message}" if options.message else options.level
    target = f"{options.robot}.{options.component}" if options.component else options.robot
    set_parameter(chosen_domain_id(options.domain_id), target, order)


def fleet_of(options: argparse.Namespace) -> tuple[Fleet, float]:
    """The fleet that the options describe, and how long it shall play (seconds)."""
    version = None if options.aggregator == "none" else options.aggregator
    duration = options.duration or float("inf")
    if options.scenario is None:
        fleet = Fleet(_specs(options), options.seed or 0, version)
    elif options.kind or options.settings:
        raise DocumentError("--kind and --settings go with --robots; a scenario says them itself")
    else:
        scenario = load_scenario(options.scenario)
        seed = scenario.model.seed if options.seed is None else options.seed
        fleet = Fleet(scenario.specs, seed, version)
        plan(scenario, fleet)
        duration = options.duration or scenario.model.duration or float("inf")
    for text in fleet.complaints:
        complain(text)
    return fleet, duration


def _specs(options: argparse.Namespace) -> list[RobotSpec]:
    kind = kind_path(options.kind or "thesis")
    settings: Path | None = options.settings
    if settings is not None and options.kind not in {None, "thesis"}:
        raise DocumentError(f"{settings}: --settings is for --kind thesis only")
    return [RobotSpec(f"robot_{n}", kind, settings) for n in range(1, options.robots + 1)]


def _domains(options: argparse.Namespace, first: int, fleet: Fleet) -> str:
    if options.participants == Participants.DOMAIN.value and len(fleet.members) > 1:
        return f"domains {first} to {first + len(fleet.members) - 1}"
    return f"domain {first}"
