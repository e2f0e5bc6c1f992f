"""The packages keep their order: who imports whom, who knows ROS and the clock.

docs/architecture.md says why. A new module gets a line in LAYERS, at its place.
"""

import ast
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from statistics import median

import pytest

CHECKOUT = Path(__file__).parents[2]
EXPORTER = "ros_diagnostics_exporter"
TOOLS = "ros_diagnostics_tools"
TREES = {
    EXPORTER: CHECKOUT / "exporter",
    TOOLS: CHECKOUT / "exporter",
    "virtual_robots": CHECKOUT / "sim",
    "testbed": CHECKOUT / "sim",
    "demo": CHECKOUT / "sim",
    "fleet_dashboards": CHECKOUT / "grafana",
}
# Of each tree its packages and modules: each imports only from lines above its own.
LAYERS: dict[str, tuple[tuple[str, ...], ...]] = {
    EXPORTER: (
        ("model", "durations", "extras", "files", "regex", "texts", "weekly", "zstd"),
        ("events", "fleet_texts", "http_client", "logs", "loops", "rejected_logins"),
        ("severity",),
        ("event_texts", "mission_numbers", "silences"),
        ("config",),
        ("decode",),
        ("sources",),
        ("robots",),
        ("alertmanager", "faults"),
        ("acknowledging", "firing"),
        ("notifications",),
        ("canary",),
        ("fleet",),
        ("other_exporters", "recordings", "storage"),
        ("metrics",),
        ("comparing", "forgetting", "self_check"),
        ("joining",),
        ("api",),
        ("web",),
        ("service",),
        ("cli",),
    ),
    TOOLS: (
        (
            "capability_losses",
            "capability_notes",
            "errors",
            "limits",
            "terminal",
            "aborted",
            "flag_types",
            "yaml_nodes",
        ),
        ("times", "week_sentences"),
        ("names", "servers"),
        ("autoware", "backtest", "mail_relay", "nagios", "oncall", "report"),
        ("asked_recordings",),
        ("ask",),
        ("mail_server",),
        ("check_nagios", "commands"),
        ("main",),
    ),
    "virtual_robots": (
        ("model",),
        ("schema",),
        ("aggregator",),
        ("simulation",),
        ("recording",),
        ("ros",),
        ("terminal",),
        ("commands", "recording_commands"),
        ("cli",),
    ),
    "testbed": (
        ("http", "locks", "mail", "polling", "short_clocks"),
        ("configuration", "engine"),
        ("domains", "grafana", "ports", "processes", "programs"),
        ("zenoh",),
        ("servers",),
        ("site",),
        ("stack",),
    ),
    "demo": (("liveness", "snapshot", "steps"), ("screen",), ("run",), ("__main__",)),
    "fleet_dashboards": (("lib",), ("dashboards",), ("files",)),
}
# Trees that import another: the demo stands on the testbed, the tools use the exporter's packages.
# All others meet as users do, and the exporter imports none of them.
MAY_KNOW = {"demo": {"testbed"}, TOOLS: {EXPORTER}}
# The others of the exporter's packages are its process: the tools reach that by HTTP.
TOOLS_DO_NOT_KNOW = {"canary", "logs", "notifications", "web", "service", "cli"}
# What the web shows it is given by its Backend; of the config it knows how YAML is read.
WEB_KNOWS = {
    *("web", "model", "durations", "event_texts", "events", "files", "loops", "severity", "texts"),
    *("fleet_texts", "mission_numbers", "rejected_logins"),
}
WEB_READS_BY = f"{EXPORTER}.config.yaml_file"
KNOW_ROS = {
    f"{EXPORTER}.sources.dds",
    f"{EXPORTER}.sources.dds_endpoints",
    f"{EXPORTER}.sources.dds_fields",
    f"{EXPORTER}.sources.dds_names",
    f"{EXPORTER}.sources.dds_second",
    f"{EXPORTER}.sources.dds_subscription",
    f"{EXPORTER}.sources.dds_types",
    f"{EXPORTER}.sources.dds_watch",
    "virtual_robots.ros.actions",
    "virtual_robots.ros.borrowed",
    "virtual_robots.ros.contexts",
    "virtual_robots.ros.transport",
    "virtual_robots.ros.control",
    "virtual_robots.ros.bags",
}
ROS_PACKAGES = {"rclpy", "rcl_interfaces", "diagnostic_msgs", "builtin_interfaces", "std_msgs"}
NO_CLOCK = {
    EXPORTER: {"model", "config", "robots", "fleet", "faults", "api", "canary", "notifications"},
    TOOLS: {"autoware", "backtest", "nagios", "oncall", "report"},
}
READS_CLOCK = {f"{EXPORTER}.config.reloader", f"{EXPORTER}.storage.storage"}
CLOCKS = {"time.time", "time.monotonic", "time.perf_counter", "datetime.now", "datetime.utcnow"}

