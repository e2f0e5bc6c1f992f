"""What a message and a scrape cost in calls and files does not grow unnoticed."""

import sys

import pytest

import call_traces

MORE = sys.version_info < (3, 11)  # with Python 3.10 a restart has one call more

# Calls and files at most: as it is today. Lower them with the code; raise them with a reason only.
LIMITS = {
    "unchanged": (20, 8),
    # One rule asks of every edge what six mechanisms asked of their own. When something is next due
    # is asked once, so that no message has to. The model says what is critical.
    "breaking": (136, 21),
    # Why a component is suppressed depends on others: asked at each scrape. What the network shows
    # of a robot is in a file of its own, and how urgent it is by levels and faults, which no rule
    # computes.
    "scrape": (302, 26),
    # What an object has first is a call for each attribute that is marked, each field of a row is
    # written by a call, and the topics are listed that entries of fleet.yml take.
    "restart": (854 + MORE, 75),
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
