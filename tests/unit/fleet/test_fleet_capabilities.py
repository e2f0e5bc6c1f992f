"""What the fleet can do, from fleet.yml and robots to faults with one notification each."""

from datetime import datetime, timezone

import pytest

from ros_diagnostics_exporter.api.capabilities import capability_tree
from ros_diagnostics_exporter.api.snapshot import fleet_snapshot
from ros_diagnostics_exporter.config.load import load
from ros_diagnostics_exporter.faults.model import CapabilityState, PartName
from ros_diagnostics_exporter.faults.needs import AtLeast, NeedView, WantedCapability
from ros_diagnostics_exporter.fleet.capabilities import fleet_evidence
from ros_diagnostics_exporter.model import Status
from ros_diagnostics_exporter.web.pages import landing
from ros_diagnostics_tools.main import main
from support.configs import load_text
from support.state_driver import ERROR, OK, WALL, WARN, StateDriver
from support.web_server import serve as serve  # noqa: PLC0414 - a fixture

LEAST = "{k: 3, of: {can: lifting, robots: {site: hall}}}"
FLEET = """
fleet: f
profiles:
  default: {{stale_after: 5s}}
  amr: {{capabilities: {{lifting: Lift}}}}
capabilities: {{lifting at hall: {{at_least: {least}}}}}
robots:
{robots}
{more}
"""
IN_HALL = tuple(f"r{number}" for number in range(1, 6))


def robots(names, site="hall", profile="amr"):
    return "\n".join(
        f"  - {{name: {name}, topic: /{name}/diagnostics, source: raw, profile: {profile}, "
        f"labels: {{site: {site}}}}}"
        for name in names
    )


class Hall(StateDriver):
    """Five robots that can lift, three of which are needed; one elsewhere, one without a lift."""

    def __init__(self, tmp_path, least=LEAST, more="", names=IN_HALL):
        text = FLEET.format(
            least=least,
            more=more,
            robots="\n".join(
                [robots(names), robots(["far"], "yard"), robots(["dog"], profile="default")]
            ),
        )
        super().__init__(fleet=load_text(tmp_path, text))
        self.path = tmp_path / "fleet.yml"
        self.levels = dict.fromkeys((*names, "far", "dog"), OK)

    def work(self, seconds, **levels):
        """Publish from now on: a level, None for nothing, of robots by name."""
        self.levels |= levels
        end = self.now.mono + seconds
        while self.now.mono < end:
            self.now = type(self.now)(self.now.mono + 1, self.now.wall + 1)
            for name, level in self.levels.items():
                if level is not None:
                    self.receive(f"/{name}/diagnostics", Status(level, "Lift"))
            self.state.tick(self.now)
        return self

    @property
    def changes(self):
        """What began and ended of the fleet."""
        return [
            f"{each.kind.removeprefix('fault_')} {each.reason} {each.state}".replace("  ", " ")
            for each in self.events
            if each.scope == "capability" and not each.robot
        ]


@pytest.fixture
def hall(tmp_path):
    return Hall(tmp_path).work(40)


def evidence(hall):
    return [
        each.evidence
        for each in hall.state.faults()
        if each.identity.scope == "capability" and not each.identity.robot
    ]


def test_before_too_few_can_the_fleet_has_no_reserve(hall):
    assert hall.work(30, r1=ERROR).changes == []
    assert hall.work(30, r2=ERROR).changes == ["began no_reserve"]
    assert evidence(hall) == ["3 of 5 robots can;\nr1 has lost lifting;\nr2 has lost lifting"]
    assert hall.work(30, r3=ERROR).changes[1:] == ["began lost"]
    hall.work(30, r1=OK)
    assert hall.changes[2:] == ["ended recovered lost"]  # no reserve goes on under it
    assert hall.work(30, r2=OK, r3=OK).changes[3:] == ["ended recovered no_reserve"]


def test_each_robot_has_its_own_fault_all_the_same(hall):
    hall.work(30, r1=ERROR, r2=ERROR)
    own = {each.identity.robot for each in hall.state.faults() if each.identity.robot}
    assert own == {"r1", "r2"}


def test_robots_elsewhere_and_those_that_have_no_such_capability_do_not_count(hall):
    assert hall.work(30, far=ERROR, dog=ERROR, r1=ERROR).changes == []
    (view,) = hall.state.needs(None).values()
    assert {each.robot for each in view.parts} == set(IN_HALL)


