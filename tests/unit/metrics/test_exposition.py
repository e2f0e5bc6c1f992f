"""The text is valid for every string ROS can carry, the same in both formats, and rendered once."""

from __future__ import annotations

import math
import re
import time
from types import SimpleNamespace
from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st
from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.metrics_core import CounterMetricFamily, GaugeMetricFamily
from prometheus_client.openmetrics import parser as openmetrics_parser
from prometheus_client.parser import text_string_to_metric_families
from prometheus_client.registry import Collector

from ros_diagnostics_exporter.canary import FIRST, Canary
from ros_diagnostics_exporter.config.capabilities import (
    Capability,
    ComponentsOf,
    Expression,
    FleetCapability,
    RobotsOf,
)
from ros_diagnostics_exporter.config.fleet import (
    ComponentRule,
    Discovery,
    Fleet,
    Limits,
    Profile,
    Query,
    Robot,
    Source,
    Threshold,
    ValueRule,
)
from ros_diagnostics_exporter.faults.model import CapabilityState
from ros_diagnostics_exporter.firing import REMOVED
from ros_diagnostics_exporter.loops import Loop
from ros_diagnostics_exporter.metrics import families as metrics
from ros_diagnostics_exporter.metrics.cache import STATES
from ros_diagnostics_exporter.metrics.exposition import Exposition
from ros_diagnostics_exporter.metrics.self_metrics import (
    EOF,
    EXPORTER_FAMILIES,
    SelfMetrics,
)
from ros_diagnostics_exporter.metrics.week import FaultyPart, Lengths, Week
from ros_diagnostics_exporter.model import Downtime, Endpoint, Instant, Part, Status
from ros_diagnostics_exporter.robots.rejections import REASONS, FleetRejectionReason
from ros_diagnostics_exporter.sources.link import LinkReading
from ros_diagnostics_exporter.sources.prometheus import Outcome
from support.state_driver import ERROR, OK, SETTLED, STALE, WALL, WARN, StateDriver, tree

HOSTILE = [
    'quote " backslash \\ newline \n end',
    "\\n",
    "tab\tcarriage\rreturn\x00nul\x1fescape\x7f",
    "Ünïcødé 🔦 ٣ \u202e right to left",
    "\ud800 lone surrogate",
    "} 1\nros_diagnostics_robot_up{robot=",
    "# HELP x",
    " leading and trailing ",
    "",
    "{{ template }} ${HOME} %s",
    "\u2028line separator\u0085",
]
HISTOGRAM = re.compile(r"(?<=canary_notification_seconds)_(bucket|count|sum)$")
# What a driver's string may be: any Unicode, lone surrogates included.
TEXT = st.text(st.characters(exclude_categories=[]), max_size=20)
STATUS = st.builds(
    Status,
    level=st.integers(0, 255),
    name=TEXT,
    message=TEXT,
    hardware_id=TEXT,
    values=st.lists(
        st.tuples(TEXT, TEXT | st.floats().map(str) | st.just("[1, 2]")), max_size=4
    ).map(tuple),
)


class Same(Collector):
    """The samples of a text as given to prometheus_client as a custom collector would."""

    def __init__(self, text):
        self.families = list(text_string_to_metric_families(text))

    def collect(self):
        for family in self.families:
            names = list(family.samples[0].labels)
            make = CounterMetricFamily if family.type == "counter" else GaugeMetricFamily
            copy = make(family.name, family.documentation, labels=names)
            for sample in family.samples:
                copy.add_metric([sample.labels[name] for name in names], sample.value)
            yield copy


def comparable(families):
    """Families as sets of samples in which NaN equals itself."""
    return {
        (family.name, family.type, family.documentation): sorted(
            (sample.name, tuple(sorted(sample.labels.items())), repr(float(sample.value)))
            for sample in family.samples
        )
        for family in families
    }


