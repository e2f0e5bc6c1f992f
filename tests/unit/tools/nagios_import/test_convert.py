"""A site's Nagios files become a fleet, routes and a report in which no line is missing."""

import re
import shutil
from pathlib import Path

import pytest
import yaml

from ros_diagnostics_exporter.config.fleet import Source
from ros_diagnostics_exporter.config.load import load
from ros_diagnostics_tools.nagios.importer.convert import (
    FLEET,
    REPORT,
    ROUTES,
    Converted,
    ImportOptions,
    convert,
)
from ros_diagnostics_tools.nagios.importer.files import Directive, NagiosError
from ros_diagnostics_tools.nagios.importer.robots import UPLINK_QUERY
from support.called import called
from support.existing_site import ALERTMANAGER as EXISTING
from support.existing_site import added

CHECKOUT = Path(__file__).parents[4]
SITE = CHECKOUT / "tests/data/nagios"
OPTIONS = ImportOptions("hall", time_zone="Europe/Berlin")


@pytest.fixture(scope="module")
def made() -> Converted:
    return convert([SITE / "nagios.cfg"], OPTIONS)


@pytest.fixture(scope="module")
def fleet(made, tmp_path_factory):
    return loaded(made, tmp_path_factory.mktemp("fleet"))


def loaded(made: Converted, folder: Path):
    """The fleet that was made, from its file in this folder."""
    (folder / FLEET).write_text(made.texts[FLEET])
    return load(folder / FLEET)


def why(made: Converted, text: str) -> str:
    """What the report says about the one line that has ``text``."""
    (line,) = [
        each for each in made.texts[REPORT].splitlines() if text in each and " -> " not in each
    ]
    return line.partition(f"{text}: ")[2]


def test_hosts_with_ros_checks_are_robots(fleet):
    robots = [each for each in fleet.robots if each.source is not Source.QUERIES]
    assert [each.name for each in robots] == ["arm_1", "arm_2", "cart-1"]
    arm, _, cart = robots
    assert (arm.topic_agg, arm.domain_id, arm.address) == ("/arm_1/diagnostics_agg", 7, "10.0.0.11")
    assert arm.labels == {"robot_group": "arms", "uplink": "ap_hall", "site": "hall"}
    assert cart.topic_agg == "/cart_1/diagnostics_agg"
    assert not fleet.warnings


def test_services_are_checks_with_the_times_of_nagios(fleet):
    arm, cart = fleet.profiles["arm"], fleet.profiles["generic-robot"]

    assert {each.name for each in arm.checks} == {"all", "motors"}
    assert {each.name for each in cart.checks} == {"all", "lasers-front"}
    assert arm.confirm_after == 120  # 1 min x (3 - 1), of the host
    motor, every = arm.components
    assert (motor.confirm_after, motor.stale_after) == (240, 90)  # 2 min x (3 - 1), of the service
    assert every.confirm_after == 240
    (laser,) = cart.components
    assert (laser.confirm_after, laser.stale_after) == (0, 315)  # check_interval + latency
    (motors,) = (each for each in arm.checks if each.name == "motors")
    assert motors.expect == 1  # without a sensor it is critical, as in Nagios
    flapping = fleet.faults.flapping
    assert (flapping.start, flapping.stop) == (0.2, 0.05)  # the thresholds of services


def test_outside_of_its_check_period_a_robot_is_in_maintenance(fleet):
    (downtime,) = fleet.maintenance

    assert downtime.name == "cart-1 outside of workhours"
    assert downtime.time_zone == "Europe/Berlin"


def test_parents_are_uplinks_and_so_are_theirs(fleet):
    *_, hall, switch = fleet.robots
    assert (hall.name, hall.source, hall.address) == ("ap_hall", Source.QUERIES, "10.0.0.1")
    assert (hall.labels, switch.name) == ({"uplink": "core_switch"}, "core_switch")
    (query,) = fleet.queries
    assert query.uplink


