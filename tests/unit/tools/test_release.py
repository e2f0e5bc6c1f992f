"""`packaging/release` where the image cannot be built: it says so, and all else is there.

What takes minutes is a fake: the Debian package, hatchling, the SBOM.
"""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

from ros_diagnostics_exporter import __version__
from support.called import called
from support.newcomer import IGNORED
from testbed.configuration import CHECKOUT

BUILD_DEB = """#!/bin/sh
set -eu
site=$(mktemp -d)
mkdir -p "$site/DEBIAN" "$site/usr/share/doc/ros-diagnostics-exporter/html"
echo page >"$site/usr/share/doc/ros-diagnostics-exporter/html/index.html"
cat >"$site/DEBIAN/control" <<END
Package: fake
Version: VERSION
Architecture: all
Maintainer: nobody
Description: a package
END
dpkg-deb --root-owner-group --build "$site" "$1" >/dev/null
rm -r "$site"
"""
PROGRAMS = {
    "hatchling": "exit 0",
    "cyclonedx-py": 'while [ "$1" != --output-file ]; do shift; done; echo "{}" >"$2"',
    "podman": 'echo "registry: no such host" >&2; exit 125',
}
BUILT = (
    "CHANGES-V.md",
    "SHA256SUMS",
    "ros-diagnostics-dashboards-V.tar.gz",
    "ros-diagnostics-exporter-V.cdx.json",
    "ros-diagnostics-exporter-V.tgz",
    "ros-diagnostics-mixin-V.tar.gz",
    "ros-diagnostics-site-V.tar.gz",
)

pytestmark = pytest.mark.skipif(shutil.which("dpkg-deb") is None, reason="needs dpkg-deb")


@pytest.fixture
def source(tmp_path: Path) -> Path:
    """A repository of what is here, with a package that is built at once."""
    folder = tmp_path / "source"
    shutil.copytree(CHECKOUT, folder, ignore=IGNORED, symlinks=True)
    (folder / "packaging" / "build-deb").write_text(BUILD_DEB.replace("VERSION", __version__))
    git = ["git", "-c", "user.name=n", "-c", "user.email=n@localhost"]
    for command in ("init --quiet", "add --all", "commit --quiet --no-verify --message all"):
        subprocess.run([*git, *command.split()], cwd=folder, check=True)
    return folder


def release(source: Path) -> subprocess.CompletedProcess[str]:
    programs = source.parent / "bin"
    programs.mkdir()
    for name, text in PROGRAMS.items():
        (programs / name).write_text(f"#!/bin/sh\n{text}\n")
        (programs / name).chmod(0o755)
    return called(
        [source / "packaging" / "release", source / "dist"],
        code=1,
        env=os.environ | {"PATH": f"{programs}:{os.environ['PATH']}"},
    )


def test_an_image_that_cannot_be_built_is_named_and_stops_nothing_else(source: Path):
    done = release(source)

    assert "registry: no such host" in done.stderr
    assert done.stderr.splitlines()[-1].startswith("the image is missing, all else is in ")
    names = {each.name.replace(__version__, "V") for each in (source / "dist").iterdir()}
    assert names >= set(BUILT)
    assert not [name for name in names if name.endswith(".oci.tar")]
