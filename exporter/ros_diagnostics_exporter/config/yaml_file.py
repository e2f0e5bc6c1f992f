"""One YAML file -> plain data, and the line of each key.

Finds what is wrong with the file itself: encoding, syntax, size, duplicate keys, tags, aliases that
expand without end. Knows nothing of fleets.

Scalars are read by YAML 1.2's core schema, as editors do: PyYAML reads YAML 1.1, where `on`, `no`,
`1:30` and `2026-01-01` are not text. Source: https://yaml.org/spec/1.2.2/#103-core-schema

ruamel.yaml knows YAML 1.2, and would not make this shorter: its loader in Python, the one that
keeps places, takes five to seven times as long as libyaml. The other one is libyaml, reads dates
and `1_000` too, and ends at the first key that is given twice.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from ros_diagnostics_exporter.config.errors import Finding
from ros_diagnostics_exporter.files import read_regular

KeyPath = tuple[str | int, ...]

MAX_BYTES = 8 * 1024 * 1024
CORE_COLLECTIONS = ("tag:yaml.org,2002:map", "tag:yaml.org,2002:seq")
NO_TAG = "remove the tag"
MAX_DEPTH = 32  # of nesting; fleet.yml needs eight, and each level costs stack
MAX_VALUES = 200_000  # and keys, after expansion of aliases
_TAG = "tag:yaml.org,2002:"

# Tag, pattern of the text, the characters that it can begin with.
_RESOLVERS: tuple[tuple[str, str, str], ...] = (
    ("null", r"~|null|Null|NULL|", "~nN"),
    ("bool", r"true|True|TRUE|false|False|FALSE", "tTfF"),
    ("int", r"[-+]?[0-9]{1,18}|0o[0-7]{1,20}|0x[0-9a-fA-F]{1,15}", "-+0123456789"),
    (
        "float",
        (
            r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?"
            r"|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)"
        ),
        "-+.0123456789",
    ),
    ("merge", r"<<", "<"),
)


class UnusableError(Exception):
    """Nothing of the file can be used; `found` is (line or None, what is wrong, remedy)."""

    def __init__(self, line: int | None, what: str, remedy: str) -> None:
        self.found = (line, what, remedy)


class Document(NamedTuple):
    """A file's content; ``lines`` has the line (from 1) of each key and list entry.

    The places in ``invalid`` have a problem already; ignore what ``data`` has there.
    """

    path: Path
    data: Any
    lines: Mapping[KeyPath, int]
    invalid: frozenset[KeyPath] = frozenset()

    def line(self, path: KeyPath) -> int:
        """The line of `path`, or of the innermost part of it that is in the file."""
        while path and path not in self.lines:
            path = path[:-1]
        return self.lines.get(path, 1)

    def key(self, path: KeyPath) -> str:
        """`path` for people: `robots[robot_1].domain_id`, list entries by their name."""
        text, inner = "", self.data
        for part in path:
            inner = inside(inner, (part,))
            if isinstance(part, int):
                text += f"[{_entry_name(inner) or part}]"
            else:
                text += f".{part}" if text else part
        return text

    def problem(self, path: KeyPath, what: str, remedy: str) -> Finding:
        """A problem with the value at `path`."""
        return Finding(self.path, self.line(path), self.key(path), what, remedy)


def inside(data: Any, path: KeyPath) -> Any:
    """What is at `path` inside of plain data, or None."""
    for part in path:
        if isinstance(data, dict):
            data = data.get(part)
        else:
            is_there = isinstance(data, list) and isinstance(part, int) and part < len(data)
            data = data[part] if is_there else None
    return data


def _entry_name(entry: Any) -> str | None:
    name = entry.get("name") if isinstance(entry, dict) else None
    return name if isinstance(name, str) and name.isprintable() and len(name) <= 40 else None


def read(path: Path) -> tuple[Document | None, list[Finding]]:
    """Read one file; no document if nothing in it can be used."""
    try:
        node = _compose(_text(path))
        tree = Tree()
        data = tree.value(node, ())
    except UnusableError as error:
        line, what, remedy = error.found
        return None, [Finding(path, line, "", what, remedy)]
    invalid = frozenset(where for _, where, _, _ in tree.found)
    document = Document(path, data, tree.lines, invalid)
    problems = [
        Finding(path, line, document.key(where), what, remedy)
        for line, where, what, remedy in tree.found
    ]
    return document, problems


def _text(path: Path) -> str:
    try:
        raw = read_regular(path, MAX_BYTES + 1)
    except OSError as error:
        what = f"cannot be read ({error.strerror})"
        raise UnusableError(
            None, what, "name a file that exists and that this user may read"
        ) from None
    if len(raw) > MAX_BYTES:
        raise UnusableError(None, f"is larger than {MAX_BYTES} bytes", "split it into a folder")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        what = f"is not UTF-8 text (byte 0x{raw[error.start]:02x})"
        raise UnusableError(line, what, "save it with the encoding UTF-8") from None


def _compose(text: str) -> yaml.Node | None:
    try:
        _check_size(text)
        return yaml.compose(text, Loader=loader(fast=True))
    except yaml.YAMLError as error:
        raise _syntax(text, error) from None


def _check_size(text: str) -> None:
    """Composing recurses, so libyaml would overrun the C stack, and a value takes 400 bytes."""
    depth = values = 0
    for event in yaml.parse(text, Loader=loader(fast=True)):
        if isinstance(event, yaml.NodeEvent):
            values += 1
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
        if depth > MAX_DEPTH or values > MAX_VALUES:
            line = 1 + (event.start_mark.line if event.start_mark else 0)
            raise _too_deep(line) if depth > MAX_DEPTH else _too_many(line)


def _too_deep(line: int) -> UnusableError:
    return UnusableError(line, f"is nested deeper than {MAX_DEPTH} levels", "flatten it")


def _too_many(line: int) -> UnusableError:
    what = f"has more than {MAX_VALUES} keys and values, aliases (*) expanded"
    return UnusableError(line, what, "move robots into files of robots.d, or use fewer aliases")


def _syntax(text: str, error: yaml.YAMLError) -> UnusableError:
    """The error of the parser in Python, so that it does not depend on libyaml."""
    try:
        yaml.compose(text, Loader=loader(fast=False))
    except yaml.YAMLError as found:
        error = found
    remedy = "indent with spaces, and put text with special characters in quotes"
    if isinstance(error, yaml.MarkedYAMLError) and error.problem_mark is not None:
        problem = error.problem or ""
        if problem.startswith("but"):
            problem = f"{error.context}, {problem}"
        what = f"is not valid YAML ({problem})"
        return UnusableError(error.problem_mark.line + 1, what, remedy)
    if isinstance(error, yaml.reader.ReaderError):
        line = text.count("\n", 0, error.position) + 1
        what = f"has a character that YAML does not allow (U+{ord(text[error.position]):04X})"
        return UnusableError(line, what, "remove it")
    return UnusableError(None, f"is not valid YAML ({error})", remedy)


def _int(text: str) -> int:
    digits = text.lstrip("+-")
    base = {"0o": 8, "0x": 16}.get(digits[:2], 10)
    return int(text, base)


def _float(text: str) -> float:
    return float(text.lower().replace(".inf", "inf").replace(".nan", "nan"))


_READERS: Mapping[str, Callable[[str], Any]] = {
    _TAG + "null": lambda _: None,
    _TAG + "bool": lambda text: text.lower() == "true",
    _TAG + "int": _int,
    _TAG + "float": _float,
    _TAG + "str": str,
    _TAG + "merge": str,
}


@cache
def loader(*, fast: bool) -> Any:
    """A loader class with these rules only; with libyaml if `fast` and it is installed."""
    base = getattr(yaml, "CSafeLoader", yaml.SafeLoader) if fast else yaml.SafeLoader
    made: Any = type("FleetLoader", (base,), {"yaml_implicit_resolvers": {}})
    for tag, pattern, first in _RESOLVERS:
        starts = [*first, ""] if tag == "null" else list(first)
        made.add_implicit_resolver(_TAG + tag, re.compile(rf"(?:{pattern})\Z"), starts)
    return made


def scalar(node: yaml.ScalarNode) -> Any:
    """The value of a scalar node; ValueError for a tag that is none of YAML's core schema."""
    reader = _READERS.get(node.tag)
    if reader is None:
        raise ValueError(f"has the tag {short_tag(node)}, which is not supported")
    try:
        return reader(node.value)
    except ValueError:
        raise ValueError(
            f"has the tag {short_tag(node)}, which does not fit {node.value!r}"
        ) from None