def test_the_query_of_uplinks_is_the_shipped_one():
    shipped = CHECKOUT / "docs/examples/queries/queries.d/hosts.yml"
    assert UPLINK_QUERY in yaml.safe_load(shipped.read_text())


# -- routes ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def alertmanager(made, tmp_path_factory) -> Path:
    """The shipped configuration with the lists of the fragment before its own."""
    folder = tmp_path_factory.mktemp("alertmanager")
    shutil.copytree(CHECKOUT / "alertmanager", folder, dirs_exist_ok=True)
    shipped = yaml.safe_load((folder / "alertmanager.yml").read_text())
    fragment = yaml.safe_load(made.texts[ROUTES])
    shipped["route"]["routes"] = fragment.pop("routes") + shipped["route"]["routes"]
    for key, of_key in fragment.items():
        shipped[key] = of_key + shipped[key]
    (folder / "alertmanager.yml").write_text(yaml.safe_dump(shipped))
    return folder / "alertmanager.yml"


def test_the_routes_load_with_the_shipped_ones(alertmanager):
    called(["amtool", "check-config", alertmanager])


@pytest.mark.parametrize(
    ("labels", "receivers"),
    [
        ("alertname=RosDiagnosticsComponentCritical robot=arm_1 component=Motor_2", "ben-problems"),
        ("alertname=RosDiagnosticsComponentCritical robot=arm_1 group=/MOTORS", "ben-problems"),
        ("alertname=RosDiagnosticsComponentWarning robot=arm_1 component=Motor_2", "nobody"),
        (
            "alertname=RosDiagnosticsComponentCritical robot=arm_1 component=Laser",
            "ada,ben-problems",
        ),
        ("alertname=RosDiagnosticsComponentWarning robot=arm_1 component=Laser", "ada"),
        ("alertname=RosDiagnosticsComponentCritical robot=cart-1 component=Laser", "nobody"),
        ("alertname=RosDiagnosticsCheckShort robot=arm_1 check=motors", "ben-problems"),
        ("alertname=RosDiagnosticsRobotSilent robot=cart-1", "ada"),
        ("alertname=RosDiagnosticsRobotSilent robot=arm_2", "ada,ben-problems"),
        ("alertname=RosDiagnosticsRobotSilent robot=other", "email"),
        ("alertname=RosDiagnosticsExporterDown", "email"),
        ("alertname=RosDiagnosticsWatchdog", "none"),
        (
            "alertname=RosDiagnosticsUnacknowledged step=1 scope=value robot=arm_1 component=Motor",
            "boss-problems",
        ),
        ("alertname=RosDiagnosticsUnacknowledged step=1 scope=robot robot=cart-1", "boss-problems"),
        ("alertname=RosDiagnosticsUnacknowledged step=2 scope=robot robot=cart-1", "escalation-2"),
    ],
)
def test_contacts_receive_what_they_did(alertmanager, labels, receivers):
    command = ["amtool", "config", "routes", "test", f"--config.file={alertmanager}"]
    done = called([*command, *labels.split()])

    assert done.stdout.strip().replace("nagios-", "") == receivers


def test_hours_of_a_contact_are_those_of_the_route(made):
    fragment = yaml.safe_load(made.texts[ROUTES])
    ben = next(
        below
        for route in fragment["routes"]
        for below in route.get("routes", ())
        if below["receiver"] == "nagios-ben-problems"
    )

    assert ben["active_time_intervals"] == ["workhours"]
    assert ben["mute_time_intervals"] == ["workhours (off)"]
    assert {each["name"] for each in fragment["time_intervals"]} == {"workhours", "workhours (off)"}