def test_a_warning_of_as_many_as_are_needed_degrades_it(hall):
    assert hall.work(30, **dict.fromkeys(IN_HALL[:3], WARN)).changes == ["began degraded"]
    hall.work(30, **dict.fromkeys(IN_HALL[:3], OK))
    assert hall.changes[1:] == ["ended recovered degraded"]


def test_of_silent_robots_it_is_not_known(hall):
    hall.work(60, r1=None, r2=None)
    assert hall.changes == ["began no_reserve"]  # three are known to be able to
    assert evidence(hall) == [
        "3 of 5 robots can;\nr1 may not have lifting;\nr2 may not have lifting"
    ]
    (view,) = hall.work(60, r3=None).state.needs(None).values()
    assert view.state.name == "UNKNOWN"
    assert hall.work(60, r4=None, r5=None).changes == ["began no_reserve"]
    assert hall.work(60, **dict.fromkeys(IN_HALL, OK)).changes[1:] == ["ended recovered no_reserve"]


def test_that_all_are_silent_begins_nothing(hall):
    assert hall.work(120, **dict.fromkeys(IN_HALL)).changes == []


def test_a_robot_whose_drivers_start_one_after_another_is_no_reserve_that_is_missing(tmp_path):
    hall = Hall(tmp_path).work(60, r1=None, r2=None)  # these two are switched on for the first time
    for _ in range(15):
        for name in ("r1", "r2"):
            hall.receive(f"/{name}/diagnostics", Status(OK, "Motor"))
        hall.work(1)
    assert hall.work(30, r1=OK, r2=OK).changes == []


MAINTENANCE = """
maintenance:
- {{name: m, comment: c, selector: {{robot: {robot}}}, start: "{start}", end: "{end}"}}
"""


def in_maintenance(robot, after, until):
    def at(second):
        return datetime.fromtimestamp(WALL + second, timezone.utc).isoformat()

    return MAINTENANCE.format(robot=robot, start=at(after), end=at(until))


def test_a_robot_in_maintenance_is_left_out(tmp_path):
    hall = Hall(tmp_path, more=in_maintenance("r2", 50, 500)).work(100, r2=OK)
    assert hall.changes == []
    assert hall.work(60, r2=ERROR).changes == []
    assert hall.work(60, r1=ERROR).changes == ["began no_reserve"]  # three are left that can
    assert evidence(hall) == ["3 of 5 robots can, 1 in maintenance;\nr1 has lost lifting"]


def test_maintenance_ends_nothing_and_what_is_well_after_it_ends_then(tmp_path):
    hall = Hall(tmp_path, more=in_maintenance("r2", 100, 200), names=IN_HALL[:4]).work(40)
    assert hall.work(50, r2=ERROR).changes == ["began no_reserve"]
    hall.work(60).work(30, r2=OK)
    assert hall.now.mono < 200
    assert hall.changes == ["began no_reserve"]
    assert hall.work(60).changes[1:] == ["ended recovered no_reserve"]


def test_a_restart_neither_ends_nor_repeats_it(hall, tmp_path):
    hall.work(60, r1=ERROR, r2=ERROR)
    again = Hall(tmp_path)
    again.levels = {**hall.levels, "r4": None}
    again.restore_faults(hall.fault_rows())
    assert again.work(200).changes == []
    assert again.work(60, r1=OK, r2=OK, r4=OK).changes == ["ended recovered no_reserve"]


@pytest.mark.parametrize("level", [OK, ERROR])
def test_what_is_no_fault_yet_begins_with_what_is_received_after_a_restart(hall, tmp_path, level):
    """Once it began with the start itself, for however long the exporter had been away."""
    rows = hall.work(7, r1=ERROR, r2=ERROR).fault_rows()
    again = Hall(tmp_path)
    again.now = type(hall.now)(0.0, hall.now.wall + 5)
    again.restore_faults(rows)
    assert again.changes == []
    begun = ["began no_reserve"] if level == ERROR else []
    assert again.work(30, r1=level, r2=level).changes == begun


