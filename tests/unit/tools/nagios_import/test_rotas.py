"""Contacts whose hours relieve one another become a rota; others are all notified."""

from datetime import datetime, timedelta, timezone

import pytest
import yaml

from ros_diagnostics_tools.nagios.importer.convert import ONCALL, ROUTES, ImportOptions, convert
from ros_diagnostics_tools.nagios.importer.hours import Hours
from ros_diagnostics_tools.nagios.importer.rotas import relieve_one_another
from ros_diagnostics_tools.oncall.file import load

DAYS = ("monday", "tuesday", "wednesday", "thursday", "friday", "saturday", "sunday")
SITE = """\
define command {{
    command_name check_ros
    command_line /opt/check_ros -H $HOSTADDRESS$ -N $ARG1$
}}
define timeperiod {{
    timeperiod_name day
    {day}
}}
define timeperiod {{
    timeperiod_name night
    {night}
}}
define contact {{
    contact_name ada
    host_notification_options d,u,r,f,s
    service_notification_options w,u,c,r,f,s
    email ada@example.org
    pager +4915112345678
    host_notification_period day
    service_notification_period day
}}
define contact {{
    contact_name ben
    host_notification_options d,u,r,f,s
    service_notification_options w,u,c,r,f,s
    email ben@example.org
    host_notification_period night
    service_notification_period night
}}
define host {{
    host_name r1
    contacts ada,ben
    max_check_attempts 3
}}
define service {{
    host_name r1
    service_description motors
    check_command check_ros!Motor
}}
"""


def converted(tmp_path, night: str):
    lines = [f"{day} 08:00-20:00" for day in DAYS]
    nights = [f"{day} {night}" for day in DAYS]
    path = tmp_path / "site.cfg"
    path.write_text(SITE.format(day="\n    ".join(lines), night="\n    ".join(nights)))
    return convert([path], ImportOptions("f", time_zone="Europe/Berlin"))


def test_hours_that_share_out_the_week_are_shifts(tmp_path):
    made = converted(tmp_path, "00:00-08:00,20:00-24:00")

    oncall = yaml.safe_load(made.texts[ONCALL])
    assert oncall["people"] == {
        "ada": {"email": "ada@example.org", "phone": "+4915112345678"},
        "ben": {"email": "ben@example.org"},
    }
    (team,) = oncall["teams"]
    level = team["levels"]["first"]
    assert [(each["people"], each["hours"]) for each in level["shifts"]] == [
        (["ada"], ["Mon,Tue,Wed,Thu,Fri,Sat,Sun 08:00-20:00"]),
        (
            ["ben"],
            [
                f"{','.join(d[:3].title() for d in DAYS)} {h}"
                for h in ("00:00-08:00", "20:00-24:00")
            ],
        ),
    ]
    routes = yaml.safe_load(made.texts[ROUTES])
    below = routes["routes"][0]["routes"]
    assert [each["receiver"] for each in below] == [level["receiver"]]
    assert "active_time_intervals" not in below[0]
    (receiver,) = [each for each in routes["receivers"] if each["name"] == level["receiver"]]
    assert receiver["email_configs"][0]["to"] == "ada@example.org, ben@example.org"


def test_the_shifts_leave_nobody_and_nothing_out(tmp_path):
    made = converted(tmp_path, "00:00-08:00,20:00-24:00")
    (tmp_path / ONCALL).write_text(made.texts[ONCALL])

    begin = datetime(2026, 3, 26, tzinfo=timezone.utc)  # a change of the clock in its week
    (duties,) = load(tmp_path / ONCALL).duties(begin, begin + timedelta(days=7)).values()

    assert {each.person for each in duties} == {"ada", "ben"}


@pytest.mark.parametrize("night", ["00:00-08:00,19:00-24:00", "00:00-07:00,20:00-24:00"])
def test_hours_with_an_overlap_or_a_gap_stay_those_of_routes(tmp_path, night):
    made = converted(tmp_path, night)

    assert ONCALL not in made.texts
    below = yaml.safe_load(made.texts[ROUTES])["routes"][0]["routes"]
    assert [each["active_time_intervals"] for each in below] == [["day"], ["night"]]


@pytest.mark.parametrize(
    ("morning", "evening", "expected"),
    [((0, 720), (720, 1440), True), ((0, 720), (720, 1320), False), ((60, 720), (720, 1440), False),
     ((0, 720), (700, 1440), False)],
)  # fmt: skip
def test_contacts_relieve_one_another_only_where_their_hours_make_whole_days(
    morning, evening, expected
):
    found = [Hours(str(each), ((each,),) * 7) for each in (morning, evening)]
    assert relieve_one_another(found) is expected
