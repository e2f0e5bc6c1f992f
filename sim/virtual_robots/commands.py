"""The commands `run` and `fault`; options come from cli.py.

It imports ROS; cli.py imports it only when a command needs it.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from virtual_robots.ros.actions import action_type
from virtual_robots.ros.contexts import chosen_domain_id, ros_context
from virtual_robots.ros.control import Control, set_parameter
from virtual_robots.ros.messages import MessageTypes
from virtual_robots.ros.transport import Participants, Transport, too_many_for_localhost
from virtual_robots.schema.documents import DocumentError, located
from virtual_robots.simulation.fleet import Fleet
from virtual_robots.simulation.kinds import build_components, kind_path, load_kind
from virtual_robots.simulation.outputs import Note, Output
from virtual_robots.simulation.player import Player
from virtual_robots.simulation.robots import RobotSpec
from virtual_robots.simulation.scenario import load_scenario, schedule_events
from virtual_robots.terminal import print_error, print_line, stop_on_signals


def run(options: argparse.Namespace) -> None:
    """Publish a fleet until SIGINT or SIGTERM, or until its duration has passed."""
    fleet, duration = fleet_of(options)
    domain_id = chosen_domain_id(options.domain_id)
    stop = stop_on_signals()
    participants = Participants(options.participants)
    without = [name for name, each in fleet.robots.items() if not each.driver.has_diagnostics]
    aggregated = options.aggregator != "none"
    transport = Transport(
        list(fleet.robots),
        domain_id,
        participants,
        types_of(fleet),
        print_error,
        aggregated=aggregated,
        without=without,
    )
    if sentence := too_many_for_localhost(len(fleet.robots), participants, os.environ):
        print_error(sentence)

    def publish(output: Output, started: float) -> None:
        if isinstance(output, Note):
            print_line(f"{output.at:8.1f} s  {output.text}")
        else:
            transport.publish(output, started)

    player = Player(fleet, publish, print_error)
    for name, robot in fleet.robots.items():
        if robot.present:
            transport.add(name)
    with ros_context(domain_id) as context:
        control = Control(context, player.inject)
        print_line(
            f"ready: {len(fleet.robots)} virtual robots in {_domains(options, domain_id, fleet)}"
        )
        player.play(stop, duration)
        control.close()
    transport.close()


def fault(options: argparse.Namespace) -> None:
    """Set the parameter of a component or of a robot."""
    value = f"{options.level}: {options.message}" if options.message else options.level
    target = f"{options.robot}.{options.component}" if options.component else options.robot
    set_parameter(chosen_domain_id(options.domain_id), target, value)


def fleet_of(options: argparse.Namespace) -> tuple[Fleet, float]:
    """Return the fleet that the options describe, and its duration in seconds."""
    version = None if options.aggregator == "none" else options.aggregator
    duration = options.duration or float("inf")
    if options.scenario is None:
        fleet = Fleet(_specs(options), options.seed or 0, version)
    elif options.kind or options.settings:
        raise DocumentError("--kind and --settings go with --robots; a scenario has its own")
    else:
        scenario = load_scenario(options.scenario)
        seed = scenario.model.seed if options.seed is None else options.seed
        fleet = Fleet(scenario.specs, seed, version)
        schedule_events(scenario, fleet)
        duration = options.duration or scenario.model.duration or float("inf")
    for text in fleet.warnings:
        print_error(text)
    return fleet, duration


def types_of(fleet: Fleet) -> MessageTypes:
    """The types of the robots' own topics.

    Raises DocumentError if a kind's fields are not those of a type, RosError if no type of an
    action is installed.
    """
    kinds = {robot.spec.kind for robot in fleet.robots.values()}
    types = MessageTypes(kind.parent / "msg" for kind in kinds)
    for path in kinds:
        for action in load_kind(path).actions:
            action_type(action.types)
        for component in build_components(load_kind(path), ""):
            if (topic := component.model.publishes) is None:
                continue
            with located(f"{path}: {component.name}"):
                for fields in (component.fields(), *component.extreme_fields()):
                    types.encode(topic.type, fields)
    return types


def _specs(options: argparse.Namespace) -> list[RobotSpec]:
    kind = kind_path(options.kind or "thesis")
    settings: Path | None = options.settings
    if settings is not None and options.kind not in {None, "thesis"}:
        raise DocumentError(f"{settings}: --settings is for --kind thesis only")
    return [RobotSpec(f"robot_{n}", kind, settings) for n in range(1, options.robots + 1)]


def _domains(options: argparse.Namespace, first: int, fleet: Fleet) -> str:
    if options.participants == Participants.DOMAIN.value and len(fleet.robots) > 1:
        return f"domains {first} to {first + len(fleet.robots) - 1}"
    return f"domain {first}"
