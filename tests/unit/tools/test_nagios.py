import socket
import threading

import bcrypt
import pytest

from ros_diagnostics_tools.check_nagios import check, main
from support.web_server import broken, component, downtime, fleet, problem, robot, url_of

MUTE = "its publisher sends nothing (mute)"
GONE = "nobody publishes on its topics (publisher_gone)"
NO_VALUES = {"values": []}
GROUPS = [
    {"group": "/Motor", "level": "ERROR", "message": "Error"},
    {"group": "/Laser", "level": "OK", "message": "OK"},
    {"group": "/Power", "level": "WARN", "message": "Warning"},
]
BROKEN = robot(
    "robot_1",
    component("Motor 1", "OK", **NO_VALUES),
    component("Motor 2", "ERROR", message="Over temperature", **NO_VALUES),
    component("Laser 1", "OK", group="/Laser", **NO_VALUES),
    component("Robot Battery", "WARN", message="Charge|soon", group="/Power"),
    groups=GROUPS,
    problems=[
        broken("Motor 2"),
        broken("Motor 2", "warning"),
        broken("Robot Battery", "warning", group="/Power", confirmed=None),
    ],
)
MOTOR_2 = "/Motor/Motor 2 (confirmed, for 1 min: Over temperature)"
BATTERY = "/Power/Robot Battery (not confirmed yet, 5 s left, for 1 min: Charge/soon)"


def checked(name: str = "", *robots) -> tuple[int, str]:
    """Exit code and text without the performance data."""
    code, line = check(fleet(*(robots or (BROKEN,))), "robot_1", name)
    return code, line.partition(" | ")[0]


def test_all_sensors_ok():
    assert checked("Laser") == (0, "OK - OK sensor(s) list: /Laser/Laser 1")


def test_states_are_listed_worst_first_with_how_the_problems_stand():
    code, text = checked()
    assert code == 2
    assert text.removeprefix("CRITICAL - ").split(" sensor(s) list: ") == [
        "CRITICAL",
        f"{MOTOR_2}, WARNING",
        f"{BATTERY}, OK",
        "/Laser/Laser 1, /Motor/Motor 1",
    ]


def test_a_warning_alone():
    assert checked("battery") == (1, f"WARNING - WARNING sensor(s) list: {BATTERY}")


def test_a_planned_stale_sensor_is_listed_and_does_not_count():
    planned = component("Pendant", "STALE", group="", planned_stale=True, **NO_VALUES)
    failed = {**planned, "state": "CRITICAL", "level_before_stale": "ERROR"}
    listed = "STALE sensor(s) list: Pendant"
    assert checked("pendant", robot("robot_1", planned)) == (0, f"OK - {listed} (planned)")
    found = checked("pendant", robot("robot_1", failed, problems=[broken("Pendant", group="")]))
    assert found == (2, f"CRITICAL - {listed} (confirmed, for 1 min: Pendant reports STALE)")


def test_what_a_condition_suppresses_is_listed_as_ok():
    suppressed = {"confirmed": None, "suppressed": "condition", "because": "unless Charger is OK"}
    value = problem(
        "value", "critical", group="/Motor", component="Motor 2", key="Level", **suppressed
    )
    problems = [broken(**suppressed), value]
    motor = component("Motor 1", "ERROR", suppressed_because="unless Charger is OK")
    why = "suppressed: by its condition in fleet.yml, unless Charger is OK, for 1 min"
    assert checked("", robot("robot_1", motor, component("Motor 2", "OK"), problems=problems)) == (
        0,
        (
            f"OK - OK sensor(s) list: /Motor/Motor 1 ({why}: Motor 1 reports ERROR), "
            f"/Motor/Motor 2 (Level : {why})"
        ),
    )


@pytest.mark.usefixtures("in_utc")
def test_in_maintenance_everything_is_listed_and_nothing_counts():
    planned = {"maintenance": True, "maintenance_until": 72_000.0}
    code, text = checked("motor 2", {**BROKEN, **planned})
    assert (code, text.split(": ", 1)[0]) == (0, "OK - in maintenance until 20:00")
    assert MOTOR_2 in text
    endless = {"maintenance": True, "maintenance_until": None}
    silent = {**BROKEN, **endless, "up": False, "silent_reason": "mute"}
    assert checked("", silent) == (0, f"OK - in maintenance: robot robot_1 is silent: {MUTE}")


def confirmed_only(pattern: str, shown: dict) -> tuple[int, str]:
    code, line = check(fleet(shown), "robot_1", pattern, confirmed=True)
    return code, line.partition(" | ")[0]


def test_with_confirmed_only_what_the_exporter_has_confirmed_counts():
    assert confirmed_only("Motor 2", BROKEN) == checked("Motor 2")
    assert confirmed_only("Battery", BROKEN) == (0, f"OK - WARNING sensor(s) list: {BATTERY}")
    # Well again, but held open, as the alert is: it counts until it has ended.
    held = broken(healthy=True, suppressed="flapping")
    open_still = robot("robot_1", component("Motor 1", "OK"), problems=[held])
    assert confirmed_only("", open_still)[0] == 2
    of = {"group": "/Motor", "component": "Motor 1", "confirmed": 1_000.0}
    flapping = problem("flapping", "flapping", **of)
    shown = robot("robot_1", component("Motor 1", "ERROR"), problems=[flapping])
    assert confirmed_only("", shown)[0] == 1


