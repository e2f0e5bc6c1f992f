"""Machines for which the package index has no ROS: all else that is pinned has wheels for them."""

import sys
from collections.abc import Iterator
from importlib.metadata import requires
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from support.called import called
from testbed.configuration import CHECKOUT

tomllib = pytest.importorskip("tomllib", reason="needs Python 3.11")

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]

LOCK = CHECKOUT / "packaging" / "locks" / "versions.txt"
WITH_ROS = {"ros", "demo"}  # extras
GLIBC = ("manylinux_2_28", "manylinux_2_17", "manylinux2014")  # that of Debian 11 and later


def machine(python: str, architecture: str) -> dict[str, str]:
    """What markers of requirements ask about it."""
    return {
        "python_version": python,
        "python_full_version": f"{python}.0",
        "platform_machine": architecture,
        "platform_system": "Linux",
        "sys_platform": "linux",
        "implementation_name": "cpython",
        "platform_python_implementation": "CPython",
    }


def asked() -> Iterator[Requirement]:
    """What the project asks for, without ROS."""
    project = tomllib.loads((CHECKOUT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    for of_one in (
        project["dependencies"],
        *(extras[each] for each in extras.keys() - WITH_ROS),
    ):
        yield from map(Requirement, of_one)


def needed(environment: dict[str, str]) -> set[str]:
    """The names of all packages that a machine needs, by what is installed here says of itself."""
    waiting, found = [*asked()], dict[str, frozenset[str]]()
    while waiting:
        one = waiting.pop()
        name, extras = canonicalize_name(one.name), frozenset(one.extras)
        if name in found and extras <= found[name]:
            continue
        if one.marker is not None and not one.marker.evaluate(environment | {"extra": ""}):
            continue
        found[name] = extras | found.get(name, frozenset())
        waiting += [
            Requirement(f"{each.name}{'[' + ','.join(each.extras) + ']' if each.extras else ''}")
            for each in map(Requirement, requires(name) or ())
            if each.marker is None
            or any(each.marker.evaluate(environment | {"extra": of}) for of in ("", *extras))
        ]
    return set(found)


def pins(environment: dict[str, str]) -> Iterator[str]:
    names = needed(environment)
    for line in LOCK.read_text().splitlines():
        pin = Requirement(line)
        if canonicalize_name(pin.name) in names and (
            pin.marker is None or pin.marker.evaluate(environment)
        ):
            yield f"{pin.name}{pin.specifier}"


@pytest.mark.parametrize(
    ("python", "architecture"), [("3.14", "x86_64"), ("3.14", "aarch64"), ("3.12", "aarch64")]
)
def test_what_is_pinned_has_wheels(tmp_path: Path, python: str, architecture: str):
    found = [*pins(machine(python, architecture))]
    assert {each.partition("=")[0] for each in found} >= {"pydantic", "google-re2", "eclipse-zenoh"}
    assert not [each for each in found if each.startswith("ros-")]
    (tmp_path / "pins.txt").write_text("\n".join(found))
    platforms = [f"--platform={each}_{architecture}" for each in GLIBC]
    abis = [f"--abi={each}" for each in (f"cp{python.replace('.', '')}", "abi3", "none")]
    command = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps"]
    command += ["--only-binary=:all:", f"--python-version={python}", *platforms, *abis]

    called([*command, "--dest", tmp_path / "wheels", "--requirement", tmp_path / "pins.txt"])

    assert len([*(tmp_path / "wheels").glob("*.whl")]) == len(found)
