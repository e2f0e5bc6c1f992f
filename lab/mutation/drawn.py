"""What mistakes can be planted in, by name, and the unit tests that are to find them."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

PACKAGES = ("api", "config", "decode", "faults", "fleet", "metrics", "robots", "storage", "web")


class Drawn(NamedTuple):
    """A folder of the checkout with code, the files or folders of its tests, and its ``files``."""

    source: Path
    tests: tuple[str, ...]
    files: str = "**/*.py"


# What is no package of the exporter: its modules beside these, and what tests rest on. Of the
# sources much is seen on a real middleware only, by the quick ones of the tests there.
OTHERS = {
    "sources": Drawn(
        Path("exporter/ros_diagnostics_exporter/sources"),
        (
            *("tests/unit/sources", "tests/unit/service/test_joining_anew.py"),
            *("tests/unit/fleet/test_graph.py", "tests/unit/fleet/test_missions.py"),
            *("tests/unit/fleet/test_topics.py", "tests/integration/sources/test_listener.py"),
            *("tests/unit/decode/test_cdr.py", "tests/unit/tools/backtest/test_measured.py"),
            *("tests/integration/sources/test_odd_names.py",),
            *("tests/integration/sources/test_zenoh.py",),
        ),
    ),
    "ros_diagnostics_exporter": Drawn(
        Path("exporter/ros_diagnostics_exporter"),
        (
            *("tests/unit/service", "tests/unit/cli", "tests/unit/test_loops.py"),
            *("tests/unit/test_http_client.py", "tests/unit/test_durations.py"),
            *("tests/unit/test_extras.py", "tests/unit/test_mission_numbers.py"),
            *("tests/unit/test_weekly.py", "tests/unit/web/test_pages.py"),
            *("tests/unit/config/test_reloading.py", "tests/unit/recordings/test_recordings.py"),
            "tests/unit/rules/test_states.py::test_the_ranks_of_states_are_those_of_the_rules",
        ),
        "*.py",
    ),
    "simulation": Drawn(
        Path("lab/simulation"),
        ("tests/unit/simulation", "tests/unit/faults/test_invariants.py"),
    ),
    "tools": Drawn(
        Path("tools"),
        (
            *("tests/unit/config/test_reference.py", "tests/unit/config/test_schema.py"),
            *("tests/unit/docs/test_readability.py", "tests/unit/docs/test_pages.py"),
            *("tests/unit/metrics/test_metrics_reference.py", "tests/unit/test_call_traces.py"),
            *("tests/unit/rules/test_prometheus_operator.py", "tests/unit/test_generate.py"),
            *("tests/unit/rules/test_mail_pictures.py", "tests/unit/grafana/test_grafana_com.py"),
            *("tests/unit/docs/test_site.py",),
        ),
    ),
}


def drawn(name: str) -> Drawn:
    """What a name is of: a package of the exporter has its tests in the folder of that name."""
    of_exporter = Drawn(Path("exporter/ros_diagnostics_exporter", name), (f"tests/unit/{name}",))
    return OTHERS.get(name, of_exporter)