def short_tag(node: yaml.Node) -> str:
    """A node's tag as it is written in the file."""
    return str(node.tag).replace(_TAG, "!!")


@dataclass
class _Pair:
    key: str
    node: yaml.Node
    line: int


class Tree:
    """Turns composed nodes into plain data; collects lines and problems."""

    def __init__(self) -> None:
        self.lines: dict[KeyPath, int] = {}
        self.found: list[tuple[int, KeyPath, str, str]] = []  # problems: line, where, what, remedy
        self._values = 0
        self._open: list[yaml.Node] = []  # the collections around the current node

    def value(self, node: yaml.Node | None, path: KeyPath) -> Any:
        """The value of the node at `path`; None if it has none."""
        if node is None:
            return None
        line = node.start_mark.line + 1
        self._count(line)
        if isinstance(node, yaml.ScalarNode):
            try:
                return scalar(node)
            except ValueError as error:
                self._problem(line, path, str(error), NO_TAG)
                return None
        self._enter(node, line)
        found: Any = None
        if node.tag not in CORE_COLLECTIONS:
            self._problem(
                line, path, f"has the tag {short_tag(node)}, which is not supported", NO_TAG
            )
        elif isinstance(node, yaml.SequenceNode):
            found = self._sequence(node, path)
        elif isinstance(node, yaml.MappingNode):
            found = self._mapping(node, path)
        self._open.pop()
        return found

    def _sequence(self, node: yaml.SequenceNode, path: KeyPath) -> list[Any]:
        found = []
        for index, item in enumerate(node.value):
            where = (*path, index)
            self.lines[where] = item.start_mark.line + 1
            found.append(self.value(item, where))
        return found

    def _mapping(self, node: yaml.MappingNode, path: KeyPath) -> dict[str, Any]:
        found: dict[str, Any] = {}
        own = list(self._pairs(node, path))
        for pair in own:
            where = (*path, pair.key)
            if where in self.lines:
                what = f"is given twice (first in line {self.lines[where]})"
                self._problem(pair.line, where, what, "keep one of them")
                continue
            self.lines[where] = pair.line
            found[pair.key] = self.value(pair.node, where)
        return found

    def _pairs(self, node: yaml.MappingNode, path: KeyPath) -> Iterator[_Pair]:
        """The pairs of a mapping; last those merged by `<<` that are not overridden."""
        merged: list[_Pair] = []
        seen = set()
        for key, value in node.value:
            line = key.start_mark.line + 1
            self._count(line)
            if key.tag == "tag:yaml.org,2002:merge":
                merged.extend(self._merged(value, path, line))
            elif isinstance(key, yaml.ScalarNode):
                seen.add(key.value)
                yield _Pair(key.value, value, line)
            else:
                self._problem(line, path, "has a list or a mapping as a key", "use text as keys")
        for pair in merged:
            if pair.key not in seen:
                seen.add(pair.key)
                yield pair

    def _merged(self, node: yaml.Node, path: KeyPath, line: int) -> Iterator[_Pair]:
        sources = node.value if isinstance(node, yaml.SequenceNode) else [node]
        for source in sources:
            if not isinstance(source, yaml.MappingNode):
                self._problem(
                    line,
                    path,
                    "merges (<<) something that is not a mapping",
                    "merge an alias of one",
                )
            else:
                self._enter(source, line)
                yield from self._pairs(source, path)
                self._open.pop()

    def _count(self, line: int) -> None:
        self._values += 1
        if self._values > MAX_VALUES:
            raise _too_many(line)

    def _enter(self, node: yaml.Node, line: int) -> None:
        if any(node is around for around in self._open):
            raise UnusableError(line, "has an alias (*) inside its own anchor (&)", "write it out")
        if len(self._open) >= MAX_DEPTH:
            raise _too_deep(line)
        self._open.append(node)

    def _problem(self, line: int, path: KeyPath, what: str, remedy: str) -> None:
        self.found.append((line, path, what, remedy))