def test_with_confirmed_a_silence_and_a_short_check_count_when_they_are():
    silent = problem("robot", "silent", confirmed=None)
    mute = {**BROKEN, "up": False, "silent_reason": "mute", "problems": [silent]}
    assert confirmed_only("", mute)[0] == 0
    mute["problems"] = [{**silent, "confirmed": 1_000.0}]
    assert confirmed_only("", mute)[0] == 3
    short = {**BROKEN, "short_checks": [SHORT], "problems": [MISSING]}
    assert confirmed_only("drive", short)[0] == 0
    short["problems"] = [{**MISSING, "confirmed": 1_000.0}]
    assert confirmed_only("drive", short)[0] == 2


@pytest.mark.usefixtures("in_utc")
def test_a_component_in_a_downtime_is_listed_and_does_not_count():
    suppressed = broken("Motor 2", confirmed=None, suppressed="maintenance")
    planned = {**BROKEN, "problems": [suppressed], "downtimes": [downtime("Motor 2")]}
    code, text = checked("motor 2", planned)
    assert code == 0
    assert (
        "(suppressed: maintenance until 20:00 (ann: new gears), for 1 min: Over temperature)"
        in text
    )
    assert checked("motor 2", {**planned, "downtimes": [downtime("Motor 1")]})[0] == 2


MISSING = problem("check", "critical", check="motors")
SHORT = {"check": "motors", "patterns": ["^Motor [0-9]", "Drive"], "found": 1, "expected": 2}
FINDS = "CRITICAL sensor(s) list: check motors finds 1 of 2 (not confirmed yet, 5 s left"


@pytest.mark.parametrize("name", ["", "motor", "drive"])
def test_a_check_that_misses_components_is_critical_where_it_is_meant(name):
    shown = robot(
        "robot_1",
        component("Motor 1", "OK"),
        component("Laser", "OK", group=""),
        short_checks=[SHORT],
        problems=[MISSING],
    )
    code, text = checked(name, shown)
    assert (code, FINDS in text) == (2, True)
    assert checked("laser", shown) == (0, "OK - OK sensor(s) list: Laser")
    _, line = check(fleet(shown), "robot_1", name)
    assert " | critical=0;;;0" in line  # a check is no sensor


def test_a_value_beyond_its_threshold_counts():
    low = {"bound": "low", "severity": "critical", "value": 13.0}
    values = [{"key": "Level", "value": "12.3 V", "number": 12.3, "unit": "V", "thresholds": [low]}]
    beyond = problem("value", "critical", component="Battery", key="Level", bound="low")
    shown = robot("robot_1", component("Battery", "OK", group="", values=values), problems=[beyond])
    assert checked("", shown) == (
        2,
        (
            "CRITICAL - CRITICAL sensor(s) list: Battery "
            "(Level 12.3 V, low threshold 13: not confirmed yet, 5 s left, for 1 min)"
        ),
    )
    again = {**beyond, "healthy": True, "confirmed": 1_010.0, "suppressed": "maintenance"}
    assert checked("", {**shown, "problems": [again]})[0] == 0


def test_performance_data_have_thresholds_as_ranges_and_units_of_the_guidelines():
    def datum(unit: str, *thresholds: tuple[str, str, float]) -> str:
        given = [
            dict(zip(("bound", "severity", "value"), each, strict=True)) for each in thresholds
        ]
        value = {"key": "K", "value": "1", "number": 1.0, "unit": unit, "thresholds": given}
        shown = robot("robot_1", component("C", "OK", values=[value]))
        return check(fleet(shown), "robot_1", "")[1].rpartition("ok=1;;;0 ")[2]

    low, high = ("low", "warning", 20.0), ("high", "critical", 90.5)
    assert datum("%", low) == "'C K'=1%;20:;"
    assert datum("s", high) == "'C K'=1s;;~:90.5"
    assert datum("kB", low, high, ("low", "critical", -5.0)) == "'C K'=1KB;20:;-5:90.5"
    assert datum("degC") == "'C K [degC]'=1"


def test_the_text_fits_into_what_nagios_reads():
    many = [component(f"Motor {n}" + "x" * 240, "ERROR", message="x" * 4_000) for n in range(500)]
    bad = [
        broken(f"Motor {n}" + "x" * 240, suppressed="common", confirmed=None) for n in range(500)
    ]
    _, line = check(fleet(robot("robot_1", *many, problems=bad)), "robot_1", "")
    assert "critical=500;;;0" in line
    assert len(line) < 8_192


def test_no_matching_sensor_is_critical():
    assert checked("Gripper") == (2, "CRITICAL - no sensor matches 'Gripper'")


def test_a_silent_or_unknown_robot_is_unknown():
    silent = {**BROKEN, "up": False, "silent_reason": "publisher_gone"}
    assert checked("", silent) == (3, f"UNKNOWN - robot robot_1 is silent: {GONE}")
    assert checked("", robot("other")) == (3, "UNKNOWN - the exporter knows no robot 'robot_1'")


