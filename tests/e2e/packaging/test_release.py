"""``packaging/release``: what a release consists of, with the same bytes each time."""

import hashlib
import io
import json
import os
import subprocess
import sys
import tarfile
from pathlib import Path

import pytest

from ros_diagnostics_exporter import __version__
from support import debian, podman
from support.called import called
from testbed.configuration import CHECKOUT

IMAGE = os.geteuid() == 0  # another user cannot make the base that it is built on: all but that
ABSENT = debian.why_not("podman") if IMAGE else None

pytestmark = debian.marks(ABSENT)


def test_a_commit_is_built_twice_with_the_same_bytes(
    tmp_path: Path, request: pytest.FixtureRequest
):
    source = tmp_path / "source"
    subprocess.run(["git", "clone", "--quiet", CHECKOUT, source], check=True)
    (source / "README.md").write_text("not committed, so not released")
    env = dict(os.environ)
    if IMAGE:
        env = podman.environment(tmp_path)
        podman.import_debian(request.getfixturevalue("debian_base"), tmp_path, env)
    env |= {"PATH": f"{Path(sys.prefix) / 'bin'}:{os.environ['PATH']}", "BASE": podman.DEBIAN}
    command = [
        source / "packaging" / "release",
        "--twice",
        *["--no-image"] * (not IMAGE),
        tmp_path / "dist",
    ]
    called(command, env=env)

    built = {each.name: each.read_bytes() for each in (tmp_path / "dist").iterdir()}
    sums = dict(map(reversed, map(str.split, built.pop("SHA256SUMS").decode().splitlines())))
    assert sums == {name: hashlib.sha256(data).hexdigest() for name, data in built.items()}
    if IMAGE:
        name = f"ros-diagnostics-exporter-{__version__}.oci.tar"
        assert built.pop(name)
        loaded = debian.output(["podman", "load", "--input", tmp_path / "dist" / name], 300, env)
        assert f"ros-diagnostics-exporter:{__version__}" in loaded
    assert {name.replace(__version__, "V") for name in built} == {
        "CHANGES-V.md",
        "ros-diagnostics-dashboards-V.tar.gz",
        "ros-diagnostics-exporter-V.cdx.json",
        "ros-diagnostics-exporter-V.tgz",
        "ros-diagnostics-exporter_V-1_amd64.deb",
        "ros-diagnostics-mixin-V.tar.gz",
        "ros-diagnostics-site-V.tar.gz",
        "ros_diagnostics_exporter-V-py3-none-any.whl",
        "ros_diagnostics_exporter-V.tar.gz",
        "ros_diagnostics_virtual_robots-V-py3-none-any.whl",
        "ros_diagnostics_virtual_robots-V.tar.gz",
    }
    for name, files in {
        "ros-diagnostics-exporter-V.tgz": {"Chart.yaml", "files/rules.json"},
        "ros-diagnostics-mixin-V.tar.gz": {"mixin.libsonnet", "rules.json"},
        "ros-diagnostics-dashboards-V.tar.gz": {"ros-diagnostics-fleet.json"},
        "ros-diagnostics-site-V.tar.gz": {"index.html", "alerts/RosDiagnosticsRobotSilent.html"},
    }.items():
        archive = name.replace("V", __version__)
        folder = archive.partition(f"-{__version__}")[0]
        assert {f"{folder}/{each}" for each in files} <= regular_files(built[archive])
    assert b"not committed" not in b"".join(built.values())
    assert b"### Added" in built[f"CHANGES-{__version__}.md"]
    bill = json.loads(built[f"ros-diagnostics-exporter-{__version__}.cdx.json"])
    lock = (CHECKOUT / "packaging" / "locks" / "exporter.txt").read_text()
    assert bill["metadata"]["component"]["name"] == "ros-diagnostics-exporter"
    named = {f"{each['name']}=={each['version']}" for each in bill["components"]}
    assert named == {line.split()[0] for line in lock.splitlines() if "==" in line}


def regular_files(archive: bytes) -> set[str]:
    with tarfile.open(fileobj=io.BytesIO(archive)) as opened:
        assert all(each.isreg() or each.isdir() for each in opened)
        return {each.name for each in opened if each.isreg()}
