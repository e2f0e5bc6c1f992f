"""What a program asks about the recording of a fault: what is in it, and what another time changes.

The recording has what judged it attached, so nothing else is needed.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import yaml

from ros_diagnostics_exporter.model import Level
from ros_diagnostics_tools.backtest.fault_recording import FaultRecording
from ros_diagnostics_tools.backtest.fault_recording import read as read_fault_recording
from ros_diagnostics_tools.backtest.recordings import Message, Recordings, RecordingSource
from ros_diagnostics_tools.yaml_nodes import get, made, scalar

MOST_STATUSES = 100  # of the component, each with another level or message than the one before
SECONDS = 120  # for a back-test
_SETTING = "confirm_after"


class NotAskedError(Exception):
    """There is no answer; the text says why."""


def summary(path: Path) -> dict[str, Any]:
    """The fault of a recording, its topics, and the changes of the fault's component."""
    recording = _read(path)
    component = recording.fault.get("component", "")
    with closing(Recordings([RecordingSource(path)])) as read:
        messages = list(read.messages())
    changes = list(_changes(messages, component)) if component else []
    return {
        "fault": recording.fault,
        "topics": dict(Counter(each.topic.name for each in messages)),
        "begin": min((each.at for each in messages), default=None),
        "end": max((each.at for each in messages), default=None),
        "statuses": changes[:MOST_STATUSES],
        "more_statuses": max(0, len(changes) - MOST_STATUSES),
    }


def _read(path: Path) -> FaultRecording:
    found = read_fault_recording(path)
    if found is None:
        raise NotAskedError("the exporter's answer is no recording of a fault")
    return found


def _changes(messages: list[Message], component: str) -> Iterator[dict[str, Any]]:
    """The statuses of a component where their level or message changes."""
    last = None
    for each in messages:
        for status in _statuses(each):
            is_its = status.name == component or status.name.endswith(f"/{component}")
            if not is_its or (status.level, status.message) == last:
                continue
            last = status.level, status.message
            level = Level(status.level).name if status.level in set(Level) else status.level
            values = dict(status.values)
            yield {"time": each.at, "level": level, "message": status.message, "values": values}


def _statuses(message: Message) -> tuple[Any, ...]:
    try:
        return tuple(message.decode().statuses)
    except ValueError:  # of another topic, or damaged: the back-test counts those
        return ()


def judged_again(path: Path, confirm_after: str) -> dict[str, Any]:
    """What would have been notified of a recording with another ``confirm_after``."""
    config = path.with_name("fleet.yml")
    config.write_bytes(_read(path).config)
    changed = path.with_name("changed.yml")
    changed.write_text(with_confirm_after(config.read_text("utf-8"), confirm_after), "utf-8")
    # A process of its own: the time is limited, and what it prints is not part of the protocol.
    command = [sys.executable, "-m", "ros_diagnostics_tools.main", "backtest", str(path), "--quiet"]
    # The changed one first: it may be no configuration.
    found = [_backtest([*command, "--config", str(each)]) for each in (changed, config)]
    otherwise, as_it_is = (
        {key: each[key] for key in ("notifications", "warnings")} for each in found
    )
    return {_SETTING: confirm_after, "as_it_is": as_it_is, "with_it": otherwise}


def _backtest(command: list[str]) -> dict[str, Any]:
    try:
        done = subprocess.run(  # noqa: S603 - this program
            [*command, "--output", "json"],
            stdin=subprocess.DEVNULL,  # it has the questions
            capture_output=True,
            text=True,
            timeout=SECONDS,
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        raise NotAskedError(f"the back-test takes more than {SECONDS} s") from error
    if done.returncode:
        raise NotAskedError(done.stderr.strip())
    answer: dict[str, Any] = json.loads(done.stdout)
    return answer


def with_confirm_after(config: str, duration: str) -> str:
    """The text of a fleet.yml in which each ``confirm_after`` of its profiles is this one.

    Everything else stays as it is written.
    """
    root = yaml.compose(config, Loader=yaml.BaseLoader)
    if not isinstance(root, yaml.MappingNode):
        raise NotAskedError("the fleet.yml in the recording is no mapping")
    if get(root, "profiles") is None:
        root.value.append((made("profiles"), made({"default": {}})))
    for _name, profile in get(root, "profiles").value:
        _set(profile, duration)
        if isinstance(profile, yaml.MappingNode) and get(profile, _SETTING) is None:
            profile.value.append((made(_SETTING), made(duration)))
    text: str = yaml.serialize(root, Dumper=yaml.BaseDumper, allow_unicode=True)
    return text


def _set(node: yaml.Node, duration: str) -> None:
    """Replace each value of the key in a node and below it."""
    if isinstance(node, yaml.SequenceNode):
        for each in node.value:
            _set(each, duration)
    elif isinstance(node, yaml.MappingNode):
        node.value = [
            (key, made(duration) if scalar(key) == _SETTING else value) for key, value in node.value
        ]
        for _key, value in node.value:
            _set(value, duration)
