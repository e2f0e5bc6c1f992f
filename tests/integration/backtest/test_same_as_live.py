"""A bag recorded beside the running exporter gives the faults that the exporter recorded."""

import json
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from random import Random

import pytest
import yaml

from ros_diagnostics_exporter.config.load import load
from ros_diagnostics_tools.backtest.history import IDENTITY
from support.bags import judged
from testbed import http
from testbed.polling import until
from testbed.processes import Process

COMMANDS = Path(sys.executable).parent
ONE_MESSAGE = 1.3  # seconds: the robots publish once a second, and the exporter ticks four times
PLAYED = 30.0  # seconds of a scenario
FLEET = {
    "fleet": "live",
    "discovery": [{"topic": "/{robot}/diagnostics_agg"}],
    "profiles": {"default": {"stale_after": "3s", "confirm_after": "2s"}},
    "faults": {"restart_grace": "1s", "confirm_after": "1s"},
}
FAULTS = ("Motor 1", "Motor 2", "Laser 1", "Sensor 1")


def scenario(seed: int) -> dict:
    """Robots whose components fail and that crash or hang, by chance."""
    random = Random(seed)
    events = []
    for robot in ("robot_1", "robot_2", "robot_3"):
        component = random.choice(FAULTS)
        what = random.choice(("error", "warn"))
        at, length = random.uniform(4, 8), random.uniform(1, 8)
        events.append({"at": at, "robot": robot, "component": component, "what": what,
                       "for": length})  # fmt: skip
        events.append({"at": random.uniform(17, 20), "robot": robot,
                       "what": random.choice(("hang", "network_loss", "reboot")),
                       "for": random.uniform(1, 9)})  # fmt: skip
    events.append({"at": 5, "robot": "robot_4", "component": "Motor 1", "what": "error", "for": 8})
    events.append({"at": 15, "robot": "robot_4", "what": "hang", "for": 9})
    for event in events:
        for key in ("at", "for"):
            event[key] = round(float(event[key]), 1)
    return {
        "description": "by chance",
        "seed": seed,
        "duration": PLAYED,
        "robots": [{"kind": "thesis", "count": 4}],
        "events": sorted(events, key=lambda event: event["at"]),
    }


def recorded_events(address: str) -> list[dict]:
    """The exporter's events, oldest first."""
    found: list[dict] = http.get_json(address, "/api/v1/events?limit=10000")["events"]
    return found[::-1]


def key(event: dict) -> tuple[str, ...]:
    return tuple(event.get(name, "") for name in IDENTITY)


Fault = tuple[tuple[str, ...], float, float, float]  # identity, since, began, ended


def live_faults(events: list[dict]) -> list[Fault]:
    found: dict[tuple[str, ...], list[dict]] = {}
    for event in events:
        if event["kind"] in {"fault_began", "fault_ended"}:
            found.setdefault(key(event), []).append(event)
    faults = []
    for identity, changes in found.items():
        assert [each["kind"] for each in changes[::2]] == ["fault_began"] * len(changes[::2])
        assert len(changes) % 2 == 0, f"{identity} has not ended"
        faults += [
            (identity, began["since"], began["time"], ended["time"])
            for began, ended in zip(changes[::2], changes[1::2], strict=True)
        ]
    return sorted(faults)


def replayed_faults(config: Path, bag: Path, domain_id: int, until_then: float) -> list[Fault]:
    result = judged(load(config), bag, domain_id=domain_id)
    return sorted(
        (each.identity, each.since, each.began.time, each.ended or 0.0)
        for each in result.notifications
        if each.began.time < until_then
    )


@pytest.fixture
def played(
    tmp_path: Path, start_process: Callable[..., Process], dds_environment: dict[str, str],
    ros_domain: int, free_port: Callable[[], int],
) -> Callable[[int], tuple[list[dict], Path, Path]]:  # fmt: skip
    """A function (seed): plays a scenario; (events of the exporter, its config, the bag)."""

    def play(seed: int) -> tuple[list[dict], Path, Path]:
        config, plan = tmp_path / "fleet.yml", tmp_path / "scenario.yaml"
        fleet = json.loads(json.dumps(FLEET))
        fleet["discovery"][0]["domain_ids"] = [ros_domain]
        config.write_text(yaml.safe_dump(fleet))
        plan.write_text(yaml.safe_dump(scenario(seed)))
        bag, address = tmp_path / "bag", f"127.0.0.1:{free_port()}"
        robots_command = COMMANDS / "virtual-robots"
        record = [robots_command, "record", bag, "--topic", "/*/diagnostics_agg"]
        recorder = start_process("recorder", record, dds_environment)
        argv = [COMMANDS / "ros-diagnostics-exporter", "--config.file", config]
        argv += ["--storage.path", tmp_path / "exporter.db", "--web.listen-address", address]
        exporter = start_process("exporter", argv, dds_environment)
        exporter.wait_for_output("serving fleet")
        robots = [robots_command, "--scenario", plan]
        start_process("virtual-robots", robots, dds_environment)

        def over() -> list[dict] | None:
            """All events, if every fault has ended and every robot is back."""
            events = recorded_events(address)
            kinds = [each["kind"] for each in events]
            began, ended = kinds.count("fault_began"), kinds.count("fault_ended")
            back = {each["robot"]: each["after"] for each in events if each["kind"] == "robot"}
            late = began == ended > 3 and events[-1]["time"] - events[0]["time"] > PLAYED / 2
            return events if late and "silent" not in back.values() else None

        events = until(over, lambda: f"all faults have ended: {exporter.output()[-2000:]}", 120)
        exporter.stop()
        recorder.signal(signal.SIGINT)
        until(lambda: not recorder.alive, "the end of the recorder")
        return events, config, bag

    return play


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_a_bag_gives_the_faults_of_the_live_run(played, seed, ros_domain):
    events, config, bag = played(seed)

    live = live_faults(events)
    replayed = replayed_faults(config, bag, ros_domain, events[-1]["time"])

    assert len(live) > 1
    assert not unmatched(live, replayed)
    assert not unmatched(replayed, live)


def unmatched(faults: list[Fault], others: list[Fault]) -> list[Fault]:
    """Those that the others lack; one that a message more or less confirms may be lacking."""
    return [
        fault
        for fault in faults
        if fault[3] - fault[2] > ONE_MESSAGE and not any(is_same(fault, each) for each in others)
    ]


def is_same(fault: Fault, other: Fault) -> bool:
    times = zip(fault[1:], other[1:], strict=True)
    return fault[0] == other[0] and all(abs(one - two) < ONE_MESSAGE for one, two in times)