def assert_both_parsers_agree(driver: StateDriver) -> None:
    text = driver.exposition.render().decode()
    openmetrics = driver.exposition.render(openmetrics=True).decode() + "# EOF\n"
    registry = CollectorRegistry()
    registry.register(Same(text))
    ours = comparable(text_string_to_metric_families(text))
    series = [line.rpartition(" ")[0] for line in text.split("\n") if line[:1] not in ("", "#")]
    assert len(series) == len(set(series))
    assert ours == comparable(text_string_to_metric_families(generate_latest(registry).decode()))
    assert ours == comparable(openmetrics_parser.text_string_to_metric_families(openmetrics))


@given(st.lists(STATUS, max_size=6))
def test_whatever_a_driver_says_both_parsers_read_what_generate_latest_would_write(statuses):
    driver = StateDriver()
    driver.raw(*statuses)
    driver.at(2)
    driver.raw(*statuses[:2])

    assert_both_parsers_agree(driver)


@pytest.mark.parametrize("text", HOSTILE)
def test_a_hostile_string_arrives_unharmed_in_its_label(text):
    driver = StateDriver()
    driver.raw(Status(ERROR, text, text, text, ((text, "1"),)))

    assert_both_parsers_agree(driver)
    shown = text.encode("utf-8", "replace").decode()
    assert driver.sample("component_level", component=shown or "(unnamed)") == ERROR
    assert driver.sample("component_message_info", message=shown) == 1


def test_names_that_look_alike_as_labels_stay_two_series():
    driver = StateDriver()
    driver.raw(Status(OK, "a\ud800"), Status(ERROR, "a?"), Status(OK, ""), Status(OK, "(unnamed)"))

    assert_both_parsers_agree(driver)
    levels = {
        dict(labels)["component"]: v for labels, v in driver.samples()["component_level"].items()
    }
    assert levels == {"a?": 0, "a?~2": 2, "(unnamed)": 0, "(unnamed)~2": 0}


def full_scenario() -> StateDriver:
    """A robot with something in every family."""
    profile = Profile(
        stale_after=5.0,
        components=(
            ComponentRule(re.compile("Laser"), stale_after=2.0, confirm_after=0.0),
            ComponentRule(re.compile("Cam"), planned_stale=True),
        ),
        values=(
            ValueRule(key=re.compile("Voltage"), thresholds=(Threshold("low", "warning", 22.0),)),
            ValueRule(key=re.compile("Charge"), metric="ros_battery_charge_ratio", scale=0.01),
        ),
        capabilities={
            "view": Capability("view", Expression(1, (ComponentsOf((re.compile("Laser"),)),)))
        },
    )
    robot = Robot(
        "r",
        topic_agg="/r/diagnostics_agg",
        source=Source.AGG,
        profile=profile,
        labels={"site": "hall", "robot_group": "carriers"},
    )
    driver = StateDriver(fleet=Fleet("f", (robot,), exporter="e"))
    values = (("Voltage", "21.5 V"), ("Charge", "17"), ("Current", "3 A"))
    battery = Status(WARN, "Battery", "Low", "b-1", values)
    parts = [battery, Status(OK, "Laser"), Status(3, "Cam", "gone"), Status(200, "Odd", "what")]
    driver.agg(*tree(All=parts))
    driver.at(1)
    driver.agg(*tree(All=[battery, Status(ERROR, "Laser"), Status(3, "Cam", "gone")]))
    reading = LinkReading(10, 1, 0.1, 0.01)
    driver.state.update_links(0, {"/r/diagnostics_agg": reading}, driver.now)
    driver.state.update_nodes(0, [("amcl", "/")], driver.now)
    ends = driver.now.wall + 1
    driver.state.plan([Downtime("r", "Odd", 0.0, ends, "ann", "")], driver.now)
    return driver


