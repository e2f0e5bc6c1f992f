"""Packaging: the wheel and the sdist, the systemd unit, the Containerfile, compose.yaml."""

import os
import re
import shlex
import shutil
import sys
import venv
from pathlib import Path
from typing import Any

import pytest
import yaml

from ros_diagnostics_exporter import __version__
from support.called import called
from support.newcomer import blocks
from testbed import domains, http, ports
from testbed.polling import until
from testbed.processes import Process

ROOT = Path(__file__).parents[3]
ROLE = ROOT / "packaging" / "ansible" / "roles" / "ros_diagnostics_exporter"
UNIT = ROOT / "packaging" / "ros-diagnostics-exporter.service"


def run(*command: str | Path, **options: Any) -> str:
    ended = called(command, timeout=280, **options)
    return ended.stdout + ended.stderr


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("kind", ["*.whl", "*.tar.gz"])
def test_what_is_built_serves_a_fleet_from_an_empty_environment(tmp_path, kind):
    """Everything needed at run time is in the wheel, and in the sdist, or a dependency."""
    venv.create(tmp_path / "builder", with_pip=True)
    builder = tmp_path / "builder" / "bin" / "python"
    run(builder, "-m", "pip", "install", "--quiet", "build")
    for each in (ROOT, ROOT / "sim"):
        run(builder, "-m", "build", "--outdir", tmp_path / each.name, each)  # wheel from sdist
    (built,) = (tmp_path / ROOT.name).glob(kind)
    (simulator,) = (tmp_path / "sim").glob(kind)
    venv.create(tmp_path / "empty", with_pip=True)
    bin_ = tmp_path / "empty" / "bin"
    run(bin_ / "pip", "install", "--quiet", f"{built}[ros]", cwd=tmp_path)
    assert not (bin_ / "virtual-robots").exists()
    run(bin_ / "pip", "install", "--quiet", simulator, cwd=tmp_path)
    address = f"127.0.0.1:{ports.free_port()}"
    with domains.lease() as domain:
        (tmp_path / "fleet.yml").write_text(
            "fleet: hall\n"
            f'discovery: [{{topic: "/{{robot}}/diagnostics_agg", domain_ids: [{domain}]}}]\n'
        )
        environment = domains.environment(domain)
        robots = [bin_ / "virtual-robots", "--robots", "2", "--domain-id", str(domain)]
        exporter = [
            *(bin_ / "ros-diagnostics-exporter", "--config.file", tmp_path / "fleet.yml"),
            *("--web.listen-address", address, "--storage.path", tmp_path / "state"),
        ]
        running = [
            Process("robots", robots, environment, tmp_path / "robots.log"),
            Process("exporter", exporter, environment, tmp_path / "exporter.log"),
        ]
        try:
            for each in running:
                each.start()
            until(lambda: served(address) == {"robot_1", "robot_2"}, running[1].describe)
            assert "openapi" in http.get_json(address, "/api/v1/openapi.json")
            status = run(bin_ / "ros-diagnostics", "status", "--url", f"http://{address}")
            assert "2 OK" in status
            check = [bin_ / "check_ros_diagnostics", "-H", "robot_1", "--url", f"http://{address}"]
            assert run(*check).startswith("OK - ")
        finally:
            for each in running:
                each.stop()


def served(address: str) -> set[str]:
    try:
        robots = http.get_json(address, "/api/v1/fleet")["robots"]
    except http.Unanswered:
        return set()
    return {robot["robot"] for robot in robots if robot["up"]}


@pytest.mark.slow
def test_a_package_with_another_hash_than_the_locks_is_refused(tmp_path):
    lock = (ROOT / "packaging" / "locks" / "build.txt").read_text()
    options = ["--quiet", "--no-deps", "--require-hashes", "--dest", tmp_path, "--requirement"]
    download = [sys.executable, "-m", "pip", "download", *options, tmp_path / "lock.txt"]
    (tmp_path / "lock.txt").write_text(lock)
    run(*download)

    (tmp_path / "lock.txt").write_text(re.sub(r"(sha256:)[0-9a-f]{2}", r"\g<1>00", lock))
    assert "DO NOT MATCH THE HASHES" in called(download, code=1).stderr


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="no systemd here")
def test_systemd_accepts_the_unit_and_rates_it_secure(tmp_path):
    unit = tmp_path / UNIT.name
    unit.write_text(UNIT.read_text().replace("/opt/ros-diagnostics-exporter/bin/", "/bin/true "))
    assert run("systemd-analyze", "verify", unit) == ""
    report = run("systemd-analyze", "security", "--offline=yes", UNIT)
    found = re.search(r"Overall exposure level for \S+: ([\d.]+)", report)
    assert found is not None
    assert float(found[1]) < 2.0


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="no systemd here")
def test_systemd_accepts_the_socket_of_the_page_for_the_unit(tmp_path):
    (text,) = blocks("docs/deployment.md", "### Socket activation")
    unit, sock = tmp_path / UNIT.name, tmp_path / UNIT.with_suffix(".socket").name
    unit.write_text(UNIT.read_text().replace("/opt/ros-diagnostics-exporter/bin/", "/bin/true "))
    sock.write_text(text)
    assert run("systemd-analyze", "verify", sock, unit) == ""
    sock.write_text(text.replace("ListenStream", "Listen"))
    with pytest.raises(AssertionError, match="Unit has no Listen setting"):
        run("systemd-analyze", "verify", sock, unit)