FILES = sorted(
    (f"{package}.{'.'.join(path.relative_to(root / package).with_suffix('').parts)}", path)
    for package, root in TREES.items()
    for path in (root / package).rglob("*.py")
)


@cache
def nodes(path: Path) -> list[ast.AST]:
    """All of a file's syntax, its module first."""
    return list(ast.walk(ast.parse(path.read_text())))


def imports(path: Path) -> Iterator[str]:
    """Yield every module that the file imports, wherever in the file."""
    for node in nodes(path):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def layer(module: str) -> tuple[str, int] | None:
    """Return a module's part of its tree, and that part's layer; None where the tree has none."""
    tree, _, rest = module.partition(".")
    name = rest.partition(".")[0]
    for number, names in enumerate(LAYERS.get(tree, ())):
        if name in names:
            return name, number
    return None


def test_every_module_has_its_place():
    homeless = [
        module
        for module, _ in FILES
        if LAYERS[module.partition(".")[0]]
        and layer(module) is None
        and not module.endswith("__init__")
    ]

    assert not homeless, "give it a line in LAYERS, below all that it imports"


@pytest.mark.parametrize(("module", "path"), FILES, ids=[module for module, _ in FILES])
def test_a_module_imports_only_from_layers_above_its_own(module, path):
    here, tree = layer(module), module.partition(".")[0]
    for imported in imports(path):
        there = layer(imported) if imported.partition(".")[0] == tree else None
        if here and there and here[0] != there[0]:
            assert there[1] < here[1], f"{here[0]} imports {there[0]}"
        if tree == EXPORTER and here and here[0] == "web" and there:
            assert there[0] in WEB_KNOWS or imported.startswith(WEB_READS_BY), imported


def test_exporter_robots_and_demo_do_not_import_one_another():
    """They meet as users do: at a ROS message, a command line, an HTTP answer."""
    for module, path in FILES:
        tree = module.split(".")[0]
        others = TREES.keys() - {tree} - MAY_KNOW.get(tree, set())
        assert not others & {name.split(".")[0] for name in imports(path)}, module


def test_tools_know_the_exporters_pure_packages_only():
    for module, path in FILES:
        for imported in imports(path) if module.startswith(TOOLS) else ():
            there = layer(imported) if imported.startswith(EXPORTER) else None
            assert there is None or there[0] not in TOOLS_DO_NOT_KNOW, f"{module}: {imported}"


def test_only_the_files_at_the_edge_know_ros():
    know = {
        module for module, path in FILES if ROS_PACKAGES & {n.split(".")[0] for n in imports(path)}
    }

    assert know == KNOW_ROS


def test_now_is_an_argument_except_at_the_edge():
    """What these do depends on what they are given only, so a test can play any history."""
    for module, path in FILES:
        place, pure = layer(module), NO_CLOCK.get(module.partition(".")[0], set())
        if place is None or place[0] not in pure or module in READS_CLOCK:
            continue
        asked = {
            f"{node.value.id}.{node.attr}"
            for node in nodes(path)
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name)
        }
        assert not CLOCKS & (asked | set(imports(path))), module


def test_a_reader_can_hold_a_function_in_the_head():
    sizes = sorted(
        node.end_lineno - node.lineno + 1
        for _, path in FILES
        for node in nodes(path)
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
    )

    assert median(sizes) <= 10
    assert sizes[len(sizes) * 9 // 10] < 35
    assert sizes[-1] <= 70


def test_no_file_of_the_service_is_too_long_to_be_one_idea():
    lines = {
        module: len(path.read_text().splitlines())
        for module, path in FILES
        if module.startswith(f"{EXPORTER}.")
    }

    assert {module: number for module, number in lines.items() if number > 500} == {}


@pytest.mark.parametrize("tree", [EXPORTER, TOOLS])
def test_no_two_classes_have_one_name(tree):
    counted = Counter(
        node.name
        for module, path in FILES
        if module.startswith(f"{tree}.")
        for node in nodes(path)
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_")
    )

    assert {name for name, count in counted.items() if count > 1} == set()
