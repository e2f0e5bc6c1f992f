"""packaging/locks pin what pyproject.toml asks for; `./run lock` writes them."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from testbed.configuration import CHECKOUT

tomllib = pytest.importorskip("tomllib", reason="needs Python 3.11")

LOCKS = CHECKOUT / "packaging" / "locks"
HASHED = ("build", "demo", "docs", "exporter")
STALE = "'./run lock' writes packaging/locks"


def pins(lock: str) -> dict[str, list[Requirement]]:
    """The pinned versions of each package: several where they differ by Python."""
    lines = (LOCKS / f"{lock}.txt").read_text().replace("\\\n", "").splitlines()
    found: dict[str, list[Requirement]] = {}
    for line in lines:
        pin = Requirement(line.partition(" --hash")[0])
        found.setdefault(canonicalize_name(pin.name), []).append(pin)
    return found


def wanted(path: Path, *, groups: bool) -> Iterator[Requirement]:
    document: dict[str, Any] = tomllib.loads(path.read_text())
    project = document["project"]
    lists = [project["dependencies"], *project["optional-dependencies"].values()]
    if groups:
        lists.extend(document["dependency-groups"].values())
    for each in lists:
        yield from map(Requirement, each)


@pytest.mark.parametrize("project", ["pyproject.toml", "sim/pyproject.toml"])
def test_what_is_asked_for_is_pinned_to_versions_that_fit(project: str):
    found = pins("versions")
    for each in wanted(CHECKOUT / project, groups=project == "pyproject.toml"):
        name = canonicalize_name(each.name)
        assert name in found, f"{each}: {STALE}"
        for pin in found[name]:
            (version,) = pin.specifier
            assert version.version in each.specifier, f"{pin} is not {each}: {STALE}"


@pytest.mark.parametrize("lock", HASHED)
def test_what_is_installed_by_hash_has_the_same_versions(lock: str):
    text = (LOCKS / f"{lock}.txt").read_text()
    versions = pins("versions")
    assert "://" not in text  # no index: that of who installs
    for name, found in pins(lock).items():
        assert {str(each.specifier) for each in found} <= {
            str(each.specifier) for each in versions[name]
        }, STALE
    entries = re.findall(r"^\w\S*==.*(?:\n .*)*", text, re.MULTILINE)
    assert len(entries) == sum(map(len, pins(lock).values()))
    assert all("--hash=sha256:" in each for each in entries)


def test_package_and_image_have_all_extras_but_the_demo():
    extras = tomllib.loads((CHECKOUT / "pyproject.toml").read_text())["project"][
        "optional-dependencies"
    ]
    demo = {canonicalize_name(Requirement(each).name) for each in extras.pop("demo")}
    needed = {
        canonicalize_name(Requirement(each).name) for wanted in extras.values() for each in wanted
    }
    assert needed <= pins("exporter").keys()
    assert demo - needed
    assert not (demo - needed) & pins("exporter").keys()
