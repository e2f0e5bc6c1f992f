"""What is wrong with oncall.yml: file, line, key, value and the way out."""

from datetime import datetime, timezone

import pytest

NOW = datetime(2027, 3, 22, 12, tzinfo=timezone.utc)
BASE = """
time_zone: Europe/Berlin
people:
  anna: {email: anna@example.org}
  ben: {phone: "+4915112345602"}
teams:
  - name: robots
    levels:
      first:
        receiver: on-call
        like: [email, sms]
        shifts:
          - {people: [anna, ben], since: 2027-01-04T09:00}
      second:
        receiver: escalation-1
        shifts:
          - {people: [anna], since: 2027-01-04T09:00}
"""


@pytest.fixture
def errors(run):
    """A function (text): the lines that `build` writes to standard error about it."""
    return lambda text: run(text, "build", "--ahead", "3w", now=NOW, code=2).err.splitlines()


TURN = "since: 2027-01-04T09:00}\n      second"
SHIFT = "13: teams[robots].levels.first.shifts[0]"
SECOND = "teams[robots].levels.second"


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("Europe/Berlin", "Europe/Berlln", '2: time_zone: "Europe/Berlln" is not a time zone'),
        ("[anna, ben]", "[anna, bne]", f'{SHIFT}.people[1]: "bne" is unknown; did you mean ben?'),
        ("anna@example.org", "anna", '4: people.anna.email: "anna" is not an address'),
        ('"+4915112345602"', "015112345602", "5: people.ben.phone: 15112345602 is not a telephone"),
        ('"+4915112345602"', '"015112345602"', '5: people.ben.phone: "015112345602" is not a'),
        ("{email: anna@example.org}", "{}", "4: people.anna: cannot be reached"),
        (TURN, TURN.replace("09:00", "09:00Z"), f"{SHIFT}: since 2027-01-04T09:00:00+00:00 has an"),
        (
            TURN,
            TURN.replace("}", ", evry: day}"),
            f"{SHIFT}.evry: is not a key; did you mean every",
        ),
        ("escalation-1", "nobody", f'14: {SECOND}: alertmanager.yml has no receiver "nobody"'),
        ("escalation-1", "sms", f"15: {SECOND}.receiver: no route of alertmanager.yml has the"),
        (
            "people: [anna], since",
            "people: [ben], since",
            '5: people.ben: "ben" cannot be reached by email_configs of robots/second',
        ),
        (
            "people: [anna], since: 2027-01-04T09:00",
            "people: [anna], since: 2027-03-24T09:00",
            f"14: {SECOND}: from 2027-03-22 Mon 13:00 CET until 2027-03-24 Wed 09:00 CET nobody is",
        ),
    ],
)
def test_a_wrong_value(errors, old, new, expected):
    assert old in BASE
    (found,) = (line for line in errors(BASE.replace(old, new)) if f":{expected}" in line)
    assert found.startswith("oncall.yml:")
    assert ";" in found  # then the way out


def test_gaps_and_overlaps_have_their_hours(errors):
    shifts = """
          - {people: [anna], since: 2027-01-04T08:00, hours: [Mon-Fri 08:00-20:00]}
          - {people: [ben], since: 2027-01-04T08:00, hours: [daily 19:00-08:00]}
"""
    before, _, after = BASE.partition("          - {people: [anna, ben]")
    found = errors(before.rstrip() + shifts + after.partition("\n")[2])
    more = ", and 18 more gaps or overlaps until 2027-04-12 Mon 14:00 CEST"
    days = (("22 Mon", ""), ("23 Tue", ""), ("24 Wed", more))
    assert found == [
        (
            f"oncall.yml:9: teams[robots].levels.first: from 2027-03-{day} 19:00 CET until "
            f"2027-03-{day} 20:00 CET anna and ben are all on call{more}; leave one of them"
        )
        for day, more in days
    ]