def test_every_family_but_those_of_absent_things_is_served_with_its_labels():
    driver = full_scenario()
    samples = driver.samples()
    absent = {"check_expected_components", "robot_clock_offset_seconds", "robot_silent_reason"}
    absent |= {"robot_flapping", "robot_watch_bytes_per_second"}
    families = set(metrics.FLEET_FAMILIES) - {*metrics.MISSION_FAMILIES}  # see test_missions.py
    for family in families:
        name = family.name.removeprefix(metrics.PREFIX)
        if name in absent:
            continue
        for labels in samples[name]:
            found = {label for label, _value in labels}
            extra = {"site", "robot_group"} if family.open else set()
            assert found == set(family.labels) | extra, name


def test_the_samples_of_each_family_have_the_values_of_the_robot():
    driver = full_scenario()
    found = {name: sorted(series.values()) for name, series in driver.samples().items()}
    begin = WALL
    assert found == {
        "capability_state": [3],
        "check_components": [0, 1, 1, 2],
        "check_state": [6],
        "component_changes_total": [0, 0, 1, 1],
        "component_flap_ratio": [0.0625] * 3,
        "component_info": [1] * 4,
        "component_level": [1, 2, 3, 3],
        "component_maintenance": [1],
        "component_message_info": [1] * 4,
        "component_planned_stale": [1],
        "component_problem_since_timestamp_seconds": [begin, begin, begin, begin + 1],
        "component_state": [1, 2, 6, 6],
        "component_suppressed": [1],
        "component_since_timestamp_seconds": [begin, begin, begin + 1, begin + 1],
        "component_stale_after_seconds": [2],
        "component_value": [3, 21.5],
        "component_value_threshold": [22],
        "fault_member": [1],
        "fault_start_timestamp_seconds": [begin + 1],
        "fleet_components": [0, 1, 1, 2],
        "group_level": [0],
        "robot_expected_nodes": [0],
        "robot_info": [1],
        "robot_last_message_timestamp_seconds": [begin + 1],
        "robot_last_rejected_timestamp_seconds": [begin],
        "robot_link_clock_offset_seconds": [0],
        "robot_link_delay_seconds": [0.1],
        "robot_link_jitter_seconds": [0.01],
        "robot_link_lost_ratio": [0.1],
        "robot_maintenance": [0],
        "robot_message_bytes_total": [200],
        "robot_messages_total": [2],
        "robot_publishers": [0],
        "robot_rejected_total": [0] * 9 + [1],
        "robot_stale_after_seconds": [5],
        "robot_state": [6],
        "robot_up": [1],
        "ros_battery_charge_ratio": [0.17],
        "site_received_robots": [1],
    }
    info = {"topic": "/r/diagnostics_agg", "profile": "default", "domain_id": "0"}
    assert driver.sample("robot_info", **info) == 1


def test_what_is_not_configured_has_no_series_and_no_byte():
    driver = StateDriver()
    driver.raw(Status(ERROR, "Motor"))
    driver.at(SETTLED)
    unused = {
        *metrics.MISSION_FAMILIES,
        metrics.CAPABILITY_STATE,
        metrics.FLEET_CAPABILITY_STATE,
        metrics.FLEET_CAPABILITY_ROBOTS,
        metrics.CHECK_EXPECTED,
        metrics.COMPONENT_SUPPRESSED,
        metrics.COMPONENT_PLANNED_STALE,
        metrics.COMPONENT_MAINTENANCE,
        metrics.COMPONENT_VALUE_THRESHOLD,
        metrics.DOWNTIME_END,
        metrics.ROBOT_DOWNTIME_END,
        metrics.ROBOT_WATCHED,
    }
    text = driver.exposition.render()
    assert b"ros_diagnostics_component_level" in text
    assert not [family.name for family in unused if family.name.encode() in text]


