"""docs/install-container.md and compose.yaml: the image, built and run by podman.

Podman keeps its images in a folder of the test. Containers run in namespaces of the test: the only
network of their "host" is the loopback device.
"""

import json
import shlex
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from ros_diagnostics_exporter import __version__
from support import debian, podman
from support.newcomer import IGNORED, blocks
from testbed.configuration import CHECKOUT
from testbed.polling import until
from testbed.processes import Process

ABSENT = debian.why_not("podman", "curl", "ip")
PAGE = "docs/install-container.md"
NAME = "ros-diagnostics-exporter"
IMAGE = f"{NAME}:{__version__}"
ROBOTS = f"ros-diagnostics-virtual-robots:{__version__}"
FLEET = 'fleet: hall\ndiscovery: [{topic: "/{robot}/diagnostics_agg"}]\n'
# ./run test --all installs it there.
COMPOSE = Path(sys.prefix) / "deployment" / "bin" / "podman-compose"
HOST = """
ip link set lo up
mount -t cgroup2 cgroup2 /sys/fs/cgroup
echo ready
exec sleep infinity
"""

pytestmark = debian.marks(ABSENT)


class Host:
    """Where containers run, with a copy of the checkout as the working directory."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.checkout = folder / "checkout"
        shutil.copytree(CHECKOUT, self.checkout, ignore=IGNORED, symlinks=True)
        self.env = podman.environment(folder)
        namespaces = ["--mount", "--net", "--pid", "--fork", "--kill-child", "--mount-proc"]
        argv = ["unshare", *namespaces, "--", "sh", "-ec", HOST]
        self.process = Process("host", argv, None, folder / "host.log")

    def online(self, script: str, seconds: float = 1200.0) -> str:
        """Run commands with this machine's network; their output."""
        return self._run([], script, seconds)

    def does(self, script: str, seconds: float = 300.0) -> str:
        """Run commands on the host; their output."""
        children = Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children").read_text()
        enter = [f"--target={children.strip()}", "--mount", "--net", "--pid", "--"]
        return self._run(["nsenter", *enter], script, seconds)

    def _run(self, enter: list[str], script: str, seconds: float) -> str:
        script = f"cd {self.checkout}\n{script}"
        argv = [*enter, "bash", "-euo", "pipefail", "-c", script]
        return debian.output(argv, seconds, self.env)

    def ready(self, *, up: bool = True) -> None:
        """Wait until the exporter of a container answers, or does not any more."""
        url = "http://localhost:9877/-/ready"
        command = f"curl --silent --output /dev/null {url} && echo up || echo down"
        wanted = "up\n" if up else "down\n"
        until(lambda: self.does(command) == wanted, self._containers, 60, every=0.5)

    def until_output(self, script: str, text: str) -> None:
        """Repeat commands until their output has the text."""
        found = ""

        def has_it() -> bool:
            nonlocal found
            found = self.does(f"{{ {script.strip()}\n}} || true")
            return text in found

        until(has_it, lambda: f"{text!r} from {script!r}: {found}\n{self._containers()}", 60, 0.5)

    def _containers(self) -> str:
        return self.does(f"podman ps --all; podman logs {NAME} || true")


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory, debian_base: Path) -> Iterator[Host]:
    """A host with an image of the page's name, built by the page's command on a Debian 12."""
    folder = tmp_path_factory.mktemp("containers")
    host = Host(folder)
    try:
        podman.import_debian(debian_base, folder, host.env)
        (build,) = blocks(PAGE, "## Build")
        on_debian = f"podman build --build-arg BASE={podman.DEBIAN}"
        host.online(build.replace("podman build", on_debian, 1))
        host.online(f"podman tag {IMAGE} localhost/kept")
        (robots,) = blocks(PAGE, "## Virtual robots")[:1]
        host.online(robots.replace("podman build", on_debian, 1))
        host.process.start()
        host.process.wait_for_output("ready")
        yield host
    finally:
        host.process.kill()
        shutil.rmtree(folder)