def test_performance_data_has_the_counts_and_the_numbers():
    _, line = check(fleet(BROKEN), "robot_1", "")
    assert line.partition(" | ")[2] == (
        "critical=1;;;0 stale=0;;;0 warning=1;;;0 ok=2;;;0 'Robot Battery Level [V]'=12.3"
    )


def test_numbers_of_stale_sensors_are_left_out():
    stale = robot("robot_1", component("Robot Battery", "STALE"))
    assert "Battery" not in check(fleet(stale), "robot_1", "")[1].partition(" | ")[2]


def test_a_robots_text_cannot_break_the_line():
    values = [{"key": "a'b=c|d", "value": "1%", "number": 1.0, "unit": "%"}]
    odd = robot("robot_1", component("Mot|or\n1\x1b", "OK", values=values), groups=[])
    _, line = check(fleet(odd), "robot_1", "")
    text, data = line.split(" | ")
    assert text == r"OK - OK sensor(s) list: /Motor/Mot/or 1\x1b"
    assert data.endswith(r"'Mot/or 1\x1b a''b:c/d'=1%")


def test_the_command_asks_the_exporter(serve, capsys):
    url = url_of(serve(fleet_snapshot=lambda: fleet(BROKEN, robot("robot_2"))))
    assert main(["-H", "robot_1", "-N", "laser", "--url", url]) == 0
    assert capsys.readouterr().out.startswith("OK - OK sensor(s) list: /Laser/Laser 1 | ")
    assert main(["-H", "robot_3", "--url", url]) == 3


@pytest.fixture
def unknown(capsys):
    """A function (URL, more): what the plug-in prints of robot_1, which is UNKNOWN."""

    def unknown(url, *more):
        assert main(["-H", "robot_1", "--url", url, *more]) == 3
        return capsys.readouterr().out

    return unknown


@pytest.mark.parametrize("call", [["-N", "Motor"], ["-H", "a", "-t", "-1"], ["-H", "a", "-t", "x"]])
def test_wrong_arguments_are_unknown_and_not_critical(call, capsys):
    with pytest.raises(SystemExit) as ended:
        main(call)
    assert ended.value.code == 3
    assert capsys.readouterr().out.startswith("UNKNOWN - ")


@pytest.mark.parametrize(
    ("url", "complaint"),
    [
        ("nonsense", "it is not the URL of a server"),
        ("http://127.0.0.1:1/", "refused"),
        ("ftp://x", "UNKNOWN"),
        ("http://a b", "control char"),
    ],
)
def test_a_wrong_url_is_unknown(url, complaint, unknown):
    assert complaint in unknown(url)


def test_another_server_or_an_http_error_is_unknown(serve, unknown):
    server = serve(fleet_snapshot=lambda: 1 / 0)
    assert "answered 500" in unknown(url_of(server))
    assert "UNKNOWN" in unknown(url_of(server, "/metrics#"))
    assert "--password-file" in unknown(url_of(server), "--user", "a")


def test_an_unexpected_response_is_unknown_and_not_a_warning(serve, unknown):
    server = serve(fleet_snapshot=lambda: fleet({"robot": "robot_1"}))
    said = "UNKNOWN - the exporter's answer is not as expected; is it of the same version?"
    assert unknown(url_of(server)) == f"{said} (KeyError('problems'))\n"


def test_a_response_that_drips_in_byte_by_byte_times_out(unknown):
    stop = threading.Event()
    with socket.create_server(("127.0.0.1", 0)) as listening:

        def drip() -> None:
            taken, _ = listening.accept()
            with taken:
                while not stop.wait(0.05):
                    taken.sendall(b"H")

        dripping = threading.Thread(target=drip)
        dripping.start()
        port = listening.getsockname()[1]
        assert "no answer" in unknown(f"http://127.0.0.1:{port}", "-t", "0.5")
        stop.set()
        dripping.join(20)


def test_tls_and_basic_auth(serve, ca, tls_config, tmp_path, unknown):
    hashed = bcrypt.hashpw(b"secret", bcrypt.gensalt(4)).decode()
    tls_config.write_text(f"{tls_config.read_text()}\nbasic_auth_users: {{nagios: {hashed}}}")
    ca.cert_pem.write_to_path(tmp_path / "ca.crt")
    (tmp_path / "password").write_text("secret\n")
    server = serve(web_config=tls_config, fleet_snapshot=lambda: fleet(BROKEN))
    url = f"https://{server.addresses[0]}"
    login = ["--user", "nagios", "--password-file", str(tmp_path / "password")]
    trust = ["--ca-file", str(tmp_path / "ca.crt")]
    assert main(["-H", "robot_1", "-N", "laser", "--url", url, *login, *trust]) == 0
    assert "answered 401" in unknown(url, *trust)
    assert "certificate verify failed" in unknown(url, *login).replace("_", " ").lower()
    assert "missing.crt" in unknown(url, "--ca-file", str(tmp_path / "missing.crt"))
