"""docs/install-debian.md: the package on a Debian 12 of its own that has booted with systemd."""

import json
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from support import debian
from support.called import called
from support.debian import Machine
from support.newcomer import blocks
from testbed.configuration import CHECKOUT
from testbed.processes import Process

ABSENT = debian.why_not("dpkg-deb")
NAME = "ros-diagnostics-exporter"
PAGE = "docs/install-debian.md"
# What any program changes: systemd's own state, logs, caches, and the database of the packages.
CHANGING = ("/var/log", "/var/cache", "/var/lib/systemd/catalog", "/var/lib/dpkg", "/root")
# The package does not have them.
ROBOTS = (
    *("env", "PYTHONPATH=/srv/sim", "PYTHONDONTWRITEBYTECODE=1", f"/opt/{NAME}/bin/python", "-c"),
    "from virtual_robots.cli import main; main()",
)
ZENOH = (
    "zenoh: {routers: [tcp/127.0.0.1:7447]}\\n"
    "robots: [{name: agv, zenoh: customer/agv, namespace: /agv}]\\n"
)

pytestmark = debian.marks(ABSENT)


@pytest.fixture
def machine(tmp_path: Path, debian_base: Path, debian_package: Path) -> Iterator[Machine]:
    """A Debian that has systemd and what the package depends on, and no more."""
    depends = debian.output(["dpkg-deb", "--field", debian_package, "Depends"], 60).strip()
    with debian.copied(debian_base, tmp_path / "debian") as root:
        options = "--quiet=2 --yes --no-install-recommends"
        debian.does(root, f"apt-get install {options} systemd-sysv procps")
        debian.does(root, f"apt-get satisfy {options} '{depends}'")
        (root / "srv" / "packages" / "dist").mkdir(parents=True)  # as build-deb leaves it
        shutil.copy(debian_package, root / "srv" / "packages" / "dist")
        shutil.copytree(CHECKOUT / "sim", root / "srv" / "sim")
        with debian.booted(root, tmp_path / "debian.log") as booted:
            yield booted


def test_installed_used_upgraded_and_removed_without_a_trace(
    machine: Machine, start_process: Callable[..., Process]
):
    install, change, look = blocks(PAGE, "## Install")
    (upgrade,) = blocks(PAGE, "## Upgrade")
    (remove, purge) = blocks(PAGE, "## Remove")[0].splitlines()
    before = traces(machine)

    machine.does(f"cd /srv/packages; {yes(install)}", 600)
    assert machine.does("systemctl is-active ros-diagnostics-exporter") == "active\n"
    assert machine.does("systemctl is-enabled ros-diagnostics-exporter") == "enabled\n"
    assert machine.does("systemd-analyze verify ros-diagnostics-exporter.service") == ""
    machine.does("! command -v virtual-robots")
    process = machine.does(f"ps -o user:32= -p $(systemctl show --property MainPID --value {NAME})")
    assert process.strip() == "ros-diagnostics"
    state = machine.does("stat --format '%U %G %a' /var/lib/ros-diagnostics-exporter")
    assert state == "ros-diagnostics ros-diagnostics 700\n"
    assert machine.does(f"{NAME} --version").startswith(f"{NAME} ")
    conffiles = machine.does(f"dpkg-query --show --showformat '${{Conffiles}}' {NAME}").split()
    assert set(conffiles[::2]) == {f"/etc/{NAME}/fleet.yml", f"/etc/default/{NAME}"}

    # Flags of the administrator, and two robots of another user.
    machine.does(f"sed -i 's/^ARGS=.*/ARGS=--log.format=json/' /etc/default/{NAME}")
    assert "active (running)" in machine.does(look)
    assert "--log.format=json" in machine.does(f"systemctl status {NAME}")
    start_process("robots", [*machine.enter, *ROBOTS, "--robots", "2"])
    up = 'ros_diagnostics_robot_up\\{fleet="robots".*robot="robot_2".*\\} 1'
    machine.until_output(scrape("/metrics"), up)
    check = "check_ros_diagnostics -H robot_1"
    machine.until_output(check, "^OK - ")

    # Another fleet, read while it runs.
    machine.does(f"sed -i 's/^fleet: .*/fleet: warehouse/' /etc/{NAME}/fleet.yml; {change}")
    machine.until_output(scrape("/metrics"), 'ros_diagnostics_robot_up\\{fleet="warehouse"')
    machine.does(f"! runuser -u nobody -- ls /var/lib/{NAME}")

    # A robot behind zenoh: nothing has to be installed for it.
    machine.does(f"printf '{ZENOH}' >>/etc/{NAME}/fleet.yml; {change}")
    machine.until_output(scrape("/metrics"), 'robot="agv",reason="domain_unreachable"\\} 1')

    # The files for Prometheus.
    (folder,) = blocks(PAGE, "## Add to Prometheus")
    copy = blocks("docs/existing-servers.md", "## Prometheus")[0]
    machine.does(f"mkdir /etc/prometheus\n{folder}{copy}test -f /etc/prometheus/*/faults.yml")
    machine.does("rm -r /etc/prometheus")

    # The same version again: what is edited stays, the service is another process.
    pid = machine.does(f"systemctl show --property MainPID --value {NAME}")
    machine.does(f"cd /srv/packages; {yes(upgrade, '--reinstall')}", 600)
    assert machine.does(f"systemctl show --property MainPID --value {NAME}") != pid
    machine.until_output(scrape("/metrics"), 'ros_diagnostics_robot_up\\{fleet="warehouse"')

    machine.does(yes(remove))
    assert machine.does(f"systemctl is-active {NAME} || true") == "inactive\n"
    machine.does(f"grep warehouse /etc/{NAME}/fleet.yml && ls /var/lib/{NAME}/exporter.db")
    machine.does(yes(purge))
    after = traces(machine)
    assert {what: after[what] ^ before[what] for what in after} == {what: set() for what in after}


