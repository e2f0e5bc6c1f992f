from typing import get_args, get_type_hints

import pytest
import schemathesis
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from schemathesis import GenerationMode

from ros_diagnostics_exporter.events import Event, EventLog
from ros_diagnostics_exporter.faults.model import Change, Reason, Scope, State
from ros_diagnostics_exporter.mission_numbers import work_of
from ros_diagnostics_exporter.notifications import parse
from ros_diagnostics_exporter.robots.rejections import SilentReason
from ros_diagnostics_exporter.severity import SILENT as SILENT_WORDS
from ros_diagnostics_exporter.severity import SUPPRESSED
from ros_diagnostics_exporter.web.app import openapi
from ros_diagnostics_exporter.web.server import Server
from support.web_server import (
    FakeBackend,
    ask,
    broken,
    component,
    downtime,
    fleet,
    occurrence,
    problem,
    robot,
)

LOG = EventLog()
LOG.record(Event(1.0, "level", "a", "/Motor", "Motor 1", "OK", "ERROR", "hot"))
LOG.record(Event(2.0, "config"))
SILENT = {"up": False, "silent_reason": "never_seen", "last_message": None, "topic": None}

OF_PROBLEMS = {"due", "suppressed", "suppressed_by", "healthy"}
PART = dict.fromkeys(("group", "component", "key", "check", "robot"), "")


def _targets(job: str, port: int | None) -> list[dict]:
    if job == "ping" and port is not None:
        raise ValueError("a ping has no port")
    if job not in {"node", "ping", "ssh", "http", "tcp"}:
        raise LookupError(f"no job {job}")
    return [{"targets": ["10.0.0.1"], "labels": {"robot": "a"}}]


def _capabilities(robot: str | None) -> dict:
    need = {
        "k": None,
        "of": [
            {"part": {**PART, "state": "lost", "maintenance": True}},
            {"capability": "view"},
            {"missing": True},
            {"k": 2, "of": [{"missing": True}], "degraded": "lost"},
        ],
        "degraded": "degraded",
    }
    found = {"capability": "drive", "state": "no_reserve", "needed": None, "need": need}
    return {"fleet": "hall", "robot": robot, "time": 1.0, "capabilities": [found]}


def _missions(robot: str | None) -> dict:
    results = {"succeeded": 3, "aborted": 1, "cancelled": 0, "preempted": 0, "unknown": 0}
    action = {"action": "dock", "mission": True, "reached": True, "running": 1, "longest": 2.5}
    autonomy = {"autonomous": None, "autonomous_seconds": 60.0, "interventions": 2}
    judged = {"level": "ERROR", "message": "aborted 1 of the last 4 goals"}
    actions = [{**action, **judged, "results": results}]
    counted = {"actions": actions, **autonomy}
    numbers = work_of(counted).as_json()
    robots = [{"robot": robot or "a", "since": None, "numbers": numbers, **counted}]
    return {"fleet": "hall", "time": 1.0, "robots": robots}


@pytest.fixture(scope="module")
def server():
    backend = FakeBackend(
        fleet_snapshot=lambda: fleet(
            robot(
                "a",
                component("Motor 1", "STALE"),
                component("Cam 1", "OK"),
                problems=[broken(), broken(confirmed=None, suppressed="maintenance")],
                maintenance=True,
                maintenance_until=2_000.0,
                downtimes=[downtime("Cam 1")],
                capabilities=[
                    {
                        "capability": "driving",
                        "state": "lost",
                        "parts": [
                            PART | {"group": "/Motor", "component": "Motor 1", "state": "lost"},
                            PART | {"check": "c", "state": "lost"},
                        ],
                    }
                ],
                short_checks=[{"check": "c", "patterns": ["x"], "found": 1, "expected": 2}],
            ),
            robot("b", **SILENT, problems=[problem("robot", "pending")]),
            problems=[problem("site", "silent", site="hall")],
        ),
        faults=lambda: {
            "fleet": "hall",
            "time": 1.0,
            "faults": [
                {
                    **{key: broken()[key] for key in broken() if key not in OF_PROBLEMS},
                    "fault": "0123456789ab",
                    "labels": {"site": "hall"},
                }
            ],
        },
        capabilities=_capabilities,
        missions=_missions,
        fault_history=lambda fault: {
            "fault": fault,
            "time": 1.0,
            "events_since": None,
            "occurrences": [] if "0" in fault else [occurrence("component", "critical")],
        },
        find_events=LOG.find,
        notified=lambda body: (len(parse(body).alerts), 0),
        targets=_targets,
    )
    server = Server(backend, listen=["127.0.0.1:0"], lifecycle=True)
    server.start()
    yield server
    server.stop()


OPERATIONS = [
    found.ok() for found in schemathesis.openapi.from_dict(openapi("/metrics")).get_all_operations()
]


@pytest.mark.parametrize("operation", OPERATIONS, ids=lambda each: each.label)
def test_the_server_conforms_to_its_description(operation, server):
    """Requests, valid and invalid, are generated from the description."""
    valid_and_invalid = st.one_of(
        operation.as_strategy(generation_mode=mode) for mode in GenerationMode
    )

    @given(case=valid_and_invalid)
    @settings(max_examples=20, deadline=None, suppress_health_check=list(HealthCheck))
    def check(case):
        # OpenAPI cannot say that two parameters are not to be combined.
        assume(not {"collect[]", "exclude[]"} <= set(case.query or {}))
        case.call_and_validate(base_url=f"http://{server.addresses[0]}")

    check()


def test_people_can_read_the_description_that_is_served(server):
    answer = ask(server, "/api/v1/openapi.json")

    assert answer.json == openapi("/metrics")
    assert "\n  " in answer.text


def test_the_description_follows_the_telemetry_path():
    assert "/m" in openapi("/m")["paths"]
    assert "/metrics" not in openapi("/m")["paths"]
    assert openapi("/")["paths"]["/"]["get"]["operationId"] == "metrics"


def test_the_description_and_the_words_have_every_reason_scope_and_state():
    schemas = openapi("/metrics")["components"]["schemas"]
    event = schemas["Event"]["properties"]
    suppressed = schemas["Problem"]["allOf"][1]["properties"]["suppressed"]["enum"]
    for each in (schemas["Identity"]["properties"], event):
        assert set(each["scope"]["enum"]) == {scope.value for scope in Scope}
        assert set(each["state"]["enum"]) == {state.value for state in State}
    assert {*event["reason"]["enum"], "began"} == set(get_args(get_type_hints(Change)["what"]))
    assert {each.value for each in Reason} <= set(suppressed) - {None} == set(SUPPRESSED)
    assert set(get_args(SilentReason)) == set(SILENT_WORDS)
