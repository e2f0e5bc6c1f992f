"""Whatever a site's files say: every line is accounted for, and fleet.yml is valid."""

from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from ros_diagnostics_exporter.config.load import load
from ros_diagnostics_tools.nagios.importer.advice import ADVICE, TRANSLATED
from ros_diagnostics_tools.nagios.importer.convert import FLEET, ImportOptions, convert
from ros_diagnostics_tools.nagios.importer.files import KINDS, NagiosError, read

NAMES = ("a", "b", "c-1", "1.2", "*", "!a", "Motor")
VALUES = st.one_of(
    st.sampled_from(
        [*NAMES, "null", "+a,b", "0", "1", "3", "0.5", "w,c,r", "d,u,r,f,s", "n", "10.0.0.1", "x y"]
    ),
    st.sampled_from(["check_ros!Motor", "check_ros!all", "check_ping!1", "check_ros!a!b", "24x7"]),
    st.lists(st.sampled_from(NAMES), min_size=1, max_size=3).map(",".join),
    st.text("abc Ä$!,{}\"'\\|", min_size=1, max_size=8),
)
KEYS = st.sampled_from(
    sorted(
        {*ADVICE, *TRANSLATED, *(f"{kind}_name" for kind in KINDS), "name", "use", "register"}
        | {"_SITE", "_PASSWORD", "_ROS_DOMAIN_ID", "_ROS_NAMESPACE", "no_such_thing"}
        | {"host", "description", "hostgroups", "monday", "december 25", "exclude"}
    )
)
LINES = st.lists(st.tuples(KEYS, VALUES), max_size=8)
OBJECTS = st.lists(st.tuples(st.sampled_from(sorted(KINDS)), LINES), max_size=8)
BASE = """\
define command {
    command_name check_ros
    command_line /opt/check_ros -H $HOSTADDRESS$ -N $ARG1$
}
define timeperiod {
    timeperiod_name 24x7
    monday 00:00-24:00
}
define host {
    host_name a
    name robot
    address 10.0.0.1
    check_period 24x7
    max_check_attempts 2
}
define service {
    name service
    host_name a
    service_description s
    check_command check_ros!Motor
}
"""


def text(objects) -> str:
    made = [BASE]
    for kind, lines in objects:
        body = "".join(f"    {key} {value}\n" for key, value in lines)
        made.append(f"define {kind} {{\n{body}}}\n")
    return "".join(made)


@given(objects=OBJECTS)
def test_every_line_is_translated_or_reported_and_the_fleet_is_valid(tmp_path_factory, objects):
    folder: Path = tmp_path_factory.mktemp("site")
    path = folder / "objects.cfg"
    path.write_text(text(objects), encoding="utf-8")
    try:
        made = convert([path], ImportOptions("f"))
    except NagiosError as error:
        assert str(path) in str(error)  # noqa: PT017 - either is right, and this is how it must be
        return

    ledger = made.ledger
    reported = {each for each, _ in (*ledger.lost_rows, *ledger.translated_rows)}
    assert reported == {each for one in read([path]).definitions for each in one.directives}
    assert all(why for _, why in ledger.lost_rows)
    (folder / FLEET).write_text(made.texts[FLEET], encoding="utf-8")
    load(folder / FLEET)