def test_robots_that_are_received_are_counted_for_each_site_and_rejected_ones_have_the_reason():
    robots = [
        Robot(f"r{n}", topic_raw=f"/r{n}/diagnostics", source=Source.RAW, labels={"site": site})
        for n, site in enumerate(("hall", "hall", "hall", "yard"))
    ]
    wanted = Discovery(re.compile("/(?P<robot>[^/]+)/diagnostics"), "/{robot}/diagnostics")
    fleet = Fleet("f", tuple(robots), discoveries=(wanted,), limits=Limits(robots=4))
    driver = StateDriver(fleet=fleet)
    for each in robots[:2]:
        driver.receive(each.topic_raw, Status(OK, "Motor"))
    driver.state.update_graph(0, {"/extra/diagnostics": Endpoint(1)}, driver.now)

    assert driver.sample("site_received_robots", site="hall") == 2
    assert driver.sample("site_received_robots", site="yard") == 0
    assert driver.sample("robot_silent_reason", robot="extra", reason="limit") == 1


def test_what_the_fleet_can_do_and_the_downtimes_of_robots_are_counted():
    lift = Capability("lift", Expression(None, (ComponentsOf((re.compile("Lift"),)),)))
    robots = [
        Robot(
            f"r{n}",
            topic_raw=f"/r{n}/diagnostics",
            source=Source.RAW,
            profile=Profile(capabilities={"lift": lift}),
            labels={"site": "hall", "team": "red"},
        )
        for n in range(5)
    ]
    two = FleetCapability("lifting", Expression(2, (RobotsOf("lift", {}),)))
    fleet = Fleet("f", tuple(robots), exporter="e", capabilities={"lifting": two})
    driver = StateDriver(fleet=fleet)
    driver.state.plan([Downtime("r4", "", 0.0, WALL + 100, "ann", "new\ntires")], driver.now)
    for robot, level in zip(robots, (OK, WARN, ERROR, None, ERROR), strict=True):
        if level is not None:
            driver.receive(robot.topic_raw, Status(level, "Lift"))
    driver.at(2)

    own = {"fleet": "f", "exporter": "e"}
    samples = driver.samples()
    assert samples["fleet_capability_state"] == {
        tuple(sorted({**own, "capability": "lifting"}.items())): STATES[CapabilityState.DEGRADED]
    }
    counted = {"ok": 1, "degraded": 1, "lost": 1, "unknown": 1, "maintenance": 1}
    assert samples["fleet_capability_robots"] == {
        tuple(sorted({**own, "capability": "lifting", "state": state}.items())): number
        for state, number in counted.items()
    }
    labels = {"site": "hall", "team": "red", "author": "ann", "downtime": "new tires"}
    named = {**own, **labels, "robots": "r4"}
    ends = samples["downtime_end_timestamp_seconds"]
    assert ends == {tuple(sorted(named.items())): WALL + 100}
    of_robot = {"fleet": "f", "robot": "r4", "downtime": "new tires", "author": "ann"}
    ends = samples["robot_downtime_end_timestamp_seconds"]
    assert ends == {tuple(sorted(of_robot.items())): WALL + 100}


def test_a_robot_has_the_end_of_its_last_downtime_until_that_is_over():
    driver = StateDriver()
    first, second = (Downtime("r", "", 0.0, WALL + end, "", f"to {end}") for end in (60, 120))
    assert driver.sample("robot_downtime_end_timestamp_seconds") is None
    driver.state.plan([first], driver.now)
    assert driver.sample("robot_downtime_end_timestamp_seconds", downtime="to 60") == WALL + 60
    driver.state.plan([first, second], driver.now)
    assert driver.sample("robot_downtime_end_timestamp_seconds") == WALL + 120
    driver.at(121)
    assert driver.sample("robot_downtime_end_timestamp_seconds") is None


def test_the_end_of_a_fault_says_as_text_when_it_ended_and_how_long_it_lasted():
    """Rules pass on the text, and mails have it: the value of the alert is when it began."""
    driver = StateDriver(confirm_after=2.0)
    driver.raw_every(1, SETTLED, Status(OK, "Motor"))
    driver.raw_every(1, SETTLED + 75, Status(ERROR, "Motor", "hot"))
    driver.raw(Status(OK, "Motor", "runs"))
    driver.at(SETTLED + 76)
    [(labels, end)] = driver.samples()["fault_end_timestamp_seconds"].items()
    at = time.strftime("%Y-%m-%d %H:%M:%S UTC", time.gmtime(end))
    lasted = "1m15s"

    assert end == WALL + SETTLED + 75
    assert dict(labels)["evidence"] == f"OK: runs;\nended {at}, after {lasted}"
    assert dict(labels)["reason"] == "recovered"

    driver.state.forget("r", None, driver.now)
    ends = driver.samples()["fault_end_timestamp_seconds"]
    assert [dict(each)["evidence"] for each in ends if "fault" not in dict(each)] == [REMOVED]


