"""What a message and a scrape cost in calls and files does not grow unnoticed."""

import sys
from types import SimpleNamespace

import pytest

import call_traces
from support.loopback import replying
from virtual_robots.model import Status
from virtual_robots.recording.cdr import encode_array

MORE = sys.version_info < (3, 11)  # with Python 3.10 a restart has one call more

# Calls and files at most: as it is today. Lower them with the code; raise them with a reason only.
LIMITS = {
    "unchanged": (20, 8),
    # One rule asks of every edge what six mechanisms asked of their own. When something is next due
    # is asked once, so that no message has to. The model says what is critical.
    "breaking": (137, 21),
    # Why a component is suppressed depends on others: asked at each scrape. What the network shows
    # of a robot is in a file of its own, and how urgent it is by levels and faults, which no rule
    # computes.
    "scrape": (302, 26),
    # What an object has first is a call for each attribute that is marked, each field of a row is
    # written by a call, and the topics are listed that entries of fleet.yml take.
    "restart": (861 + MORE, 75),
}

# What a fleet that configures none of it pays nothing for.
UNUSED = {
    "capabilities": ("faults/capabilities.py", "faults/needs.py", "fleet/capabilities.py"),
    "conditions": ("robots/conditions.py", "fleet/conditional_problems.py"),
    "depends_on": ("fleet/dependencies.py",),
    "topics": ("sources/topic_entries.py", "sources/topic_fields.py", "decode/messages.py"),
    "actions": ("robots/missions.py", "robots/goals.py", "fleet/missions.py", "decode/goals.py"),
    "modes": ("robots/autonomy.py",),
    "downtimes": ("robots/maintenance.py",),
}


@pytest.fixture(scope="module")
def traces():
    return call_traces.traces()


@pytest.mark.parametrize("name", LIMITS)
def test_no_path_grows(traces, name):
    calls, files = LIMITS[name]

    assert sum(traces[name].values()) <= calls, traces[name]
    assert len(traces[name]) <= files, traces[name]


def test_the_traces_are_of_what_they_say(traces):
    """Else one that ends early would be within all limits."""
    assert "robots/tree.py" in traces["unchanged"]
    assert "faults/engine.py" not in traces["unchanged"]
    assert "faults/engine.py" in traces["breaking"]
    assert {"web/connections.py", "metrics/exposition.py"} <= traces["scrape"].keys()
    assert {"storage/storage.py", "faults/rows.py"} <= traces["restart"].keys()


@pytest.mark.parametrize("feature", UNUSED)
@pytest.mark.parametrize("name", ["unchanged", "breaking", "scrape"])
def test_what_is_not_configured_costs_no_call(traces, name, feature):
    assert all((call_traces.PACKAGE / file).exists() for file in UNUSED[feature])

    assert not traces[name].keys() & set(UNUSED[feature])


def test_a_function_of_the_package_is_one_call_however_often_it_goes_on():
    def frame(file: str, function: str, folder: object = call_traces.PACKAGE) -> SimpleNamespace:
        code = SimpleNamespace(co_filename=f"{folder}/{file}", co_name=function)
        return SimpleNamespace(f_code=code, f_back=None)

    tracer = call_traces.Tracer()
    turn, of_server = frame("loops.py", "turn"), frame("loops.py", "turn")
    of_server.f_back = frame("server.py", "tick", "uvicorn")
    others = frame("loops.py", "<listcomp>"), frame("loops.py", "turn", "/elsewhere"), of_server
    tracer.note(turn, "call", None)
    with tracer.tracing(this_thread=False) as calls:
        for each in others:
            tracer.note(each, "call", None)
        tracer.note(turn, "return", None)
        assert calls == {}
        for _ in range(2):
            tracer.note(turn, "call", None)
        for name in "turn", "<lambda>":
            tracer.note(frame("loops.py", name), "call", None)
        tracer.note(frame("web/server.py", "start"), "call", None)
    tracer.note(frame("loops.py", "turn"), "call", None)
    assert calls == {"loops.py": 3, "web/server.py": 1}


@pytest.mark.parametrize("level", [call_traces.OK, call_traces.ERROR])
def test_of_the_components_of_a_message_the_last_one_is_broken(level):
    words = {call_traces.OK: ("OK", "40"), call_traces.ERROR: ("overheated", "90")}
    rows = [("/Drives", level), ("/Drives/Motor 1", call_traces.OK), ("/Drives/Motor 2", level)]
    sent = [
        Status(of, name, words[of][0], "", (("Temperature (C)", words[of][1]),))
        for name, of in rows
    ]
    assert call_traces._message(level) == encode_array(sent, 0.0, "")


@pytest.mark.parametrize("status", [200, 201, 503])
def test_a_scrape_that_is_not_answered_is_no_trace(status):
    with replying(lambda _request: (status, b"")) as address:
        server = SimpleNamespace(addresses=[address], connections=())
        if status == 200:
            call_traces._scrape(server)
            return
        with pytest.raises(RuntimeError, match=f"the scrape was answered {status}"):
            call_traces._scrape(server)
