"""The commands `record` and `replay`; options come from cli.py.

Imports ROS and rosbags; cli.py imports it only when one of them is called.
"""

from __future__ import annotations

import argparse
import threading
from collections import Counter
from collections.abc import Callable

from virtual_robots.recording.bags import BagWriter, Recorded, read_recordings, recorded_topics
from virtual_robots.ros.bags import Playback, Recorder
from virtual_robots.ros.contexts import chosen_domain_id, ros_context
from virtual_robots.terminal import print_error, print_line, stop_on_signals


def replay(options: argparse.Namespace) -> None:
    """Publish recorded diagnostics on their topics."""
    topics = recorded_topics(options.files)
    stop = stop_on_signals()

    def renamed(topic: str) -> str:
        return f"/{options.namespace}{topic}" if options.namespace else topic

    with ros_context(chosen_domain_id(options.domain_id)) as context:
        playback = Playback(context, topics, renamed)
        print_line(f"ready: replaying {', '.join(renamed(topic) for topic in topics)}")
        if not playback.wait_for_subscribers(options.wait, stop):
            print_error(
                f"not every topic has a subscriber after {options.wait:g} s; starting anyway"
            )
        count = 0
        try:
            while not stop.is_set():
                count += playback.play(read_recordings(options.files), options.rate, stop)
                if not options.loop:
                    break
        finally:  # messages published before a file proved damaged shall arrive
            playback.close()
    print_line(f"{count} messages replayed")


def record(options: argparse.Namespace) -> None:
    """Write the diagnostics of a domain into a bag until SIGINT or SIGTERM, or for a duration."""
    stop = stop_on_signals()
    writer = BagWriter(options.output, options.storage)
    counted: Counter[str] = Counter()

    def write(message: Recorded) -> None:
        writer.write(message)
        if message.topic not in counted:
            print_line(f"recording {message.topic}")
        counted[message.topic] += 1

    try:
        _record(options, write, stop)
    finally:  # whatever ends the recording, the messages before it stay readable
        writer.close()
        print_line(f"{counted.total()} messages of {len(counted)} topics recorded")


def _record(
    options: argparse.Namespace, write: Callable[[Recorded], None], stop: threading.Event
) -> None:
    with ros_context(chosen_domain_id(options.domain_id)) as context:
        recorder = Recorder(context, options.topic or ["*"], write)
        print_line(f"ready: recording into {options.output}")
        try:
            recorder.record(stop, options.duration or float("inf"))
        finally:
            recorder.close()