def test_a_promoted_value_with_a_threshold_is_also_where_rules_look_for_it():
    rule = ValueRule(
        metric="ros_charge_ratio",
        unit="ratio",
        scale=0.01,
        thresholds=(Threshold("low", "critical", 0.2),),
    )
    profile = Profile(values=(rule,))
    robot = Robot("r", topic_agg="/r/diagnostics_agg", source=Source.AGG, profile=profile)
    driver = StateDriver(fleet=Fleet("f", (robot,)))
    driver.agg(*tree(All=[Status(OK, "Battery", values=(("Charge", "17"),))]))

    promoted = driver.sample("ros_charge_ratio", key="Charge")
    value = driver.sample("component_value", key="Charge", unit="ratio")
    bound = driver.sample("component_value_threshold", key="Charge", unit="ratio")
    assert (promoted, value, bound) == (0.17, 0.17, 0.2)


def test_values_of_a_stale_component_are_not_shown():
    driver = full_scenario()
    driver.at(10)

    assert driver.sample("component_level", component="Battery") == STALE
    assert "component_value" not in driver.samples()

    driver.agg(*tree(All=[Status(OK, "Battery", "OK", "b-1", (("Voltage", "25 V"),))]))
    assert driver.sample("component_value", component="Battery", key="Voltage") == 25


def test_infinite_and_undefined_numbers_are_written_as_the_formats_want_them():
    driver = StateDriver()
    driver.raw(Status(OK, "c", values=(("a", "inf"), ("b", "-inf"), ("c", "nan"))))
    text = driver.exposition.render().decode()

    assert re.findall(r'key="(.)",unit=""} (.*)', text) == [
        ("a", "+Inf"),
        ("b", "-Inf"),
        ("c", "NaN"),
    ]


def test_repeated_keys_and_keys_that_end_in_a_colon_are_series_of_their_own():
    driver = StateDriver()
    driver.raw(Status(OK, "c", values=(("n:", "1"), ("n", "2"), ("n ", "3"))))

    shown = {dict(labels)["key"]: v for labels, v in driver.samples()["component_value"].items()}
    assert shown == {"n": 1, "n#2": 2, "n#3": 3}


def test_a_unit_is_fixed_at_first_sight_and_another_one_is_counted_not_shown():
    driver = StateDriver()
    driver.raw(Status(OK, "c", values=(("v", "12 V"),)))
    driver.raw(Status(OK, "c", values=(("v", "nan"),)))
    assert math.isnan(driver.sample("component_value", key="v", unit="V"))

    driver.raw(Status(OK, "c", values=(("v", "12000 mV"),)))
    assert driver.sample("component_value", key="v") is None
    assert driver.sample("robot_rejected_total", reason="unit_changed") == 1


def test_what_did_not_change_is_not_rendered_again():
    driver = full_scenario()
    driver.exposition.render()
    (text,) = driver.exposition._texts.values()
    before = dict(text.chunks)
    driver.exposition.render()

    assert all(text.chunks[name] is chunk for name, chunk in before.items())

    driver.agg(*tree(All=[Status(WARN, "Battery", "Low", "b-1", (("Voltage", "21.4 V"),))]))
    driver.agg(*tree(All=[Status(WARN, "Battery", "Low", "b-1", (("Voltage", "21.3 V"),))]))
    driver.exposition.render()
    before = dict(text.chunks)
    driver.agg(*tree(All=[Status(WARN, "Battery", "Low", "b-1", (("Voltage", "21.2 V"),))]))
    driver.exposition.render()
    renewed = {name for name, chunk in before.items() if text.chunks[name] is not chunk}
    assert "ros_diagnostics_component_value" in renewed
    assert "ros_diagnostics_robot_messages_total" in renewed
    assert "ros_diagnostics_component_level" not in renewed