def test_hours_are_in_the_time_zone_of_nagios(made, tmp_path):
    def zones(converted: Converted) -> set[str | None]:
        fragment = yaml.safe_load(converted.texts[ROUTES])
        return {
            interval.get("location")
            for each in fragment["time_intervals"]
            for interval in each["time_intervals"]
        }

    assert zones(made) == {"Europe/Berlin"}

    shutil.copytree(SITE, tmp_path, dirs_exist_ok=True)
    main_file = tmp_path / "nagios.cfg"
    main_file.write_text(main_file.read_text() + "use_timezone=Asia/Tokyo\n")
    found = convert([main_file], ImportOptions("hall"))
    assert zones(found) == {"Asia/Tokyo"}
    assert "time_zone: Asia/Tokyo" in found.texts[FLEET]
    assert zones(convert([main_file], OPTIONS)) == {"Europe/Berlin"}  # what the user says counts

    main_file.write_text(main_file.read_text().replace("Asia/Tokyo", "Atlantis/Capital"))
    with pytest.raises(NagiosError, match=r"use_timezone: .*--time-zone"):
        convert([main_file], ImportOptions("hall"))


def test_the_exporter_records_what_the_receivers_get(made):
    fragment = yaml.safe_load(made.texts[ROUTES])
    found = {
        each["name"]: [
            (one["url"], one["send_resolved"]) for one in each.get("webhook_configs", ())
        ]
        for each in fragment["receivers"]
    }
    url = "http://localhost:9877/api/v1/notifications"
    assert found.pop("nagios-nobody") == []
    assert found == {name: [(url, not name.endswith("-problems"))] for name in found}


def test_dependencies_inhibit(made):
    first, *_ = yaml.safe_load(made.texts[ROUTES])["inhibit_rules"]

    assert first["source_matchers"] == [
        'alertname =~ "RosDiagnosticsRobotSilent"',
        'robot = "arm_1"',
    ]
    assert first["target_matchers"][1] == 'robot = "arm_2"'
    assert first["equal"] == ["fleet"]


def test_an_escalation_waits_with_the_interval_of_its_object(made, tmp_path):
    """As nagios4 does: its own interval holds from its first notification on."""
    assert why(made, "first_notification 2").startswith("about 1h after the first")
    shutil.copytree(SITE, tmp_path, dirs_exist_ok=True)
    path = tmp_path / "objects/templates.cfg"
    path.write_text(path.read_text().replace("notification_interval   60\n", "\n"))
    found = convert([tmp_path / "nagios.cfg"], OPTIONS)
    assert why(found, "first_notification 3").startswith("about 1h after the first")  # 30 minutes


@pytest.mark.parametrize(
    ("attempts", "retry", "seconds"),
    [
        ("4 # one more than the host", "1", 180),
        ("4", "2 minutes", 360),
        ("3.9", "1.5", 180),
        ("4;text", "1", 180),
        ("x", "1", 0),
        ("4", "x", 0),
    ],
)
def test_numbers_are_read_as_nagios_reads_them(tmp_path, attempts, retry, seconds):
    path = tmp_path / "objects.cfg"
    line = service("Motor", 6).replace("attempts 6", f"attempts {attempts}")
    path.write_text(RULES + line.replace("interval 1", f"interval {retry}"))
    made = convert([path], OPTIONS)

    (profile,) = loaded(made, tmp_path).profiles.values()
    found = profile.components[0] if profile.components else profile
    assert found.confirm_after == seconds
    for key, value in (("max_check_attempts", attempts), ("retry_interval", retry)):
        if value == "x":
            assert why(made, f"{key} x") == "'x' is not a number, and 0 to Nagios"


# -- into alertmanager.yml -------------------------------------------------------------------


def test_the_routes_are_merged_into_alertmanager_yml(alertmanager, made, tmp_path):
    path = CHECKOUT / "alertmanager/alertmanager.yml"
    into = convert([SITE / "nagios.cfg"], OPTIONS._replace(into=path)).texts

    assert ROUTES not in into
    assert yaml.safe_load(into["alertmanager.yml"]) == yaml.safe_load(alertmanager.read_text())
    kept = [line for line in path.read_text().splitlines() if line not in into["alertmanager.yml"]]
    assert not kept  # comments, too


