"""`ros-diagnostics nagios import` reads Nagios' files as the distribution's Nagios does."""

import re
import shutil
from pathlib import Path

import pytest
import yaml

from ros_diagnostics_exporter.config.fleet import Source
from ros_diagnostics_exporter.config.load import load
from ros_diagnostics_tools.nagios.importer.convert import FLEET, REPORT, ImportOptions, convert
from ros_diagnostics_tools.nagios.importer.files import Definition, read
from ros_diagnostics_tools.nagios.importer.inheritance import Templates
from ros_diagnostics_tools.nagios.importer.ledger import ImportLedger
from ros_diagnostics_tools.nagios.importer.routes import NOBODY, ROUTES
from ros_diagnostics_tools.nagios.importer.site import Site
from support.called import called
from support.nagios_program import files, installed

SITE = Path(__file__).parents[1] / "data/nagios"
SAMPLE = Path("/etc/nagios4/objects")  # of the package nagios4-common
KEYS = ("check_command", "max_check_attempts", "retry_interval", "check_interval", "check_period")
LISTS = ("contacts", "contact_groups", "notification_options")
# Services of the sample run these; Debian has them in packages of their own.
PLUGINS = ("check_ping", "check_ssh", "check_http", "check_nt", "check_hpjd", "check-host-alive")

pytestmark = pytest.mark.slow


def own_site(folder: Path) -> Path:
    shutil.copytree(SITE, folder, dirs_exist_ok=True)
    main = folder / "nagios.cfg"
    main.write_text(re.sub("log_file=.*\n", "", main.read_text()) + files(folder))
    return main


def sample_site(folder: Path) -> Path:
    """The distribution's sample objects, and a robot with a ROS check on its local host."""
    assert SAMPLE.is_dir(), "nagios4-common is not installed; ./run test --all installs it"
    shutil.copytree(SAMPLE, folder / "objects")
    missing = "".join(
        f"define command {{\ncommand_name {name}\ncommand_line /bin/true\n}}\n" for name in PLUGINS
    )
    robot = (
        "define command {\ncommand_name check_ros\ncommand_line /opt/check_ros -H $HOSTADDRESS$ "
        "-N $ARG1$\n}\ndefine service {\nuse local-service\nhost_name localhost\n"
        "service_description Motors\ncheck_command check_ros!Motor\n}\n"
    )
    (folder / "objects/robot.cfg").write_text(missing + robot)
    (folder / "nagios.cfg").write_text(files(folder) + f"cfg_dir={folder}/objects\n")
    return folder / "nagios.cfg"


@pytest.fixture(params=[own_site, sample_site])
def main(request, tmp_path) -> Path:
    return request.param(tmp_path)


def precached(main: Path) -> dict[tuple[str, ...], Definition]:
    """The objects as Nagios resolves them."""
    called([installed(), "-vp", main])
    found = read([main.parent / "objects.precache"]).definitions
    return {name_of(each.kind, each.value): each for each in found}


def name_of(kind: str, value) -> tuple[str, ...]:
    if kind == "service":
        return kind, value("host_name"), value("service_description")
    return kind, value(f"{kind}_name")


def site_of(main: Path) -> Site:
    """The objects as the import resolves them."""
    ledger = ImportLedger()
    things: dict[str, list] = {}
    for thing in Templates(read([main]).definitions, ledger).things():
        things.setdefault(thing.kind, []).append(thing)
    return Site(ledger, {}, things)


def test_hosts_and_services_are_resolved_as_nagios_does(main):
    site = site_of(main)
    site.index_services()
    theirs = precached(main)

    ours = {name_of("host", each.get): (each, None) for each in site.all("host")}
    for service in site.services:
        ours["service", service.host.get("host_name"), service.name] = (service.thing, service.host)
    assert {key for key in theirs if key[0] in ("host", "service")} == ours.keys()
    for key, (thing, host) in ours.items():
        assert resolved(thing.get) == resolved(theirs[key].value, thing.get), key
        assert recipients(thing, host) == listed(theirs[key].value), key


def resolved(value, given=None) -> dict[str, str | float]:
    """The values that are given; Nagios' own defaults are not compared."""
    found = {}
    for key in KEYS:
        if (given or value)(key):
            text = value(key)
            found[key] = float(text) if re.fullmatch(r"[\d.]+", text) else text
    return found


def recipients(thing, host) -> tuple[set[str], ...]:
    """Contacts and groups, from the host where a service has none; options where given."""
    named = any(key in thing for key in LISTS[:2])
    source = thing if named or host is None else host
    return tuple(set(source.list(key)) for key in LISTS[:2])


def listed(value) -> tuple[set[str], ...]:
    return tuple({each for each in value(key).split(",") if each} for key in LISTS[:2])


def test_a_contact_without_options_is_notified_of_nothing_as_in_nagios(tmp_path):
    main = own_site(tmp_path)
    contacts = tmp_path / "objects/robots/contacts.cfg"
    lines = contacts.read_text().splitlines()
    contacts.write_text("\n".join(each for each in lines if "notification_options" not in each))

    theirs = [each for key, each in precached(main).items() if key[0] == "contact"]
    options = (f"{kind}_notification_options" for kind in ("host", "service"))
    assert {each.value(key) for each in theirs for key in options} == {"n"}
    made = convert([main], ImportOptions("hall"))
    assert {each["name"] for each in yaml.safe_load(made.texts[ROUTES])["receivers"]} == {NOBODY}
    reasons = "has no (host|service)_notification_options, and then Nagios notifies it of no"
    assert len(re.findall(reasons, made.texts[REPORT])) >= len(theirs)


def test_groups_have_the_members_that_nagios_finds(main):
    site = site_of(main)
    theirs = {
        key[1]: set(filter(None, each.value("members").split(",")))
        for key, each in precached(main).items()
        if key[0] == "hostgroup"
    }

    assert {name: set(members) for name, members in site.members("host").items()} == theirs


def test_the_conversion_is_a_valid_fleet(main):
    made = convert([main], ImportOptions("hall"))

    (main.parent / FLEET).write_text(made.texts[FLEET])
    robots = [
        each for each in load(main.parent / FLEET).robots if each.source is not Source.QUERIES
    ]
    assert len(robots) == made.robots >= 1
    for definition in read([main]).definitions:
        for each in definition.directives:
            assert f"{each.place}: " in made.texts[REPORT]
