"""The house keeps its order: who imports whom, who knows ROS and the clock.

docs/architecture.md says why. A new file of the exporter gets a line in ROOMS, at its place.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path
from statistics import median

import pytest

CHECKOUT = Path(__file__).parents[2]
EXPORTER = "ros_diagnostics_exporter"
TREES = {
    EXPORTER: CHECKOUT / "exporter",
    "virtual_robots": CHECKOUT / "sim",
    "fleet_demo": CHECKOUT / "sim",
}
ROOMS = (  # each imports only from above; files side by side in a tuple do not know each other
    ("diagnostics", "units", "files", "metrics", "ranks", "texts", "systemd"),
    ("client", "acknowledgement", "logs"),
    ("config", "tree", "values", "flags", "metrics_reference", "events", "topic_queue"),
    ("faults",),
    ("ros", "state", "nagios", "status", "ack"),
    ("storage", "sample_text", "snapshot", "own_metrics", "watching", "alertmanager"),
    ("exposition", "web", "reloading"),
    ("service",),
    ("cli",),
)
# What the web shows it is handed, as callables; of the config it knows how YAML is read.
WEB_KNOWS = {"web", "diagnostics", "events", "ranks", "texts"}
WEB_READS_BY = f"{EXPORTER}.config.yamlfile"
KNOW_ROS = {
    f"{EXPORTER}.ros",
    "virtual_robots.ros",
    "virtual_robots.transport",
    "virtual_robots.control",
    "virtual_robots.bags_ros",
}
ROS_PACKAGES = {"rclpy", "rcl_interfaces", "diagnostic_msgs", "builtin_interfaces", "std_msgs"}
NO_CLOCK = {"diagnostics", "config", "tree", "values", "units", "state", "faults", "storage"}
NO_CLOCK |= {"exposition"}
CLOCKS = {"time.time", "time.monotonic", "time.perf_counter", "datetime.now", "datetime.utcnow"}

FILES = sorted(
    (f"{package}.{'.'.join(path.relative_to(root / package).with_suffix('').parts)}", path)
    for package, root in TREES.items()
    for path in (root / package).rglob("*.py")
)


def imports(path: Path) -> Iterator[str]:
    """Yield every module that the file imports, wherever in the file."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def room(module: str) -> str | None:
    """Return the exporter's room that a module belongs to; None for its version and for others."""
    parts = module.split(".")
    known = {name for side_by_side in ROOMS for name in side_by_side}
    return parts[1] if parts[0] == EXPORTER and len(parts) > 1 and parts[1] in known else None


def storey(name: str) -> int:
    return next(number for number, names in enumerate(ROOMS) if name in names)


def test_every_file_of_the_exporter_has_its_place():
    homeless = [
        module
        for module, _ in FILES
        if module.startswith(EXPORTER) and room(module) is None and not module.endswith("__init__")
    ]

    assert not homeless, "give it a line in ROOMS, above all that import it"


@pytest.mark.parametrize(("module", "path"), FILES, ids=[module for module, _ in FILES])
def test_a_file_imports_only_from_rooms_above_its_own(module, path):
    here = room(module)
    for imported in imports(path):
        there = room(imported)
        if here and there and here != there:
            assert storey(there) < storey(here), f"{here} imports {there}"
        if here == "web" and there:
            assert there in WEB_KNOWS or imported.startswith(WEB_READS_BY)


def test_exporter_robots_and_demo_know_nothing_of_each_other():
    """They meet as users do: at a ROS message, a command line, an HTTP answer."""
    for module, path in FILES:
        others = TREES.keys() - {module.split(".")[0]}
        assert not others & {name.split(".")[0] for name in imports(path)}, module


def test_only_the_files_at_the_edge_know_ros():
    know = {
        module for module, path in FILES if ROS_PACKAGES & {n.split(".")[0] for n in imports(path)}
    }

    assert know == KNOW_ROS


def test_the_inner_rooms_are_told_the_time():
    """What they do depends on what they are given only; so a test can tell them any story."""
    for module, path in FILES:
        if room(module) not in NO_CLOCK:
            continue
        asked = {
            f"{node.value.id}.{node.attr}"
            for node in ast.walk(ast.parse(path.read_text()))
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name)
        }
        assert not CLOCKS & (asked | set(imports(path))), module


def test_a_reader_can_hold_a_function_in_the_head():
    sizes = sorted(
        node.end_lineno - node.lineno + 1
        for _, path in FILES
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
    )

    assert median(sizes) <= 10
    assert sizes[len(sizes) * 9 // 10] < 35
    assert sizes[-1] <= 70


def test_every_file_says_what_it_is_for():
    silent = [
        module for module, path in FILES if not ast.get_docstring(ast.parse(path.read_text()))
    ]

    assert not silent