def test_without_its_database_a_process_goes_on_with_what_fires(hall, tmp_path):
    firing = hall.work(60, r1=ERROR, r2=ERROR).state.faults()
    again = Hall(tmp_path)
    again.levels = {**hall.levels, "r1": None, "r2": None}  # not received again yet
    again.state.adopt(firing, again.now)
    assert again.work(300).changes == ["began no_reserve"]
    assert again.work(60, r1=OK, r2=OK).changes[1:] == ["ended recovered no_reserve"]


def test_what_is_removed_from_the_file_ends_as_removed(hall, tmp_path):
    text = hall.work(60, r1=ERROR, r2=ERROR).path.read_text()
    hall.path.write_text(
        "".join(line for line in text.splitlines(keepends=True) if "lifting at" not in line)
    )
    hall.configure(load(hall.path))
    assert hall.work(3).changes[1:] == ["ended removed no_reserve"]


def test_what_is_removed_with_another_config_of_its_robots_does_not_begin_first(hall):
    """Once it was judged by what the robots lost with that config, and removed a second later."""
    text = hall.path.read_text().replace("lifting: Lift", "lifting: Hook").splitlines(keepends=True)
    for _second in range(30):
        for name in ("r1", "r2", "r3"):
            hall.receive(f"/{name}/diagnostics", Status(ERROR, "Hook"))
        hall.work(1)
    hall.path.write_text("".join(line for line in text if "lifting at" not in line))
    hall.configure(load(hall.path))
    assert hall.work(3).changes == []


def test_one_capability_of_the_fleet_rests_on_another_and_on_expressions(tmp_path):
    least = (
        "{k: 1, of: [{can: lifting, robots: {robot: [r1, r2]}}]}}, deliveries: {all: ["
        "{capability: lifting at hall}, {any: [{can: lifting, robots: {robot: 'r*'}}, "
        "{can: lifting, robots: {site: yard}}]}]"
    )
    hall = Hall(tmp_path, least).work(40).work(30, r1=ERROR, r2=ERROR)
    states = {name: view.state.name for name, view in hall.state.needs(None).items()}
    assert states == {"lifting at hall": "LOST", "deliveries": "LOST"}


def test_metrics_snapshot_and_page_say_how_many_robots_can(hall):
    hall.work(30, r1=ERROR, r2=WARN, r3=None)
    samples = {
        labels["state"]: hall.sample("fleet_capability_robots", **labels)
        for labels in ({"state": each} for each in ("ok", "degraded", "lost", "unknown"))
    }
    assert samples == {"ok": 2, "degraded": 1, "lost": 1, "unknown": 1}
    assert hall.sample("fleet_capability_state", capability="lifting at hall") == 2
    fleet = fleet_snapshot(hall.state, hall.now)
    numbers = {"ok": 2, "degraded": 1, "lost": 1, "unknown": 1, "maintenance": 0}
    assert fleet["capabilities"] == [
        {"capability": "lifting at hall", "state": "degraded", "robots": numbers}
    ]
    page = landing(fleet, "/metrics")
    assert "3 of 5 robots can, 1 lost, 1 unknown" in page
    assert "Can do" not in landing(fleet, "/metrics", "Lift")


@pytest.mark.parametrize(("number", "more"), [(5, []), (7, ["and 2 more"])])
def test_the_evidence_names_five_robots_and_how_many_more(number, more):
    parts = {PartName(robot=f"r{n}", check="lift"): CapabilityState.LOST for n in range(number)}
    need = WantedCapability("lifting", AtLeast(1, tuple(parts)))
    text = fleet_evidence(NeedView(CapabilityState.LOST, need, parts, frozenset()))
    named = [f"r{n} has lost lift" for n in range(5)]
    assert text.split(";\n") == [f"0 of {number} robots can", *named, *more]


def test_the_command_names_the_robots_that_would_lose_it(hall, serve, capsys):
    hall.work(30, r1=ERROR, r2=ERROR)
    server = serve(capabilities=lambda name: capability_tree(hall.state, name, hall.now))
    assert main(["capabilities", "--url", f"http://{server.addresses[0]}"]) == 0
    lines = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    assert lines[1:4] == [
        "NO RESERVE lifting at hall: needs 3 of these 5",
        "LOST lifting of r1",
        "LOST lifting of r2",
    ]
    assert "lifting of r3 lifting at hall" in lines
    assert lines[-2:] == ["Single points of failure:", "nothing more is lost"]
