"""What is made once for the tests of packages: a Debian 12, and the Debian package."""

import shutil
import subprocess
from pathlib import Path

import pytest

from support import debian
from support.newcomer import IGNORED
from testbed.configuration import CHECKOUT


@pytest.fixture(scope="session")
def debian_base(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a minimal Debian 12: copy it."""
    return debian.made_once(tmp_path_factory, "debian-base", debian.debootstrap)


@pytest.fixture(scope="session")
def debian_package(tmp_path_factory: pytest.TempPathFactory, debian_base: Path) -> Path:
    """The .deb, built by packaging/build-deb in a Debian 12."""

    def make(folder: Path) -> None:
        with debian.copied(debian_base, folder / "builder") as builder:
            used_checkout(builder / "srv" / "checkout")
            debian.does(
                builder, "apt-get install --quiet=2 --yes --no-install-recommends git python3-venv"
            )
            debian.does(builder, "cd /srv/checkout && packaging/build-deb /srv", 1200)
            (package,) = (builder / "srv").glob("*.deb")
            package.rename(folder / package.name)

    (package,) = debian.made_once(tmp_path_factory, "debian-package", make).glob("*.deb")
    return package


def used_checkout(folder: Path) -> None:
    """A checkout of what is here, in which somebody has followed README: edited, with data."""
    shutil.copytree(CHECKOUT, folder, ignore=IGNORED, symlinks=True)
    for command in (
        ("init", "--quiet"),
        ("add", "--all"),
        ("-c", "user.name=a", "-c", "user.email=a@localhost", "commit", "--quiet", "-m", "all"),
    ):
        subprocess.run(["git", *command], cwd=folder, check=True)
    with (folder / "alertmanager" / "alertmanager.yml").open("a") as config:
        config.write(f"# {debian.PRIVATE}\n")
    for name in ("alertmanager/data/nflog", "prometheus/data/queries.active", "alertmanager/key"):
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(debian.PRIVATE)
