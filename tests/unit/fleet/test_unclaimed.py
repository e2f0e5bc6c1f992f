"""Topics of diagnostics that no entry of fleet.yml takes."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from ros_diagnostics_exporter.api.snapshot import fleet_snapshot
from ros_diagnostics_exporter.config.fleet import Fleet
from ros_diagnostics_exporter.config.load import load
from ros_diagnostics_exporter.fleet.unclaimed import MOST, Claims, find_unclaimed
from ros_diagnostics_exporter.model import ZENOH, Domain, Endpoint, Topic
from ros_diagnostics_exporter.web.pages import landing
from ros_diagnostics_tools.commands import status
from ros_diagnostics_tools.main import main
from support.state_driver import StateDriver
from support.web_server import serve as serve  # noqa: PLC0414 - a fixture
from testbed.configuration import CHECKOUT

SHIPPED = CHECKOUT / "packaging" / "debian" / "fleet.yml"


def publishing(driver: StateDriver, *topics: str, domain: Domain = 0) -> None:
    found = dict.fromkeys(topics, Endpoint(1))
    driver.state.update_graph(domain, found, driver.now)


def unclaimed(driver: StateDriver) -> list[tuple[Domain, tuple[str, ...], str]]:
    return [tuple(each) for each in driver.state.unclaimed]


@pytest.fixture
def shipped() -> StateDriver:
    return StateDriver(fleet=load(SHIPPED))


def test_a_robot_in_the_root_namespace_is_named_at_once_with_the_entry_to_paste(shipped, caplog):
    publishing(shipped, "/diagnostics", "/diagnostics_agg", "/robot_1/x")
    assert unclaimed(shipped) == [
        (0, ("/diagnostics", "/diagnostics_agg"), "{name: robot, domain_id: 0}"),
        (0, ("/robot_1/x",), "{name: robot_1, domain_id: 0, topic: /robot_1/x}"),
    ]
    publishing(shipped, "/diagnostics", "/diagnostics_agg", "/robot_1/x")
    add = "in domain 0; to monitor it, add to robots: -"
    assert [each.getMessage().partition("matches ")[2] for each in caplog.records] == [
        f"/diagnostics and /diagnostics_agg {add} {{name: robot, domain_id: 0}}",
        f"/robot_1/x {add} {{name: robot_1, domain_id: 0, topic: /robot_1/x}}",
    ]
    publishing(shipped)
    assert unclaimed(shipped) == []


def test_a_robot_without_the_aggregator_that_discovery_looks_for_is_named(shipped):
    publishing(shipped, "/amr9/diagnostics")
    entry = "{name: amr9, domain_id: 0, namespace: /amr9}"
    assert unclaimed(shipped) == [(0, ("/amr9/diagnostics",), entry)]
    publishing(shipped, "/amr9/diagnostics", "/amr9/diagnostics_agg")  # it is found by that
    assert unclaimed(shipped) == []


def test_page_status_api_and_a_check_against_the_running_exporter_name_it(
    shipped, serve, capsys, tmp_path: Path
):
    publishing(shipped, "/diagnostics")
    line = "/diagnostics in domain 0; to monitor it, add to robots: - {name: robot, domain_id: 0}"
    fleet = json.loads(json.dumps(fleet_snapshot(shipped.state, shipped.now)))
    assert [each["topics"] for each in fleet["unclaimed"]] == [["/diagnostics"]]
    page = landing(fleet, "/metrics")
    assert line in page
    assert "Topics that no entry of fleet.yml matches: 1" in page
    shown = status.choose(fleet, None, "*", None)
    assert any(line in str(each) for each in status.view(shown).renderables)

    server = serve(fleet_snapshot=lambda: fleet)
    check = ["check-config", "--live", f"--url=http://{server.addresses[0]}"]
    assert main([*check, str(SHIPPED)]) == 0
    assert f"topics that no entry matches (1):\n  {line}" in capsys.readouterr().out
    declared = tmp_path / "fleet.yml"
    declared.write_text("fleet: f\nrobots: [{name: robot, domain_id: 0}]\n")
    assert main([*check, str(declared)]) == 0
    assert "topics that no entry matches" not in capsys.readouterr().out


CONFIG = """
fleet: f
robots:
  - {name: a, namespace: /a, source: raw}
  - {name: q, source: queries}
  - {name: z, zenoh: site/z}
