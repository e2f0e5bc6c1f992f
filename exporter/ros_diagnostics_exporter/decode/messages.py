"""Messages of any type: their definitions, where these are, and bytes -> fields.

A definition comes from the folder `msg` beside fleet.yml, from an installed package, or from what
a recording has of it. mcap-ros2-support decodes; it is imported once a topic is read.
"""

from __future__ import annotations

import json
import os
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

from ros_diagnostics_exporter.texts import one_line

RULE = "=" * 80
MAX_DEFINITION = 1 << 20  # bytes of a definition with all that it uses
MAX_ERROR = 200  # characters
_INTEGERS = {f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)}
_PRIMITIVES = _INTEGERS | {"bool", "byte", "char", "float32", "float64", "string", "wstring"}
_TYPE = re.compile(r"[A-Za-z][A-Za-z0-9_]*/msg/[A-Za-z][A-Za-z0-9]*")
_FIELD = re.compile(
    r"^\s*([A-Za-z][A-Za-z0-9_/]*)(?:<=[0-9]+)?(?:\[[^\]]*\])?\s+[a-z]", re.MULTILINE
)
_CONSTANT = re.compile(
    r"^\s*([a-z][a-z0-9]*)(?:<=[0-9]+)?\s+([A-Z][A-Z0-9_]*)\s*=\s*(.*?)\s*(?:#.*)?$", re.MULTILINE
)


class UnknownTypeError(Exception):
    """Nothing is known of a type; the text names it and says what to do."""


class UndecodableError(Exception):
    """The bytes are no message of the type."""


class MessageType:
    """The definition of one type: ``text`` has it and all that it uses, as recordings do.

    ``hash`` is what publishers of this very definition have; "" where it is not known.
    """

    def __init__(self, name: str, text: str, type_hash: str = "") -> None:
        self.name, self.text, self.hash = name, text, type_hash

    @cached_property
    def constants(self) -> Mapping[str, Mapping[str, str]]:
        """By short name of a type ("sensor_msgs/BatteryState") its constants: name -> text."""
        found = {}
        for name, text in _parts(self.name, self.text):
            found[name] = {each[2]: each[3].strip("\"'") for each in _CONSTANT.finditer(text)}
        return found

    @cached_property
    def _decode(self) -> Callable[[bytes], Any]:
        from mcap.records import Schema  # noqa: PLC0415 - only where a topic is read
        from mcap_ros2.decoder import DecoderFactory  # noqa: PLC0415

        schema = Schema(id=1, name=self.name, encoding="ros2msg", data=self.text.encode())
        made: Callable[[bytes], Any] | None = DecoderFactory().decoder_for("cdr", schema)
        if made is None:
            raise UnknownTypeError(f"the definition of {self.name} cannot be read")
        return made

    def decode(self, data: bytes) -> Any:
        """A serialized message as an object with its fields.

        Raises:
            UndecodableError: it is no such message.
            UnknownTypeError: the definition has what cannot be read.
        """
        try:
            return self._decode(data)
        except NotImplementedError as error:
            raise UnknownTypeError(f"{self.name} cannot be read: {one_line(str(error))}") from error
        except UnknownTypeError:
            raise
        except Exception as error:  # the library raises whatever its parts do
            why = one_line(f"{error}")[:MAX_ERROR] or type(error).__name__
            raise UndecodableError(f"is no {self.name}: {why}") from error


class MessageTypes:
    """The types that are known, by name; each is read when it is first asked for.

    ``folder`` is that beside fleet.yml.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self._folder = folder
        self._known: dict[str, MessageType] = {}

    def define(self, name: str, text: str) -> None:
        """Take the definition that a recording has of a type, with all that it uses."""
        self._known[name] = MessageType(name, text)

    def find(self, name: str) -> MessageType:
        """The type of this name.

        Raises:
            UnknownTypeError: there is no definition of it, or of what it uses, that can be read.
        """
        known = self._known.get(name)
        if known is None:
            try:
                known = self._known[name] = self._read(name)
            except (OSError, ValueError, LookupError) as error:
                raise UnknownTypeError(
                    f"the definition of {name} cannot be read: {error}"
                ) from error
        return known

    def _read(self, name: str) -> MessageType:
        if not _TYPE.fullmatch(name):
            raise UnknownTypeError(f"{name} is not the name of a type of messages")
        parts, waiting = dict[str, str](), [name]
        while waiting:
            wanted = waiting.pop()
            if wanted not in parts:
                parts[wanted] = self._file(wanted, name).read_text("utf-8", errors="replace")
                waiting += _used(wanted, parts[wanted])
            if sum(map(len, parts.values())) > MAX_DEFINITION:
                raise UnknownTypeError(f"the definition of {name} is longer than 1 MiB")
        text = parts.pop(name)
        used = (f"{RULE}\nMSG: {_short(each)}\n{part}\n" for each, part in parts.items())
        return MessageType(name, "\n".join((text, *used)), _hash(self._file(name, name), name))

    def _file(self, name: str, user: str) -> Path:
        """The file of a type, which ``user`` is or uses."""
        package, _, kind = name.split("/")
        found = (folder / f"{kind}.msg" for folder in self._folders(package))
        file = next((each for each in found if each.is_file()), None)
        if file is None:
            uses = "" if name == user else f", which {user} uses"
            raise UnknownTypeError(
                f"nothing is known of the type {name}{uses}: install its package, or put its "
                f"definition into msg/{package}/{kind}.msg beside fleet.yml"
            )
        return file

    def _folders(self, package: str) -> Iterator[Path]:
        if self._folder is not None:
            yield self._folder / package
        yield from (prefix / "share" / package / "msg" for prefix in _prefixes())


def _hash(file: Path, name: str) -> str:
    """That of a definition; "" where nobody has written it beside the file."""
    described = file.with_suffix(".json")
    if not described.is_file():
        return ""
    hashes = json.loads(described.read_bytes())["type_hashes"]
    return next((each["hash_string"] for each in hashes if each["type_name"] == name), "")


def _prefixes() -> Iterable[Path]:
    """Where packages are installed: by a sourced ROS, and by pip."""
    sourced = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    return map(Path, dict.fromkeys((*filter(None, sourced), sys.prefix)))


def _used(name: str, text: str) -> list[str]:
    """The types that a definition uses."""
    package = name.partition("/")[0]
    found = {each[1] for each in _FIELD.finditer(text)} - _PRIMITIVES
    return [_full("std_msgs/Header" if each == "Header" else each, package) for each in found]


def _full(name: str, package: str) -> str:
    parts = name.split("/")
    return f"{package if len(parts) == 1 else parts[0]}/msg/{parts[-1]}"


def _short(name: str) -> str:
    package, _, kind = name.split("/")
    return f"{package}/{kind}"


def _parts(name: str, text: str) -> Iterator[tuple[str, str]]:
    """The short name and text of each definition in what a recording has of a type."""
    first, *others = re.split("^={3,}$", text, flags=re.MULTILINE)
    yield _short(name), first
    for each in others:
        head, _, rest = each.strip().partition("\n")
        yield "/".join(_full(head.removeprefix("MSG:").strip(), "").split("/msg/")), rest