def test_routes_go_below_the_route_of_a_site_with_others(tmp_path):
    path = tmp_path / "alertmanager.yml"
    path.write_text(added(EXISTING.format(smtp="localhost:25"), "alertmanager.yml"))

    text = convert([SITE / "nagios.cfg"], OPTIONS._replace(into=path)).texts["alertmanager.yml"]

    ours, *others = yaml.safe_load(text)["route"]["routes"]
    assert any("RosDiagnostics.+" in each for each in ours["matchers"])
    assert any("robot =~" in each for each in ours["routes"][0]["matchers"])
    assert len(others) == 2
    path.write_text(text)
    with pytest.raises(NagiosError, match="has a receiver nagios-ada already"):
        convert([SITE / "nagios.cfg"], OPTIONS._replace(into=path))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("- x\n", "has no route"),
        ("route: [\n", "is not YAML"),
        ("receivers: []\n", "has no route"),
        ("route: {receiver: a}\nreceivers: [{name: a}]\n", "write receivers as a list with"),
    ],
)
def test_what_cannot_be_merged_into_is_named(tmp_path, text, message):
    path = tmp_path / "alertmanager.yml"
    path.write_text(text)
    with pytest.raises(NagiosError, match=message):
        convert([SITE / "nagios.cfg"], OPTIONS._replace(into=path))


def test_an_alertmanager_yml_that_is_not_there_is_named_in_words(tmp_path):
    path = tmp_path / "alertmanager.yml"
    message = rf"^{re.escape(str(path))}: No such file or directory; give Alertmanager's"
    with pytest.raises(NagiosError, match=message):
        convert([SITE / "nagios.cfg"], OPTIONS._replace(into=path))


def test_lists_that_are_not_there_are_added(tmp_path):
    path = tmp_path / "alertmanager.yml"
    path.write_text("route:\n  receiver: a\nreceivers:\n- name: a")

    text = convert([SITE / "nagios.cfg"], OPTIONS._replace(into=path)).texts["alertmanager.yml"]

    found = yaml.safe_load(text)
    assert found["route"]["routes"]
    assert found["route"]["receiver"] == found["receivers"][-1]["name"] == "a"
    assert found["time_intervals"]


# -- the report ------------------------------------------------------------------------------


def lines_of(folder: Path) -> list[tuple[str, int]]:
    """Every line of all files that says something, found without the reader that is tested."""
    found = []
    for path in sorted(folder.rglob("*.cfg")):
        for number, line in enumerate(path.read_text().splitlines(), 1):
            if re.match(r"\s*[^\s#;}]", line) and not re.match(r"\s*define\b", line):
                found.append((str(path), number))
    return found


def test_every_line_is_in_the_report(made):
    reported = re.findall(r"^(\S+?):(\d+): ", made.texts[REPORT], re.MULTILINE)

    assert set(lines_of(SITE)) == {(path, int(line)) for path, line in reported}


NOWHERE = """
define hostdependency {
    host_name arm_1
    dependent_host_name printer
    notification_failure_criteria d
}
define servicedependency {
    host_name arm_1
    service_description motors
    dependent_host_name arm_2
    dependent_service_description motors
    notification_failure_criteria u
}
define hostescalation {
    host_name arm_1
    first_notification 2
    contacts nobody_of_this_name
    escalation_period 24x7
}
define host {
    host_name printer
    address 10.0.0.99
}
"""


def test_what_is_nowhere_in_the_output_is_not_called_translated(made, tmp_path):
    shutil.copytree(SITE, tmp_path, dirs_exist_ok=True)
    path = tmp_path / "objects" / "robots" / "nowhere.cfg"
    path.write_text(NOWHERE)

    found = convert([tmp_path / "nagios.cfg"], OPTIONS)

    for name in (FLEET, ROUTES):
        assert found.texts[name] == made.texts[name]
    claimed = {each.key for each, _ in found.ledger.translated_rows if each.path == path}
    assert claimed == set()
    assert len(
        [each for each, why in found.ledger.lost_rows if each.path == path and any(why)]
    ) == len(re.findall(r"^ ", NOWHERE, re.MULTILINE))


