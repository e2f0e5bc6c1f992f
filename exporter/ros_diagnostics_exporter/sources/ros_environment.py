"""What ROS reads of the environment before it starts: middleware, profiles, folder of logs, flags.

Knows no ROS, so that what is missing can be named before rclpy is imported.
"""

from __future__ import annotations

import ctypes
import logging
import re
import sys
from collections.abc import Iterable, Mapping, MutableMapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory, TemporaryFile
from typing import Any

RMW_VARIABLE = "RMW_IMPLEMENTATION"
# Fast DDS 3, which is Kilted's and later ones', and Fast DDS 2 each read the name of theirs only.
PROFILES_VARIABLES = ("FASTDDS_DEFAULT_PROFILES_FILE", "FASTRTPS_DEFAULT_PROFILES_FILE")
M_MMAP_THRESHOLD = -3  # of malloc.h
LARGE = 256 << 10  # bytes of a block
NOT_TO_BE_FOUND: Any = None  # in the place of a module: its import fails
QOS_VARIABLE = "RMW_FASTRTPS_USE_QOS_FROM_XML"
PROFILES_FILES = ("DEFAULT_FASTDDS_PROFILES.xml", "DEFAULT_FASTRTPS_PROFILES.xml")

log = logging.getLogger(__name__)


class RosMissingError(Exception):
    """What receives robots, ROS or zenoh, cannot be imported; the text says what to do."""


class MiddlewareMissingError(ImportError):
    """The middleware that the environment names is not installed; the text says what to do."""


def check_middleware(environment: Mapping[str, str]) -> None:
    """Raise an ImportError where ROS lacks the middleware: it would end the process with a riddle.

    Where nothing is known of the libraries' folders, nothing is said.
    """
    wanted = environment.get(RMW_VARIABLE, "")
    paths = environment.get("LD_LIBRARY_PATH", "").split(":")
    folders = [Path(sys.prefix, "lib"), *map(Path, filter(None, paths))]
    found = {path.stem.removeprefix("lib") for each in folders for path in each.glob("librmw_*.so")}
    if wanted and found and wanted not in found:
        raise MiddlewareMissingError(
            f"{RMW_VARIABLE} is {wanted!r}, and there is no lib{wanted}.so in "
            f"{', '.join(map(str, folders))}: unset it, or install that middleware into ROS "
            "(pip has rmw_fastrtps_cpp only)"
        )


def use_profiles(environment: MutableMapping[str, str], folder: Path) -> None:
    """Have Fast DDS keep less memory for each topic, unless the user has profiles of their own.

    To be called before a domain is joined: Fast DDS reads the file once, when it starts.

    Args:
        environment: Of this process; the file's path is added, under the name of each Fast DDS,
            and that ROS leaves to the file what it would set itself.
        folder: The working directory, where Fast DDS looks for a file, too.
    """
    named = next(filter(None, map(environment.get, PROFILES_VARIABLES)), None)
    if named is None and any((folder / name).exists() for name in PROFILES_FILES):
        return
    if named is None:
        environment.setdefault(QOS_VARIABLE, "1")
    for name in PROFILES_VARIABLES:
        environment[name] = named or str(Path(__file__).with_name("fastdds.xml"))


def free_large_blocks_at_once() -> None:
    """Have the C library return what large messages needed to the system (glibc).

    Else it keeps what is freed, from the first large block on, for further ones of that size.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(M_MMAP_THRESHOLD, LARGE)


def leave_out_generator() -> None:
    """Have ROS not import what generates the classes of messages, and a parser for that: 8 MB.

    Messages do without, as where it is not installed.
    """
    sys.modules.setdefault("rosidl_generator_py.generate_py_impl", NOT_TO_BE_FOUND)


def ros_distribution(environment: Mapping[str, str], packages: Iterable[str]) -> str:
    """The name of the ROS that is used, such as jazzy; "" where nothing says it.

    Args:
        environment: Of this process; a sourced ROS names itself.
        packages: The names of the Python packages that are installed; wheels of ROS name theirs.
    """
    found = (re.fullmatch(r"ros-(\w+)-rclpy", name) for name in packages)
    return environment.get("ROS_DISTRO") or next((each[1] for each in found if each), "")


def use_log_folder(environment: MutableMapping[str, str]) -> TemporaryDirectory[str] | None:
    """Have rcl log to a temporary folder where it cannot make its own: it would join no domain.

    Args:
        environment: Of this process; ``ROS_LOG_DIR`` is set where that is so.

    Returns:
        The temporary folder, which is removed with this object; None where rcl's own can be used.
    """
    try:
        folder = _log_folder(environment)
        folder.mkdir(parents=True, exist_ok=True)
        with TemporaryFile(dir=folder):
            return None
    except OSError as error:
        made = TemporaryDirectory(prefix="ros-diagnostics-exporter-")
        log.warning("ROS logs to %s, because its own folder cannot be used: %s", made.name, error)
        environment["ROS_LOG_DIR"] = made.name
        return made


def _log_folder(environment: Mapping[str, str]) -> Path:
    """Where rcl will log; OSError where it knows no folder."""
    if folder := environment.get("ROS_LOG_DIR"):
        return Path(folder).expanduser()
    if home := environment.get("ROS_HOME"):
        return Path(home, "log").expanduser()
    if home := environment.get("HOME"):
        return Path(home, ".ros", "log")
    raise OSError("HOME is not set")


def split_arguments(arguments: Sequence[str]) -> tuple[list[str], tuple[str, ...]]:
    """(our own arguments, those for ROS): the latter stand between ``--ros-args`` and ``--``.

    launch_ros appends them to every program that it starts; an enclave for SROS 2 is given so.
    """
    own: list[str] = []
    for_ros: list[str] = []
    into = own
    for argument in arguments:
        if argument == "--ros-args":
            into = for_ros
        into.append(argument)
        if argument == "--" and into is for_ros:
            into = own
    return own, tuple(for_ros)
