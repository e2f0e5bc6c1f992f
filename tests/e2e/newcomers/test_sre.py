"""An SRE adds robots to servers that exist: docs/deployment.md, then docs/existing-servers.md."""

from pathlib import Path

import pytest

from support.existing_site import ALERTMANAGER, OWN_RULES, PROMETHEUS, added
from support.newcomer import Newcomer, blocks, newcomer

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1800)]

PAGE = "docs/existing-servers.md"
FLEET = """\
fleet: hall
profiles: {default: {stale_after: 5s, confirm_after: 2s}}
discovery:
  - {topic: "/{robot}/diagnostics_agg", labels: {site: north, team: arms}}
"""


def has_servers(person: Newcomer) -> None:
    """What the site had before: both servers with jobs, rules and routes of others."""
    etc = person.folder / "etc"
    for name in ("prometheus", "alertmanager"):
        (etc / name / "own").mkdir(parents=True)
    (etc / "prometheus" / "own" / "rules.yml").write_text(OWN_RULES)
    prometheus = PROMETHEUS.format(
        interval="15s", prometheus="localhost:9090", alertmanager="localhost:9093"
    )
    (etc / "prometheus" / "prometheus.yml").write_text(prometheus)
    alertmanager = ALERTMANAGER.format(smtp="localhost:25")
    (etc / "alertmanager" / "alertmanager.yml").write_text(alertmanager)
    for name in ("prometheus", "alertmanager"):
        flag = {"prometheus": "--web.enable-lifecycle", "alertmanager": "--cluster.listen-address="}
        person.starts(
            name, f"cd ~ && exec {name} --config.file=/etc/{name}/{name}.yml {flag[name]}"
        )
        port = {"prometheus": 9090, "alertmanager": 9093}[name]
        person.until_output(f"curl -s localhost:{port}/-/ready", "Ready|OK")


def commands(heading: str) -> list[str]:
    """The page's commands below a heading."""
    return [each for each in blocks(PAGE, heading) if not each.startswith(("#", "-", " "))]


def test_the_first_fault_is_mailed_to_those_of_the_robots(tmp_path: Path):
    with newcomer(tmp_path) as person:
        person.has_a_mail_server()
        has_servers(person)
        from_index, wheel, _conda = blocks("docs/deployment.md", "## Install")
        person.does(from_index, 1200)
        person.does(wheel, 600)
        person.does("/opt/ros-diagnostics-exporter/bin/pip install ./sim", 600)
        config = tmp_path / "etc" / "ros-diagnostics-exporter"
        config.mkdir()
        (config / "fleet.yml").write_text(FLEET)
        bin_ = Path("/opt/ros-diagnostics-exporter/bin")
        person.starts_unit(bin_, person.home)
        person.starts("robots", f"exec {bin_}/virtual-robots --robots 2")
        person.until_output(f"{bin_}/ros-diagnostics status", "2 OK")

        for name, reload in (
            ("Prometheus", "curl -s -X POST localhost:9090/-/reload"),
            ("Alertmanager", "curl -s -X POST localhost:9093/-/reload"),
        ):
            copy, check = commands(f"## {name}")
            person.does(copy)
            file = tmp_path / "etc" / name.lower() / f"{name.lower()}.yml"
            file.write_text(added(file.read_text(), file.name))
            person.does(check)
            person.does(reload)
        settled = "promtool query instant http://localhost:9090 ros_diagnostics_exporter_settled"
        person.until_output(settled, "=> 1")

        person.does(f"{bin_}/virtual-robots fault robot_1 'Motor 1' error")
        person.until_mail("** PROBLEM ** hall/robot_1 Motor 1 is CRITICAL")
        (mail,) = (each for each in person.mails() if "robot_1" in each["Subject"])
        assert mail["To"] == "robots@localhost"
