"""What is no longer notified is in sight; what has a query or threshold here is written."""

import json
import re
from pathlib import Path

import pytest
import yaml

from ros_diagnostics_exporter.config.load import load
from ros_diagnostics_tools.nagios.importer import plugin
from ros_diagnostics_tools.nagios.importer.computers import QUERIES, asked
from ros_diagnostics_tools.nagios.importer.convert import FLEET, REPORT
from ros_diagnostics_tools.nagios.importer.convert import QUERIES as QUERIES_FILE
from ros_diagnostics_tools.nagios.importer.routes import ROUTES

CHECKOUT = Path(__file__).parents[4]
TEXT = (CHECKOUT / "tests/data/nagios-computers.cfg").read_text()
SHIPPED = yaml.safe_load((CHECKOUT / "docs/examples/queries/queries.d/hosts.yml").read_text())


@pytest.fixture
def folder(tmp_path):
    """Where the import writes."""
    return tmp_path / "new"


@pytest.fixture
def imports(folder, tmp_path, run):
    """A function (text of a site, words, code=1): what the import prints."""

    def imports(text=TEXT, *words, code=1):
        (tmp_path / "site.cfg").write_text(text)
        command = ("nagios", "import", str(tmp_path / "site.cfg"), "--force", "--to", str(folder))
        return run(*command, *words, code=code).out

    return imports


def parts(folder):
    """The lines of each part of the report, without their places."""
    found = {}
    for text in (folder / REPORT).read_text().rstrip().split("\n\n"):
        title, *lines = text.splitlines()
        name, count = re.fullmatch(r"(.*) \((\d+)\):", title).groups()
        assert len(lines) == int(count)
        found[name] = [re.sub(r"^\S+:\d+: ", "", line) for line in lines]
    return found


def test_what_is_no_longer_notified_comes_first_and_is_the_exit_code(imports, folder):
    out, found = imports(), parts(folder)
    assert [*found] == [
        *("No longer notified", "Notified otherwise", "For your information", "Translated")
    ]
    assert [
        line.partition(": add")[0].partition(": nobody")[0] for line in found[next(iter(found))]
    ] == [
        "contact ann: pager +491701234567",
        "host printer: host_name printer: printer",
        "service amr2/disk: check_command check_disk!2000!1000: amr2",
        "service amr2/weird: check_command check_weird: amr2",
    ]
    assert "4 no longer notified, 4 notified otherwise, " in out


def test_a_site_that_loses_no_notification_exits_with_0(imports):
    text = TEXT
    for part in ("pager +491701234567", "host_name printer\n"):
        text = text.replace(part, "alias x\n")
    for name in ("weird", "disk!2000!1000"):
        text = text.replace(f"check_command check_{name}", "check_command check_ssh")
    assert "0 no longer notified" in imports(text, code=0)


def test_the_counts_are_in_json(imports):
    found = json.loads(imports(TEXT, "--output", "json"))
    assert (found["no_longer"], found["otherwise"]) == (4, 4)


def test_thresholds_of_a_key_are_those_of_a_value(imports, folder):
    imports()
    (profile,) = load(folder / FLEET).profiles.values()
    (value,) = profile.values
    assert [(each.bound, each.severity, each.value) for each in value.thresholds] == [
        ("low", "warning", 20),
        ("low", "critical", 10),
    ]
    assert (value.component.pattern, value.key.pattern) != ("", "")
    assert {each.name for each in profile.checks} == {"all", "motors", "battery"}


@pytest.mark.parametrize(
    ("warning", "critical", "expected"),
    [
        ("20:", "10:", {"low": {"warning": 20, "critical": 10}}),
        ("80", "90", {"high": {"warning": 80, "critical": 90}}),
        ("~:80", "", {"high": {"warning": 80}}),
        ("10:80", "5:", {"low": {"warning": 10, "critical": 5}, "high": {"warning": 80}}),
        ("10:", "20:", None),
        ("@10:20", "", None),
        ("20%", "", None),
        ("1.2.3", "", None),
        ("", "", None),
    ],
)  # fmt: skip
def test_ranges_of_plugins(warning, critical, expected):
    assert plugin.thresholds(warning, critical) == expected


@pytest.mark.parametrize(
    "arguments", ["-w 20: -c 10:", "-k Charge -w 10: -c 20:", "-k Charge -w 5,4"]
)
def test_thresholds_that_cannot_be_written_are_no_longer_notified(imports, folder, arguments):
    imports(TEXT.replace("-k Charge -w 20: -c 10:", arguments))
    lines = parts(folder)["No longer notified"]
    assert any(f"arguments: {arguments}: write thresholds" in line for line in lines)
    load(folder / FLEET)