def test_planned_to_be_stale_are_only_those_that_the_config_names():
    driver = StateDriver(
        components=(
            ComponentRule(re.compile("Laser"), planned_stale=True),
            ComponentRule(re.compile("Motor"), stale_after=60.0),
        )
    )
    driver.raw(Status(OK, "Laser"), Status(OK, "Motor"))
    shown = [dict(labels) for labels in driver.samples()["component_planned_stale"]]
    assert [each["component"] for each in shown] == ["Laser"]


def test_a_downtime_of_a_component_alone_is_shown_as_long_as_it_holds():
    driver = StateDriver()
    driver.raw(Status(ERROR, "Laser"), Status(ERROR, "Motor"))
    ends = driver.now.wall + 10
    driver.state.plan([Downtime("r", "Motor", 0.0, ends, "ann", "new gears")], driver.now)
    driver.at(2)
    [shown] = map(dict, driver.samples()["component_maintenance"])
    assert shown["component"] == "Motor"
    assert driver.sample("robot_maintenance") == 0

    driver.at(12)
    assert "component_maintenance" not in driver.samples()


def test_a_message_is_cut_to_the_length_of_a_label():
    robot = Robot("r", topic_raw="/r/diagnostics", source=Source.RAW)
    driver = StateDriver(fleet=Fleet("f", (robot,), limits=Limits(label_length=20)))
    driver.raw(Status(ERROR, "Motor", "0123456789" * 3))
    (labels,) = driver.samples()["component_message_info"]
    assert dict(labels)["message"] == "0123456789" * 2


def test_a_reason_of_silence_that_applied_goes_on_as_0():
    driver = StateDriver(stale_after=5.0)
    driver.state.update_graph(0, {"/r/diagnostics": Endpoint(1)}, driver.now)
    assert reasons(driver) == {"mute": 1}
    driver.state.domain_failed(0, "broken", driver.now)
    assert reasons(driver) == {"mute": 0, "domain_unreachable": 1}
    driver.state.domain_joined(0)
    driver.raw(Status(OK, "Motor"))
    assert reasons(driver) == {"mute": 0, "domain_unreachable": 0}


def reasons(driver: StateDriver) -> dict[str, float]:
    """Reason of silence -> its sample."""
    shown = driver.samples()["robot_silent_reason"]
    return {dict(labels)["reason"]: value for labels, value in shown.items()}


def test_the_series_of_the_last_scrape_are_counted_by_family():
    driver = full_scenario()
    text = driver.exposition.render()

    counted = sum(driver.exposition.series.values())
    assert counted == sum(1 for line in text.splitlines() if not line.startswith(b"#"))
    for part in Part:
        driver.exposition.render(parts={part})
        assert sum(driver.exposition.series.values()) == counted


def families_of(text: bytes) -> set[str]:
    """The full names of the families that have samples."""
    return {
        sample.name
        for family in text_string_to_metric_families(text.decode())
        for sample in family.samples
    }


@pytest.mark.parametrize("openmetrics", [False, True])
def test_the_parts_are_the_whole(openmetrics):
    def lines(parts):
        both = (each.render(openmetrics=openmetrics, parts=parts) for each in sources)
        now = re.compile(rb"process|python_gc")  # other numbers at each scrape
        return sorted(line for text in both for line in text.splitlines() if not now.search(line))

    driver = full_scenario()
    driver.at(1.5)
    driver.exposition.render()
    sources = driver.exposition, self_metrics(driver)
    parts = [lines({part}) for part in Part]
    assert all(parts)
    assert sorted(line for part in parts for line in part) == lines(frozenset(Part))
    assert lines({Part.FAULTS, Part.EXPORTER}) == sorted(parts[0] + parts[2])
    assert not lines(set())