def test_the_unit_and_the_containerfile_start_what_the_wheel_installs():
    started = re.search(r"^ExecStart=\S*/(\S+) ", UNIT.read_text(), re.MULTILINE)
    containerfile = (ROOT / "packaging" / "Containerfile").read_text()
    entry = re.search(r'ENTRYPOINT \["(\S+)"\]', containerfile)
    scripts = re.findall(r"^(\S+) = \"\w+\.", (ROOT / "pyproject.toml").read_text(), re.MULTILINE)
    assert started is not None
    assert entry is not None
    assert {started[1], entry[1], "check_ros_diagnostics"} <= set(scripts)
    assert "virtual-robots" not in scripts
    for copied in re.findall(r"^COPY (?!--from)(.+) \S+$", containerfile, re.MULTILINE):
        assert all((ROOT / name).exists() for name in copied.split())


def test_the_unit_names_documentation_that_the_package_has_and_bounds_its_memory():
    unit = UNIT.read_text()
    (page,) = re.findall(r"^Documentation=file:///usr/share/doc/\S+/(\S+)\.gz$", unit, re.MULTILINE)
    build = (ROOT / "packaging" / "build-deb").read_text()
    assert re.search(rf"for page in .*\b{re.escape(page)}\b", build)
    assert re.search(r"^MemoryMax=\d+G$", unit, re.MULTILINE)


def test_the_containers_user_and_group_exist_and_its_base_is_pinned_by_digest():
    containerfile = (ROOT / "packaging" / "Containerfile").read_text()
    user = re.search(r"^USER (\d+):(\d+)$", containerfile, re.MULTILINE)
    assert user is not None
    assert f"groupadd --system --gid {user[2]} " in containerfile
    assert f"--uid {user[1]} --gid {user[2]} " in containerfile
    assert re.search(r"^ARG BASE=\S+/python@sha256:[0-9a-f]{64}$", containerfile, re.MULTILINE)


def test_ansible_validates_a_fleet_beside_the_folders_that_it_names(tmp_path):
    tasks = yaml.safe_load((ROLE / "tasks" / "main.yml").read_text())
    (validate,) = (each["ansible.builtin.copy"].get("validate") for each in tasks[2:3])
    etc = tmp_path / "etc"
    (etc / "robots").mkdir(parents=True)
    (etc / "robots" / "one.yml").write_text("name: turtlebot\ntopic: /diagnostics_agg\n")
    copied = tmp_path / "ansible" / "source"  # where Ansible has the file before it is validated
    copied.parent.mkdir()
    copied.write_text("fleet: hall\nrobots_folder: robots\n")
    # As Ansible runs it: without a shell.
    command = shlex.split(validate.replace("/etc/ros-diagnostics-exporter", str(etc)) % copied)
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    report = run(*command, env=os.environ | {"PATH": path})

    assert "turtlebot" in report
    copied.write_text("fleet: [1\n")
    called(command, code=2, env=os.environ | {"PATH": path})
    assert [each.name for each in etc.iterdir()] == ["robots"]


def test_the_play_names_the_debian_package_as_dpkg_does():
    control = (ROOT / "packaging" / "debian" / "control").read_text()
    (version,) = re.findall(r"^Version: (.+)$", control, re.MULTILINE)
    name = f"_{version.replace('@VERSION@', __version__)}_amd64.deb\n"
    for path in (ROOT / "docs" / "install-ansible.md", ROLE / "defaults" / "main.yml"):
        assert re.findall(r"_[0-9][^_]*_amd64\.deb\n", path.read_text()) == [name]


def test_compose_mounts_existing_files_and_pins_every_image():
    services = yaml.safe_load((ROOT / "compose.yaml").read_text())["services"]
    assert len(services) == 7
    for service in services.values():
        tag = service["image"].rpartition(":")[2]
        assert re.fullmatch(r"v?\d+\.\d+\.\d+", tag), service["image"]
        for volume in service.get("volumes", ()):
            source = volume.partition(":")[0]
            assert not source.startswith("./") or (ROOT / source).exists(), volume
        assert service["cap_drop"] == ["ALL"]


@pytest.mark.parametrize(
    ("service", "programs"),
    [
        ("prometheus", ("prometheus",)),
        ("alertmanager", ("alertmanager", "prometheus-alertmanager")),
        ("node-exporter", ("node_exporter", "prometheus-node-exporter")),
        ("blackbox-exporter", ("blackbox_exporter", "prometheus-blackbox-exporter")),
        ("exporter", (str(Path(sys.executable).parent / "ros-diagnostics-exporter"),)),
        ("robots", (str(Path(sys.executable).parent / "virtual-robots"),)),
    ],
)
def test_the_programs_know_the_flags_that_compose_gives_them(service, programs):
    found = yaml.safe_load((ROOT / "compose.yaml").read_text())["services"][service]
    command = [*found.get("entrypoint", ()), *found["command"]]
    flags = {part.partition("=")[0] for part in command if part.startswith("--")}
    assert flags
    program = next(filter(None, map(shutil.which, programs)))
    help_ = run(program, "--help")
    assert not {flag for flag in flags if not re.search(rf"{re.escape(flag)}\b", help_)}


def test_promtool_accepts_the_configuration_that_compose_mounts(tmp_path):
    shutil.copytree(ROOT / "prometheus", tmp_path, dirs_exist_ok=True)
    shutil.copy(ROOT / "packaging" / "compose" / "prometheus.yml", tmp_path / "prometheus.yml")
    run("promtool", "check", "config", tmp_path / "prometheus.yml")


def test_the_exporter_accepts_the_fleet_that_compose_mounts():
    command = Path(sys.executable).parent / "ros-diagnostics-exporter"
    path = ROOT / "packaging" / "compose" / "fleet.yml"
    assert "42" in run(command, "--config.check", "--config.file", path)