def test_the_queries_are_the_shipped_ones():
    shipped = {each["component"]: each for each in SHIPPED}
    for of_check in QUERIES.values():
        for query in of_check:
            there = dict(shipped[query["component"]])
            if "thresholds" not in query:
                del there["thresholds"]
            assert query == there


def test_queries_have_the_thresholds_and_robots_of_the_checks(imports, folder):
    imports()
    queries = {(each.group, each.component): each for each in load(folder / FLEET).queries}
    names = [f"load {each}m" for each in (1, 5, 15)]
    assert queries.keys() == {
        *(("Host", each) for each in ("ssh", "disk {mountpoint}", *names)),
        *(("Host like amr2", each) for each in names),
    }
    assert "robot=~" not in queries["Host", "ssh"].expr
    assert 'robot=~"amr1"' in queries["Host", "load 1m"].expr
    assert [each.value for each in queries["Host", "load 5m"].thresholds] == [4, 6]
    assert queries["Host", "load 5m"].confirm_after == 120
    assert yaml.safe_load((folder / QUERIES_FILE).read_text())


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("/p/check_ping -H a -w 100,20% -c 500,60%", ("ping", "100,20%", "500,60%", False)),
        ("/p/check-host-alive", ("ping", "", "", False)),
        ("/p/check_ssh 10.0.0.1", ("ssh", "", "", False)),
        ("/p/check_load --warning=5,4,3 --critical=10,6,4", ("load", "5,4,3", "10,6,4", False)),
        ("/p/check_nrpe -H a -c check_hda1", ("disk", "20%", "10%", True)),
        ("/p/check_by_ssh -H a -C '/p/check_users -w 5 -c 9'", ("users", "5", "9", False)),
        ("/p/check_nrpe -H a -c check_own", None),
        ("/p/check_procs -w 1:1 -C roscore", None),
        ("/p/check_something", None),
        ("", None),
    ],
)
def test_what_a_command_line_asks(line, expected):
    found = asked(line)
    assert (None if found is None else tuple(found)) == expected


@pytest.mark.parametrize("kind", ["host", "service"])
def test_a_contact_without_options_is_notified_of_nothing(imports, folder, kind):
    imports(re.sub(rf"  {kind}_notification_options .*\n", "", TEXT))
    below = [
        each["matchers"]
        for route in yaml.safe_load((folder / ROUTES).read_text())["routes"]
        for each in route.get("routes", [])
    ]
    of_kind = {"host": "RobotSilent", "service": "ComponentCritical"}
    asked = {name: any(of_kind[name] in str(each) for each in below) for name in of_kind}
    assert asked == {name: name != kind for name in of_kind}
    reason = f"has no {kind}_notification_options, and then Nagios notifies it of no {kind}"
    assert any(reason in line for line in parts(folder)["For your information"])


def test_links_of_hosts_and_services_are_those_of_the_robot(imports, folder):
    of_host = "notes_url http://wiki/amr1"
    assert of_host in TEXT
    text = TEXT.replace(of_host, "notes_url http://wiki/$HOSTNAME$\n  action_url /cgi/$HOSTNAME$")
    text = text.replace(
        "service_description motors",
        "service_description motors\n  action_url https://$HOSTADDRESS$/$SERVICEDESC$",
    )
    imports(text)
    amr1, amr2 = load(folder / FLEET).robots
    motors = "motors action_url"
    of_amr1 = {"notes_url": "http://wiki/amr1", motors: "https://10.0.0.1/motors"}
    assert dict(amr1.links) == of_amr1
    assert dict(amr2.links) == {motors: "https://10.0.0.2/motors"}
    found = parts(folder)
    (lost,) = (each for each in found["For your information"] if "_url" in each)
    assert lost.startswith(
        'host amr1: action_url /cgi/$HOSTNAME$: "/cgi/amr1" is not the URL of a page'
    )
    assert sum("links[" in each for each in found["Translated"]) == 2


@pytest.mark.parametrize(
    ("line", "is_lost"),
    [
        ("/usr/bin/mail $CONTACTEMAIL$", False),
        ("/usr/bin/slack 'robots'", True),
        ("/usr/bin/pager $CONTACTADDRESS1$", False),
    ],
)
def test_a_way_of_notification_of_its_own_is_no_longer_notified(imports, folder, line, is_lost):
    imports(TEXT.replace("/usr/bin/sms $CONTACTPAGER$", line))
    lost = [line for line in parts(folder)["No longer notified"] if line.startswith("contact")]
    assert bool(lost) is is_lost