def test_zones_that_change_their_clocks_on_different_days_leave_a_gap(errors):
    """From New York's change until Berlin's, two weeks later, nobody has an hour of the morning."""
    shifts = """
          - {people: [anna], since: 2027-01-04T00:00, hours: [daily 08:00-20:00]}
          - {people: [ben], since: 2027-01-04T00:00, hours: [daily 14:00-02:00],
             time_zone: America/New_York}
"""
    before, _, after = BASE.partition("          - {people: [anna, ben]")
    found = errors(before.rstrip() + shifts + after.partition("\n")[2])
    place = "oncall.yml:9: teams[robots].levels.first: "
    assert (
        f"{place}from 2027-03-23 Tue 07:00 CET until 2027-03-23 Tue 08:00 CET nobody is on call; "
        "add a shift, hours or an override" in found
    )


DAY = "person: ben, start: 2027-03-24T09:00, end: 2027-03-25T09:00"


@pytest.mark.parametrize(
    ("override", "expected"),
    [
        (
            DAY.replace("-25T09", "-24T08") + ", level: first",
            '.end: "2027-03-24 08:00:00" is not after "2027-03-24 09:00:00"; let it end after its',
        ),
        (DAY, ": puts ben on call for robots/first, robots/second at once; add instead_of, or"),
        (f"{DAY}, level: frist", '.level: "frist" is unknown; did you mean first?'),
        (
            DAY.replace("09:00,", "09:00:30,") + ", level: first",
            ': "2027-03-24 09:00:30" has seconds; use a full minute',
        ),
        (
            DAY.replace("25T09:00", "25T09:00:30") + ", level: first",
            ': "2027-03-25 09:00:30" has seconds; use a full minute',
        ),
        (
            DAY.replace("-25T", "-24T") + ", level: first",
            '.end: "2027-03-24 09:00:00" is not after "2027-03-24 09:00:00"; let it end after its',
        ),
    ],
)
def test_a_wrong_override(errors, override, expected):
    (found,) = errors(f"{BASE}overrides:\n  - {{{override}}}\n")
    assert found.startswith(f"oncall.yml:19: overrides[0]{expected}")


def test_overrides_of_two_people_at_once_have_their_hours(errors):
    found = errors(
        BASE + "overrides:\n"
        "  - {person: anna, level: first, start: 2027-03-28T00:00, end: 2027-03-28T04:00}\n"
        "  - {person: ben, level: first, start: 2027-03-28T01:00, end: 2027-03-28T12:00}\n"
    )

    assert found == [
        (
            "oncall.yml:9: teams[robots].levels.first: from 2027-03-28 Sun 01:00 CET "
            "until 2027-03-28 Sun 04:00 CEST anna and ben are all on call; leave one of them"
        )
    ]


def test_a_team_behind_one_that_gets_all_alerts(errors):
    more = "  - {name: arms, matchers: [team = arms], levels: {first: {receiver: on-call, "
    more += "like: [email], shifts: [{people: [anna], since: 2027-01-04}]}}}\n"

    assert errors(BASE + more) == [
        (
            "oncall.yml:18: teams[arms]: gets no alerts: a team without matchers, before it, gets "
            "all; move the team without matchers to the end"
        )
    ]


@pytest.mark.parametrize("key", ["active_time_intervals: [working-hours]", "routes: []"])
def test_a_route_with_hours_of_its_own(errors, folder, key):
    config = folder / "alertmanager.yml"
    config.write_text(config.read_text().replace("on-call, cont", f"on-call, {key}, cont"))
    line = config.read_text()[: config.read_text().index(key)].count("\n") + 1

    assert errors(BASE) == [
        (
            f'alertmanager.yml:{line}: route: "{key.partition(":")[0]}" is not possible in the '
            'route to "on-call"; remove it: hours are in oncall.yml'
        )
    ]


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("a: [", "is not valid YAML"),
        ("- a", "has no route"),
        ("receivers: []", "has no route"),
        ("route: {group_interval: soon, routes: [{}]}", "'soon' is not a duration"),
    ],
)
def test_an_unusable_alertmanager_yml(errors, folder, text, what):
    (folder / "alertmanager.yml").write_text(text)
    found = errors(BASE)
    assert found[0].startswith("alertmanager.yml: ")
    assert what in "".join(found)


@pytest.mark.parametrize("text", ["", "[]", "people: 1", "a: b: c"])
def test_an_unusable_oncall_yml(errors, text):
    found = errors(text)
    assert found
    assert all(line.startswith("oncall.yml:") for line in found)
