"""Reads Nagios' main, resource and object files into definitions, each line with its place.

Syntax: https://assets.nagios.com/downloads/nagioscore/docs/nagioscore/4/en/configobject.html and,
where that is silent, what xodtemplate.c of Nagios 4.4 does.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from ros_diagnostics_tools import limits

KINDS = frozenset(
    {
        *("host", "service", "hostgroup", "servicegroup", "command", "contact", "contactgroup"),
        *("timeperiod", "hostdependency", "servicedependency", "hostescalation"),
        *("serviceescalation", "hostgroupescalation", "hostextinfo", "serviceextinfo"),
    }
)
# Other spellings that Nagios takes -> the one used here.
ALIASES = {
    "normal_check_interval": "check_interval",
    "retry_check_interval": "retry_interval",
    "checks_enabled": "active_checks_enabled",
    "obsess_over_host": "obsess",
    "obsess_over_service": "obsess",
    "gd2_image": "statusmap_image",
    "host_groups": "hostgroups",
    "service_groups": "servicegroups",
    "contactgroups": "contact_groups",
    "hourly_value": "importance",
    "minimum_value": "minimum_importance",
    "execution_failure_options": "execution_failure_criteria",
    "notification_failure_options": "notification_failure_criteria",
}
# ... in services, dependencies and escalations only.
REFERENCE_ALIASES = {
    **dict.fromkeys(("host", "hosts", "master_host", "master_host_name"), "host_name"),
    **dict.fromkeys(("hostgroup", "hostgroups"), "hostgroup_name"),
    **dict.fromkeys(
        ("description", "master_description", "master_service_description"), "service_description"
    ),
    "dependent_host": "dependent_host_name",
    "dependent_description": "dependent_service_description",
    **dict.fromkeys(("dependent_hostgroup", "dependent_hostgroups"), "dependent_hostgroup_name"),
    **dict.fromkeys(
        ("dependent_servicegroup", "dependent_servicegroups"), "dependent_servicegroup_name"
    ),
}
GROUP_ALIASES = {"servicegroup": "servicegroup_name", "servicegroups": "servicegroup_name"}
INCLUDES = frozenset({"cfg_file", "cfg_dir", "include_file", "include_dir", "resource_file"})
NOT_FOLLOWED = "not followed: the folder that was given has the objects"
MOST_BYTES = 16 * 2**20  # of one file
MOST_FILES = 10_000

_HOURS = re.compile(r"\d+:\d+\s*-\s*\d+:\d+")


class NagiosError(Exception):
    """The files cannot be read as Nagios would; the text names file, line and way out."""


@dataclass(frozen=True)
class Directive:
    """One line; ``key`` in the spelling used here, ``written`` as in the file."""

    path: Path
    line: int
    kind: str
    owner: str
    key: str
    value: str
    written: str = ""

    @property
    def place(self) -> str:
        """``file:line``."""
        return f"{self.path}:{self.line}"


@dataclass
class Definition:
    """One ``define KIND { ... }``, as written."""

    kind: str
    path: Path
    line: int
    directives: list[Directive] = field(default_factory=list)

    def value(self, key: str) -> str:
        """The last value of a directive, as Nagios takes it; "" without one."""
        return next((each.value for each in reversed(self.directives) if each.key == key), "")


class Read(NamedTuple):
    """What all files say: the objects, and the lines of main and resource files.

    ``skipped`` are those of the lines that name files which were not read.
    """

    definitions: list[Definition]
    settings: list[Directive]
    skipped: frozenset[Directive] = frozenset()


def read(paths: list[Path]) -> Read:
    """Read main files (``nagios.cfg``), object files and folders of object files.

    Raises:
        NagiosError: a file is missing or is not what Nagios reads.
    """
    reader = _Reader()
    for path in paths:
        reader.read(path)
    return Read(reader.definitions, reader.settings, frozenset(reader.skipped))


class _Reader:
    def __init__(self) -> None:
        self.definitions: list[Definition] = []
        self.settings: list[Directive] = []
        self.skipped: list[Directive] = []
        self._done: set[Path] = set()
        self._folders: set[Path] = set()

    def read(self, path: Path) -> None:
        if path.is_dir():
            self._folder(path)
        elif _is_main(path):
            self._main(path)
        else:
            self._objects(path)

    def _folder(self, path: Path) -> None:
        """All files of objects in a folder; of a main file in it the settings, not the paths.

        Those paths are of the machine that the folder comes from.
        """
        if path.resolve() in self._folders:
            return
        self._folders.add(path.resolve())
        for each in sorted(path.iterdir()):
            if each.is_dir():
                self._folder(each)
            elif each.suffix == ".cfg" and not each.name.startswith("."):
                if not _has_settings(each):
                    self._objects(each)
                elif _is_main(each):
                    self._main(each, follow=False)
                else:
                    self._resources(each)

    def _main(self, path: Path, *, follow: bool = True) -> None:
        if not self._is_new(path):
            return
        for line, text in _lines(path):
            key, equals, value = (part.strip() for part in text.partition("="))
            if not equals:
                raise NagiosError(f"{path}:{line}: {text!r} is not a setting; write name=value")
            self.settings.append(Directive(path, line, "main", "", key, value, key))
            if key in INCLUDES and not follow:
                self.skipped.append(self.settings[-1])
            else:
                self._include(path, line, key, value)

    def _include(self, path: Path, line: int, key: str, value: str) -> None:
        if key not in INCLUDES:
            return
        target = _beside(path, value)
        if target is None:
            raise NagiosError(
                f"{path}:{line}: {key} {value} does not exist; correct the path, or give the "
                "folder of the object files instead of the main file"
            )
        if key == "resource_file":
            self._resources(target)
        elif key.endswith("_dir"):
            self._folder(target)
        else:
            self._objects(target)

    def _resources(self, path: Path) -> None:
        if not self._is_new(path):
            return
        for line, text in _lines(path):
            key, _, value = (part.strip() for part in text.partition("="))
            kind = "resource" if key.startswith("$") else "main"
            self.settings.append(Directive(path, line, kind, "", key, value, key))

    def _is_new(self, path: Path) -> bool:
        """Whether a file is read for the first time."""
        if path.resolve() in self._done:
            return False
        self._done.add(path.resolve())
        if len(self._done) > MOST_FILES:
            raise NagiosError(f"{path}: there are more than {MOST_FILES:,} files; give fewer")
        return True

    def _objects(self, path: Path) -> None:
        if not self._is_new(path):
            return
        current: Definition | None = None
        lines: list[tuple[int, str]] = []
        for line, text in _lines(path, comments=True):
            if match := re.match(r"define\s*([a-z]+)\s*\{?\s*(.*)", text):
                if current is not None:
                    raise NagiosError(
                        f"{path}:{line}: {current.kind} of line {current.line} has no }}"
                    )
                current, lines = _begin(path, line, match[1]), []
            elif current is None:
                key, _, value = text.partition("=")
                if not key.startswith("include_"):
                    raise NagiosError(f"{path}:{line}: {text!r} is outside of any definition")
                self.settings.append(Directive(path, line, "main", "", key, value.strip(), key))
                self._include(path, line, key, value.strip())
            elif text == "}":
                self.definitions.append(_finish(current, lines))
                current = None
            else:
                lines.append((line, text))
        if current is not None:
            raise NagiosError(f"{path}:{current.line}: {current.kind} has no closing }}")


def _beside(main: Path, value: str) -> Path | None:
    """The file or folder that a main file names; that of another machine is beside it."""
    parts = Path(value).parts
    rests = (main.parent.joinpath(*parts[begin:]) for begin in range(len(parts)))
    return next((each for each in rests if each.exists()), None)


def _is_main(path: Path) -> bool:
    """Whether a file is a main file: it has settings and no definitions."""
    found = [text for _, text in _lines(path)]
    return any(
        re.match(r"(cfg_file|cfg_dir|object_cache_file|log_file)\s*=", text) for text in found
    )


def _has_settings(path: Path) -> bool:
    """Whether a file has settings only, as main file, cgi.cfg and resource file have."""
    found = [text for _, text in _lines(path)]
    return bool(found) and all(re.match(r"[\w$.-]+\s*=", text) for text in found)


def _lines(path: Path, *, comments: bool = False) -> Iterator[tuple[int, str]]:
    """The lines that say something, stripped, continued ones joined; ``comments``: with ``;``."""
    try:
        text = limits.read(path, MOST_BYTES).decode("utf-8", "replace")
    except OSError as error:
        raise NagiosError(f"{path}: {error.strerror}; give a readable file") from None
    except limits.LimitError as error:
        raise NagiosError(f"{path}: {error}; give the files of Nagios") from None
    held, first = "", 0
    for number, raw in enumerate(text.splitlines(), 1):
        first = first if held else number
        held += raw.strip() if held else raw
        if held.endswith("\\") and not held.endswith("\\\\"):
            held = held[:-1]
            continue
        line, held = (_without_comment(held) if comments else held).strip(), ""
        if line and not line.startswith(("#", ";")):
            yield first, line


def _without_comment(line: str) -> str:
    return re.split(r"(?<!\\);", line, maxsplit=1)[0].replace("\\;", ";")


def _begin(path: Path, line: int, kind: str) -> Definition:
    if kind not in KINDS:
        raise NagiosError(
            f"{path}:{line}: {kind} is not an object of Nagios; known: {sorted(KINDS)}"
        )
    return Definition(kind, path, line)


def _finish(definition: Definition, lines: list[tuple[int, str]]) -> Definition:
    split = [(line, *_split(definition.kind, text)) for line, text in lines]
    keys = {_key(definition.kind, key): value for _, key, value in split}
    owner = _owner(definition.kind, keys)
    definition.directives = [
        Directive(
            definition.path, line, definition.kind, owner, _key(definition.kind, key), value, key
        )
        for line, key, value in split
    ]
    return definition


def _split(kind: str, text: str) -> tuple[str, str]:
    """Name and value; of a line with hours in a timeperiod: the days and the hours."""
    if kind == "timeperiod" and (match := _HOURS.search(text)):
        return " ".join(text[: match.start()].lower().split()), text[match.start() :].strip()
    name = re.split(r"\s", text, maxsplit=1)[0]
    return name, text[len(name) :].strip()


def _key(kind: str, key: str) -> str:
    if key.startswith("_"):
        return key.upper()  # custom variables ignore case
    if kind in ("hostdependency", "servicedependency", "hostescalation", "serviceescalation"):
        key = {**REFERENCE_ALIASES, **GROUP_ALIASES}.get(key, key)
    elif kind == "service":
        key = REFERENCE_ALIASES.get(key, key)
    return ALIASES.get(key, key)


def _owner(kind: str, values: dict[str, str]) -> str:
    """A name for people: that of the object, or of the template."""
    name = values.get(f"{kind}_name", "")
    if kind == "service":
        where = values.get("host_name") or values.get("hostgroup_name", "")
        name = "/".join(filter(None, (where, values.get("service_description", ""))))
    elif not name:
        keys = ("host_name", "hostgroup_name", "service_description", "dependent_host_name")
        name = "/".join(values[key] for key in keys if values.get(key))
    return name or (f"template {values['name']}" if "name" in values else "without a name")