def test_what_alerts_on_faults_need_is_a_part():
    driver = full_scenario()
    for second in range(2, 20):
        driver.at(second)
        driver.agg(*tree(All=[Status(ERROR, "Laser")]))
    driver.at(40)

    found = families_of(driver.exposition.render(parts={Part.FAULTS}))
    found |= families_of(self_metrics(driver).render(parts={Part.FAULTS}))
    assert {name.removeprefix(metrics.PREFIX) for name in found} == {
        *("fault_start_timestamp_seconds", "fault_member"),
        "component_state",
        *("robot_up", "robot_silent_reason", "robot_maintenance", "exporter_settled"),
        *("robot_info", "robot_state", "site_received_robots"),
        *("canary_start_timestamp_seconds", "shard_robots"),
    }


def test_a_robot_that_has_not_changed_is_not_visited(monkeypatch):
    driver = StateDriver()
    driver.raw(Status(OK, "Motor"))
    first = driver.exposition.render()
    monkeypatch.setattr(Exposition, "_update_robot", None)
    assert driver.exposition.render() == first
    driver.raw(Status(ERROR, "Motor"))
    with pytest.raises(TypeError):
        driver.exposition.render()


def test_every_reason_of_a_rejection_is_counted_from_0_on():
    driver = StateDriver()
    counted = {"fleet": "f", "robot": "r"}
    assert driver.samples()["robot_rejected_total"] == {
        tuple(sorted({**counted, "reason": reason}.items())): 0 for reason in REASONS
    }
    driver.raw(Status(200, "Odd"))
    assert driver.sample("robot_rejected_total", reason="bad_level") == 1
    assert driver.sample("robot_rejected_total", reason="rate") == 0

    own = self_metrics(driver).render().decode()
    for reason in get_args(FleetRejectionReason):
        line = f'exporter_rejected_total{{fleet="f",reason="{reason}"}} 0.0'
        assert line in own


WEEK = Week(
    3,
    Lengths(2, 60.0, 90.0),
    Lengths(1, 5.0, 5.0),
    7,
    [FaultyPart("r", "/Motor/Motor 1", 2, 30.0)],
    {"2026-01-01": 4},
)


def self_metrics(driver: StateDriver) -> SelfMetrics:
    """The exporter's own metrics, with everything that they are read from."""
    part = SimpleNamespace(
        successful=True,
        time=1.5,
        written_at=2.5,
        early=SimpleNamespace(counts={"r": 3}),
        answers=lambda _now: True,
    )
    listener = SimpleNamespace(
        domain_ids=(0,),
        errors={1: "why"},
        last_looks={0: 3.5},
        decode_seconds=4.5,
        ingest_seconds=5.5,
    )
    canary = Canary(Instant(-FIRST, 0.0))
    canary.tick(300.0, driver.now)
    loops = [Loop("tick", 1.0, driver.now.count)]
    outcomes = [
        Outcome(Query("up", "node"), "", rows=2, skipped=3),
        Outcome(Query("up", "down"), "bad"),
        Outcome(Query("up", "new")),
    ]
    exporter = SimpleNamespace(
        state=driver.state,
        exposition=driver.exposition,
        listener=listener,
        reloader=part,
        storage=part,
        rejected_logins=SimpleNamespace(total=4),
        recording_dropped=5,
        alertmanager=part,
        canary=canary,
        ros=("jazzy", "rmw_fastrtps_cpp"),
        loops=lambda: loops,
        outcomes=lambda: outcomes,
        scrapes=0,
        scrape_seconds=6.5,
        week=WEEK,
        others=SimpleNamespace(samples=lambda _now: [(("4", "site", "hall", "", "fresh"), 7.5)]),
    )
    return SelfMetrics(exporter)


