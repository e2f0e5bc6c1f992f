"""Podman with its images in a folder, on a machine without systemd and with low limits; as root."""

import os
from pathlib import Path

from support import debian

SETTINGS = """\
[containers]
cgroups = "disabled"
log_driver = "k8s-file"
default_ulimits = ["nofile=4096:4096", "nproc=4096:4096"]
[engine]
cgroup_manager = "cgroupfs"
events_logger = "file"
"""
STORAGE = '[storage]\ndriver = "vfs"\ngraphroot = "{0}/images"\nrunroot = "{0}/run"\n'
DEBIAN = "localhost/debian:12"


def environment(folder: Path) -> dict[str, str]:
    """The environment of podman that keeps everything in ``folder``."""
    (folder / "containers.conf").write_text(SETTINGS)
    (folder / "storage.conf").write_text(STORAGE.format(folder))
    return os.environ | {
        "CONTAINERS_CONF": str(folder / "containers.conf"),
        "CONTAINERS_STORAGE_CONF": str(folder / "storage.conf"),
        "DISABLE_HC_SYSTEMD": "true",  # health checks by its timers
        "BUILDAH_ISOLATION": "chroot",
        # Each layer would be a copy of all files, as podman has no overlay here.
        "BUILDAH_LAYERS": "false",
    }


def import_debian(debian_base: Path, folder: Path, env: dict[str, str]) -> None:
    """Have an image `DEBIAN` that the Containerfile can be built on."""
    with debian.copied(debian_base, folder / "base") as base:
        debian.does(base, "apt-get install --quiet=2 --yes --no-install-recommends python3-venv")
        script = f"tar --directory {base} --create . | podman import - {DEBIAN}"
        debian.output(["bash", "-euo", "pipefail", "-c", script], 600, env)