RULES = """
define command {
    command_name check_ros
    command_line /opt/check_ros -H $HOSTADDRESS$ -N $ARG1$
}
define host {
    host_name a
    address 10.0.0.1
    max_check_attempts 1
}
"""


def service(words: str, attempts: int) -> str:
    return f"""define service {{
    host_name a
    service_description {words}
    check_command check_ros!{words}
    max_check_attempts {attempts}
    retry_interval 1
}}
"""


@pytest.mark.parametrize(
    ("services", "seconds"),
    [
        ((("Laser", 2), ("Motor", 6)), 300),  # nobody says what holds for others: the longest
        ((("Laser", 2), ("Arm", 2), ("Motor", 6)), 60),  # what most say
        ((("Laser", 2), ("Arm", 2), ("all", 4)), 180),  # the service that checks everything
    ],
)
def test_components_without_a_service_of_their_own(tmp_path, services, seconds):
    path = tmp_path / "objects.cfg"
    path.write_text(RULES + "".join(service(*each) for each in services))

    (profile,) = loaded(convert([path], OPTIONS), tmp_path).profiles.values()
    assert profile.components[-1].pattern.pattern == ".*"
    assert profile.components[-1].confirm_after == seconds


def test_intervals_are_in_the_time_unit_of_the_main_file(tmp_path):
    (tmp_path / "objects.cfg").write_text(RULES + service("Motor", 6))
    path = tmp_path / "nagios.cfg"
    path.write_text("cfg_file=objects.cfg\ninterval_length=10\n")

    (profile,) = loaded(convert([path], OPTIONS), tmp_path).profiles.values()
    assert profile.components[-1].confirm_after == 50


def test_what_to_do_is_said_for_what_has_no_equivalent(made):
    assert why(made, "day 1 - 15 / 5 00:00-24:00").startswith(
        "Alertmanager's time intervals cannot"
    )
    assert (
        why(made, "check_command check_ros!Laser")
        == "not translated of the plug-in's arguments: -t 30"
    )
    assert why(made, "_PASSWORD (not shown)").startswith("a custom variable")
    assert why(made, "first_notification 3").startswith("about 2h after the first notification")
    assert why(made, "pager +491700000000").startswith("add sns_configs or a webhook")
    assert "never-in-a-report" not in "".join(made.texts.values())


def test_an_argument_that_the_host_says_too_is_translated_with_its_option(tmp_path):
    host = "define host {\n host_name amr01\n address 10.0.0.1\n _ROS_NAMESPACE /amr01\n}\n"
    command = "check_ros_diagnostics.py -n $_HOSTROS_NAMESPACE$ -N Motor -v"
    commands = f"define command {{\n command_name check_ros\n command_line {command}\n}}\n"
    asks = "check_command check_ros\n check_interval 1\n max_check_attempts 1\n"
    check = f"define service {{\n host_name amr01\n service_description Motor\n {asks}}}\n"
    (tmp_path / "objects.cfg").write_text(host + commands + check)
    (tmp_path / "nagios.cfg").write_text("cfg_file=objects.cfg\n")
    made = convert([tmp_path / "nagios.cfg"], OPTIONS)
    assert [each.namespace for each in loaded(made, tmp_path).robots] == ["/amr01"]
    (line,) = [each for each in made.texts[REPORT].splitlines() if "plug-in's arguments" in each]
    assert line.endswith("arguments: -v")