def test_a_wrong_fleet_stops_the_service_and_not_the_installation(machine: Machine):
    install = blocks(PAGE, "## Install")[0]
    machine.does(f"mkdir /etc/{NAME}; echo 'fleet: [1' >/etc/{NAME}/fleet.yml")
    machine.does(f"cd /srv/packages; {yes(install)}", 600)
    machine.until_output(f"systemctl show --property ExecMainStatus {NAME}", "=2$")
    assert machine.does(f"systemctl is-active {NAME} || true") == "failed\n"
    assert "fleet.yml" in machine.does(f"journalctl --unit {NAME}")


def test_the_state_of_the_unit_with_a_dynamic_user_goes_on(machine: Machine):
    """Until version 0.1 the unit had `DynamicUser=yes`."""
    machine.does(f"cd /srv/packages; {yes(blocks(PAGE, '## Install')[0])}", 600)
    dropin = f"/etc/systemd/system/{NAME}.service.d"
    restart = f"systemctl daemon-reload; systemctl restart {NAME}"
    old = "[Service]\\nUser=\\nDynamicUser=yes\\n"
    machine.does(f"mkdir {dropin}; printf '{old}' >{dropin}/old.conf; {restart}")
    database = f"/var/lib/{NAME}/exporter.db"
    assert machine.does(f"readlink /var/lib/{NAME}") == f"private/{NAME}\n"
    inode = machine.does(f"stat --format %i {database}")
    machine.does(f"rm -r {dropin}; {restart}")
    new = machine.does(f"stat --format '%F %U' /var/lib/{NAME}")
    assert new == "directory ros-diagnostics\n"
    assert machine.does(f"stat --format %i {database}") == inode


def test_the_documentation_is_in_it_with_its_search(debian_package: Path):
    listed = debian.output(["dpkg-deb", "--contents", debian_package], 60)
    for page in ("index.html", "alerts/RosDiagnosticsRobotSilent.html", "search/search_index.js"):
        assert f"/usr/share/doc/{NAME}/html/{page}\n" in listed


def test_nothing_that_is_not_committed_is_in_it(debian_package: Path, tmp_path: Path):
    """It is built in a checkout with edited files, untracked ones and folders of data."""
    debian.output(["dpkg-deb", "--extract", debian_package, tmp_path], 120)
    share = tmp_path / "usr" / "share" / NAME
    packed = {path.relative_to(share).as_posix() for path in share.rglob("*") if path.is_file()}

    listed = ["git", "ls-files", "prometheus", "alertmanager", "grafana"]
    tracked = called(listed, cwd=CHECKOUT)
    assert packed
    assert packed <= set(tracked.stdout.split())
    assert not [each for each in packed if debian.PRIVATE in (share / each).read_text()]


@pytest.mark.skipif(shutil.which("lintian") is None, reason="not installed: lintian")
def test_lintian_has_nothing_to_say(debian_package: Path):
    command = ["lintian", "--allow-root", "--fail-on", "error,warning", str(debian_package)]
    assert called(command, timeout=1200).stdout == ""


def yes(command: str, *options: str) -> str:
    """The command without questions; what somebody has edited stays (dpkg's default)."""
    kept = "-o Dpkg::Options::=--force-confold"
    more = " ".join(("apt-get --yes", kept, *options))
    return f"export DEBIAN_FRONTEND=noninteractive; {command.replace('apt-get', more, 1)}"


def scrape(path: str) -> str:
    return (
        "python3 -c 'import sys, urllib.request as u; "
        'sys.stdout.write(u.urlopen("http://localhost:9877" + sys.argv[1]).read().decode())\' '
        f"{path}"
    )


def traces(machine: Machine) -> dict[str, set[str]]:
    """All files, users, groups, packages and units: what an installation could leave."""
    pruned = " -o ".join(f"-path {each}" for each in CHANGING)
    files = machine.does(f"find / -xdev \\( {pruned} \\) -prune -o -print")
    units = json.loads(machine.does("systemctl list-unit-files --output json"))
    return {
        "files": set(files.splitlines()),
        "users": set(machine.does("cat /etc/passwd /etc/group /etc/*shadow").splitlines()),
        "packages": set(machine.does("dpkg --get-selections; ls /var/lib/dpkg/info").splitlines()),
        "units": {each["unit_file"] for each in units},
    }