def test_the_exporters_own_families_are_those_of_the_table():
    driver = full_scenario()
    driver.exposition.render()
    own = self_metrics(driver)

    for text, parse in (
        (own.render(), text_string_to_metric_families),
        (own.render(openmetrics=True) + EOF, openmetrics_parser.text_string_to_metric_families),
    ):
        families = {
            HISTOGRAM.sub("", sample.name): set(sample.labels) - {"le"}
            for family in parse(text.decode())
            for sample in family.samples
            if sample.name.startswith(metrics.PREFIX)
        }
        assert families == {each.name: set(each.labels) for each in EXPORTER_FAMILIES}


def test_the_exporters_own_samples_are_what_its_parts_say():
    driver = full_scenario()
    driver.exposition.render()
    found: dict[str, dict[str, float]] = {}
    for family in text_string_to_metric_families(self_metrics(driver).render().decode()):
        for sample in family.samples:
            of = [v for k, v in sorted(sample.labels.items()) if k not in {"fleet", "exporter"}]
            name = sample.name.removeprefix(metrics.PREFIX)
            if name != sample.name:
                found.setdefault(name, {})[" ".join(of)] = sample.value
    [(versions, build_info)] = found.pop("exporter_build_info").items()
    assert (versions.split()[1:3], build_info) == (["rmw_fastrtps_cpp", "jazzy"], 1)
    kinds = ("capability", "check", "component", "condition", "discovery", "maintenance", "shared")
    times = (2.5, 5.0, 7.5, 10.0, 12.0, 15.0, 20.0, 30.0, 60.0, "+Inf")
    assert found == {
        "exporter_config_unmatched": dict.fromkeys((*kinds, "topic", "value"), 0),
        "exporter_rejected_total": dict.fromkeys(get_args(FleetRejectionReason), 0),
        "canary_notification_seconds_bucket": dict.fromkeys(map(str, times), 0),
        "canary_notification_seconds_count": {"": 0},
        "canary_notification_seconds_sum": {"": 0},
        "exporter_config_last_reload_successful": {"": 1},
        "exporter_config_last_reload_success_timestamp_seconds": {"": 1.5},
        "exporter_robots": {"": 1},
        "exporter_series": driver.exposition.series,
        "exporter_series_limit": {"": 1_000_000},
        "exporter_settled": {"": 1},
        "exporter_storage_last_write_successful": {"": 1},
        "exporter_storage_last_write_success_timestamp_seconds": {"": 2.5},
        "exporter_events_deleted_early_total": {"r": 3},
        "exporter_logins_rejected_total": {"": 4},
        "exporter_recording_messages_dropped_total": {"": 5},
        "exporter_discovery_last_run_timestamp_seconds": {"0": 3.5},
        "exporter_decode_seconds_total": {"": 4.5},
        "exporter_ingest_seconds_total": {"": 5.5},
        "exporter_scrapes_total": {"": 0},
        "exporter_last_scrape_duration_seconds": {"": 6.5},
        "exporter_domain_up": {"0": 1},
        "exporter_domain_error_info": {"1 why": 1},
        "exporter_loop_last_turn_timestamp_seconds": {"tick": 0},
        "exporter_loop_errors_total": {"tick": 0},
        "exporter_alertmanager_up": {"": 1},
        "exporter_query_rows": {"Host/node skipped": 3, "Host/node used": 2},
        "exporter_query_successful": {"Host/node": 1, "Host/down": 0},
        "canary_start_timestamp_seconds": {"": WALL + 1},
        "shard_robots": {" site 4 hall fresh": 7.5},
        "week_faults": {"": 3},
        "week_acknowledged_faults": {"": 2},
        "week_acknowledge_seconds": {"0.5": 60, "1": 90},
        "week_recovered_faults": {"": 1},
        "week_recover_seconds": {"0.5": 5, "1": 5},
        "week_notifications": {"": 7},
        "week_night_notifications": {"2026-01-01": 4},
        "week_faulty_seconds": {"/Motor/Motor 1 r": 30},
        "week_faulty_times": {"/Motor/Motor 1 r": 2},
    }