@pytest.fixture
def host(built: Host) -> Iterator[Host]:
    """The host with its image, and without containers and volumes."""
    built.does(f"podman tag localhost/kept {IMAGE}")
    yield built
    built.does("podman rm --all --force --volumes --time=0; podman volume prune --force")


def test_the_image_serves_a_fleet_keeps_its_state_and_stops(host: Host):
    check, start, look, reload = blocks(PAGE, "## Run")
    (config := host.checkout / "config").mkdir()
    (config / "fleet.yml").write_text(FLEET)
    assert "fleet hall" in host.does(check)
    host.does(start)
    assert shlex.split(start)[-1] == IMAGE
    host.does(f"! podman run --rm --entrypoint sh {IMAGE} -c 'command -v virtual-robots'")
    host.does(f"podman run --detach --name robots --network=host {ROBOTS} --robots 2")
    metrics = "curl --silent localhost:9877/metrics"
    host.until_output(metrics, 'ros_diagnostics_robot_up{fleet="hall",robot="robot_2"} 1')
    host.until_output(look, "2 OK")
    status = host.does(f"podman exec {NAME} cat /proc/1/status")
    assert "Uid:\t64877\t64877\t64877\t64877" in status
    assert "CapEff:\t0000000000000000" in status

    (config / "fleet.yml").write_text(FLEET.replace("hall", "warehouse"))
    host.does(reload)
    host.until_output(metrics, 'ros_diagnostics_robot_up{fleet="warehouse",robot="robot_1"} 1')

    # SIGTERM; the next one knows the robots from the volume before it receives anything.
    # The robots are removed on return, which a container with --rm is not after `podman stop`.
    host.does(f"podman rm --force --time=10 --volumes robots; podman stop --time=60 {NAME}")
    (ended,) = inspected(host, NAME)
    assert ended["State"]["ExitCode"] == 0
    host.ready(up=False)
    host.does(f"podman start {NAME}")
    host.until_output(metrics, 'ros_diagnostics_robot_up{fleet="warehouse",robot="robot_1"} 0')

    remove = blocks(PAGE, "## Remove")[0].splitlines()
    assert [remove[0]] == blocks(PAGE, "## Upgrade")[0].splitlines()
    host.does("\n".join(remove))
    left = "podman ps --all --noheading --format '{{.Names}} {{.Command}} {{.Status}}'"
    assert host.does(f"{left}; podman volume ls --quiet") == ""
    assert IMAGE not in host.does("podman images --format '{{.Repository}}:{{.Tag}}'")


@pytest.mark.skipif(not ABSENT and not COMPOSE.exists(), reason="not installed: podman-compose")
def test_compose_starts_the_exporter_and_its_robots(host: Host):
    services = yaml.safe_load((CHECKOUT / "compose.yaml").read_text())["services"]
    compose = f"{COMPOSE} --in-pod=false"
    host.does(f"{compose} up --detach --no-build exporter robots")
    found = 'ros_diagnostics_robot_up{fleet="demo",robot="robot_10"} 1'
    host.until_output("curl --silent localhost:9877/metrics", found)
    exporter, robots = inspected(host, "--latest"), inspected(host, "ros-diagnostics_exporter_1")
    for each in (*exporter, *robots):
        assert each["HostConfig"]["ReadonlyRootfs"]
        assert each["EffectiveCaps"] in (None, [])
        assert "no-new-privileges" in str(each["HostConfig"]["SecurityOpt"])
    test = services["exporter"]["healthcheck"]["test"]
    assert test[0] == "CMD"
    host.does(f"podman exec ros-diagnostics_exporter_1 {shlex.join(test[1:])}")
    host.does(f"{compose} down")
    assert host.does("podman ps --all --quiet") == ""


def inspected(host: Host, container: str) -> Any:
    return json.loads(host.does(f"podman container inspect {container}"))