# A line that is translated -> another value, for keys whose values are not numbers.
OTHER = {
    "24x7": "workhours",
    "workhours": "24x7",
    "d,u,r": "r",
    "w,c,r": "c",
    "w,c,r,f": "c",
    "d,u,r,f,s": "s",
    "d": "r",
    "c": "r",
    "d,r": "r",
    "c,r": "r",
    "d,u": "p",
    "w,c": "c",
    "0": "1",
    "null": "n",
}
# What may change and make no difference in this site, and why.
SAME = {
    "contacts.cfg host_notification_period 24x7": "boss: his escalation has narrower hours",
    "robots.cfg members cart-1": "the host names the group as well",
    "robots.cfg hostgroup_members carts": "its host names the outer group as well",
    "robots.cfg notification_period workhours": "the contact of the service has the same hours",
    "templates.cfg register 0": "an object without a name is nobody's",
    "resource.cfg $USER1$ /usr/lib/nagios/plugins": "a plug-in is known by its name only",
}


def outputs(made: Converted) -> tuple[object, ...]:
    """All that the conversion says, but for the list of what is translated."""
    reasons = tuple(why for _, why in made.ledger.lost_rows)
    return (*(made.texts.get(name) for name in (FLEET, ROUTES)), reasons)


def only_translated(made: Converted) -> list[Directive]:
    lost = {each for each, _ in made.ledger.lost_rows}
    return [each for each, _ in made.ledger.translated_rows if each not in lost]


def test_a_line_that_is_translated_makes_a_difference(made, tmp_path):
    """What the report calls translated is: another value is another output, or an error."""
    idle = set()
    for each in only_translated(made):
        folder = tmp_path / "site"
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(SITE, folder)
        path = folder / each.path.relative_to(SITE)
        lines = path.read_text().splitlines()
        lines[each.line - 1] = changed(lines[each.line - 1], each)
        path.write_text("\n".join(lines))
        try:
            if outputs(convert([folder / "nagios.cfg"], OPTIONS)) == outputs(made):
                idle.add(f"{each.path.name} {each.key} {each.value}")
        except NagiosError:
            continue

    assert idle == SAME.keys()


def changed(line: str, directive: Directive) -> str:
    value = directive.value
    if value in OTHER:
        other = OTHER[value]
    elif value.replace(".", "").isdigit():
        other = str(int(value.split(".")[0]) + 7)
    elif re.match(r"\d\d:\d\d-", value):
        other = "01:00-02:00" if directive.key != "december 25" else "01:00-03:00"
    else:
        other = "something_else"
    return line.replace(value, other)


# -- the command -----------------------------------------------------------------------------


IMPORT = ("nagios", "import")


def test_the_command_writes_all_files_and_does_not_overwrite(tmp_path, run):
    command = (*IMPORT, str(SITE / "nagios.cfg"), "--to", str(tmp_path / "new"), "--fleet", "hall")

    written = "3 robots; fleet.yml, queries.d/hosts.yml, alertmanager-routes.yml, report.txt"
    assert written in run(*command).out
    assert sorted(each.name for each in (tmp_path / "new").iterdir()) == sorted(
        (FLEET, "queries.d", ROUTES, REPORT)
    )
    (tmp_path / "new" / REPORT).unlink()  # one file that is there is enough
    assert "overwrite them with --force" in run(*command, code=1).err
    run(*command, "--force")


def test_without_a_ros_check_the_command_says_how_to_name_the_plugin(tmp_path, run):
    other = ("--to", str(tmp_path), "--plugin", "check_other*")

    said = run(*IMPORT, str(SITE / "nagios.cfg"), *other, code=1).err  # nobody is notified

    assert "name the ROS plug-in with --plugin" in said
    assert load(tmp_path / FLEET).robots == ()


def test_files_that_nagios_rejects_write_nothing(tmp_path, run):
    (tmp_path / "bad.cfg").write_text("define host {\nuse nowhere\nhost_name a\n}\n")

    said = run(*IMPORT, str(tmp_path / "bad.cfg"), "--to", str(tmp_path / "new"), code=1).err
    assert "bad.cfg:1: use nowhere" in said
    assert not (tmp_path / "new").exists()