shared: [{topic: /shared/diagnostics}]
discovery: [{topic: "/{robot}/diagnostics_agg", include: ["r*"], exclude: ["r_test*"], source: agg}]
zenoh: {routers: [tcp/centre:7447]}
"""


@pytest.mark.parametrize(
    ("topic", "is_taken"),
    [
        *[(f"/{each}/diagnostics", True) for each in ("a", "shared", "r_test", "site/z")],
        *[(f"/{each}/diagnostics_agg", True) for each in ("a", "shared", "r1", "r_test", "site/z")],
        *[(f"/{each}", False) for each in ("x/diagnostics", "r1/diagnostics", "a/b/diagnostics")],
        ("/a/health", False),
    ],
)
def test_what_an_entry_takes_or_excludes_or_has_beside_it_is_not_named(tmp_path, topic, is_taken):
    (tmp_path / "fleet.yml").write_text(CONFIG)
    domain: Domain = ZENOH if topic.startswith("/site") else 0
    assert Claims(load(tmp_path / "fleet.yml")).takes(Topic(domain, topic)) is is_taken
    assert not Claims(load(tmp_path / "fleet.yml")).takes(Topic(5, topic))


def test_a_reload_and_a_domain_that_is_left_apply_at_once(tmp_path):
    (tmp_path / "fleet.yml").write_text(
        "fleet: f\ndiscovery: [{type: diagnostic_msgs/msg/DiagnosticArray, domain_ids: [0, 1]}]\n"
    )
    fleet = load(tmp_path / "fleet.yml")
    driver = StateDriver(fleet=fleet)
    publishing(driver, "/diagnostics")
    publishing(driver, "/diagnostics", domain=1)
    assert [each.entry for each in driver.state.unclaimed] == [
        "{name: robot, domain_id: 0}",
        "{name: robot_1, domain_id: 1}",
    ]
    (tmp_path / "fleet.yml").write_text("fleet: f\nrobots: [{name: r}]\n")
    driver.configure(load(tmp_path / "fleet.yml"))
    assert unclaimed(driver) == []


def test_robots_that_a_limit_rejects_are_not_named_as_nobodys(shipped):
    shipped.configure(limits=replace(shipped.state.fleet.limits, robots=1))
    publishing(shipped, "/r1/diagnostics_agg", "/r2/diagnostics_agg")
    assert unclaimed(shipped) == []


def test_what_is_listed_and_logged_is_bounded(shipped, caplog):
    for start in range(0, 1000, 200):
        publishing(shipped, *(f"/x/t{number}" for number in range(start, start + 200)))
    assert len(unclaimed(shipped)) == MOST
    assert len(caplog.records) == MOST


NAMES = st.from_regex(r"[a-z][a-z0-9_]{0,8}", fullmatch=True)
TOPICS = st.lists(NAMES, min_size=1, max_size=3).map(lambda parts: "/" + "/".join(parts))


@settings(max_examples=100, deadline=None)
@given(
    topic=TOPICS | TOPICS.map(lambda name: f"{name}/diagnostics") | st.just("/diagnostics_agg"),
    domain=st.sampled_from([0, 7, ZENOH]),
)
def test_the_entry_takes_the_topic(tmp_path_factory, topic, domain):
    nobody = Claims(Fleet("f"))
    (found,) = find_unclaimed(nobody, [Topic(domain, topic)])
    path = tmp_path_factory.mktemp("fleet") / "fleet.yml"
    zenoh = "zenoh: {routers: [tcp/centre:7447]}\n" if domain == ZENOH else ""
    path.write_text(f"fleet: f\n{zenoh}robots:\n  - {found.entry}\n")
    assert len(yaml.safe_load(path.read_text())["robots"]) == 1
    assert Claims(load(path)).takes(Topic(domain, topic))
