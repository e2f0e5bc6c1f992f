"""A fault of the real program: its recording, and its page after a restart."""

import sys
import urllib.request
from contextlib import closing
from functools import partial
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from urllib.error import HTTPError

from ros_diagnostics_exporter.http_client import Client as Exporter
from ros_diagnostics_tools.ask import Answers
from ros_diagnostics_tools.backtest.recordings import Recordings, RecordingSource
from support import exposition
from support.called import called
from testbed.polling import until

TOPIC = "/robot_1/diagnostics_agg"


def recorded(path) -> list[bytes]:
    """The messages of robot_1 in a recording, in order."""
    with closing(Recordings([RecordingSource(path)])) as recordings:
        return [each.content for each in recordings.messages() if each.topic.name == TOPIC]


def test_a_recording_has_the_bytes_that_another_subscriber_recorded_and_replays(site):
    exporter = site.serve()
    bag, bin_folder = site.folder / "beside", Path(sys.executable).parent
    command = [bin_folder / "virtual-robots", "record", bag, "--topic", TOPIC]
    domain = ["--domain-id", str(site.domain_id)]
    recorder = site.start_program("recorder", [*command, *domain], domain_id=site.domain_id).process
    site.start_robots(2)
    until(lambda: site.up() == 2, exporter.describe, 60)

    site.fault("robot_1", "Motor 2", "error")
    until(lambda: site.ask("/api/v1/faults")["faults"], "the fault is confirmed", 60)
    [fault] = site.ask("/api/v1/faults")["faults"]
    url = f"http://127.0.0.1:{site.port}/api/v1/faults/{fault['fault']}/recording.mcap"
    recording, said = site.folder / "recording.mcap", list[str]()

    def is_there() -> bool:
        try:
            with urllib.request.urlopen(url, timeout=20) as answer:
                recording.write_bytes(answer.read())
        except HTTPError as error:
            said.append(error.read().decode())
            return False
        return True

    until(is_there, "the recording is complete", 60)
    path = url.removeprefix(f"http://127.0.0.1:{site.port}")
    assert f"recorded around its begin: {path}" in site.ask("/api/v1/why?robot=robot_1")["now"]
    recorder.stop()
    assert all("is complete in" in each for each in said)
    ours, theirs = recorded(recording), recorded(bag)
    assert len(ours) > 10
    begin = theirs.index(ours[0]) if ours[0] in theirs else 0
    shared = ours[ours.index(theirs[begin]) :]
    assert shared == theirs[begin : begin + len(shared)]
    assert len(shared) > 10
    ended = called(
        [bin_folder / "ros-diagnostics", "backtest", recording, *domain, "--output", "json"],
        timeout=60,
    )
    assert '"component": "Motor 2"' in ended.stdout
    asked = Answers(Exporter(f"http://127.0.0.1:{site.port}"))
    shown = asked.recording(fault["fault"])["answer"]
    # A recording that reaches back to the robot's start has "Node starting up" too, which is OK.
    levels = [level for level, _ in groupby(shown["statuses"], itemgetter("level"))]
    assert levels == ["OK", "ERROR"]
    assert shown["topics"][TOPIC] == len(ours)
    again = asked.backtest(fault["fault"], "1h")["answer"]
    as_it_is = [each["component"] for each in again["as_it_is"]["notifications"]]
    assert (as_it_is, again["with_it"]["notifications"]) == (["Motor 2"], [])
    assert "too short to know" in again["with_it"]["warnings"][-1]


def page(site, fault: str) -> tuple[int, str]:
    """Status and text of the page of a fault."""
    try:
        with urllib.request.urlopen(
            f"http://127.0.0.1:{site.port}/faults/{fault}", timeout=20
        ) as answer:
            return answer.status, answer.read().decode()
    except HTTPError as error:
        return error.code, error.read().decode()


def test_the_page_of_a_fault_knows_its_end_after_a_restart_and_says_what_is_forgotten(site):
    exporter = site.serve()
    site.start_robots(1)
    level = partial(exposition.samples, site.address, "component_level", component="Motor 2")
    until(level, exporter.describe, 60)
    site.fault("robot_1", "Motor 2", "error")
    until(lambda: site.ask("/api/v1/faults")["faults"], "the fault is confirmed", 60)
    [lasting] = site.ask("/api/v1/faults")["faults"]
    assert page(site, lasting["fault"])[1].count("It has ended") == 0
    site.fault("robot_1", "Motor 2", "ok")
    until(lambda: not site.ask("/api/v1/faults")["faults"], "the fault is over", 60)

    exporter.stop()
    again = site.serve()
    status, text = page(site, lasting["fault"])
    assert (status, "It has ended" in text) == (200, True)
    [known] = site.ask(f"/api/v1/faults/{lasting['fault']}")["occurrences"]
    assert (known["since"], known["evidence"]) == (lasting["since"], lasting["evidence"])
    assert known["until"] > known["confirmed"] >= known["since"]
    assert (known["reason"], known["end"][:2]) == ("recovered", "OK")

    again.stop()
    (site.folder / "exporter.db").unlink()
    forgetful = site.serve()
    until(site.up, forgetful.describe, 60)
    status, text = page(site, lasting["fault"])
    assert (status, "The log goes back to" in text) == (404, True)
