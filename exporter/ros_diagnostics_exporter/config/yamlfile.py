"""One YAML file -> plain data, and the line on which each key stands.

Owns everything that can be wrong before the meaning is looked at: reading, encoding, syntax,
duplicate keys, size. Scalars are read by the core schema of YAML 1.2, as editors do: `on` and
`1:30` are text. Knows nothing of fleets.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from ros_diagnostics_exporter.config.errors import Problem
from ros_diagnostics_exporter.config.yamlscalars import loader, scalar, short_tag

KeyPath = tuple[str | int, ...]

CORE_COLLECTIONS = ("tag:yaml.org,2002:map", "tag:yaml.org,2002:seq")
NO_TAG = "remove the tag"

MAX_BYTES = 8 * 1024 * 1024
MAX_DEPTH = 32  # of nesting; fleet.yml needs eight, and each level costs the parser's stack
MAX_VALUES = 500_000  # after expansion of aliases


class Document(NamedTuple):
    """A file's content; ``lines`` has the line (from 1) of each key and list entry.

    At the places in ``marred`` something was wrong already; what stands there in ``data`` says
    nothing.
    """

    path: Path
    data: Any
    lines: Mapping[KeyPath, int]
    marred: frozenset[KeyPath] = frozenset()

    def line(self, path: KeyPath) -> int:
        """The line of `path`, or of the nearest thing around it that stands in the file."""
        while path and path not in self.lines:
            path = path[:-1]
        return self.lines.get(path, 1)

    def key(self, path: KeyPath) -> str:
        """`path` as people read it: `robots[robot_1].domain_id`, list entries by their name."""
        text, inner = "", self.data
        for part in path:
            inner = _inside(inner, part)
            if isinstance(part, int):
                text += f"[{_entry_name(inner) or part}]"
            else:
                text += f".{part}" if text else part
        return text

    def problem(self, path: KeyPath, what: str, remedy: str) -> Problem:
        """A problem with the value at `path`."""
        return Problem(self.path, self.line(path), self.key(path), what, remedy)


def _inside(data: Any, part: str | int) -> Any:
    if isinstance(data, dict):
        return data.get(part)
    if isinstance(data, list) and isinstance(part, int) and part < len(data):
        return data[part]
    return None


def _entry_name(entry: Any) -> str | None:
    name = entry.get("name") if isinstance(entry, dict) else None
    return name if isinstance(name, str) and name.isprintable() and len(name) <= 40 else None


class _Unusable(Exception):  # noqa: N818 - not an error of its own: carries a Problem out
    def __init__(self, line: int | None, what: str, remedy: str) -> None:
        self.found = (line, what, remedy)


def read(path: Path) -> tuple[Document | None, list[Problem]]:
    """Read one file; no document where a problem leaves nothing to go on with."""
    try:
        node = _compose(_text(path))
        tree = _Tree()
        data = tree.value(node, ())
    except _Unusable as error:
        line, what, remedy = error.found
        return None, [Problem(path, line, "", what, remedy)]
    marred = frozenset(where for _, where, _, _ in tree.found)
    document = Document(path, data, tree.lines, marred)
    problems = [
        Problem(path, line, document.key(where), what, remedy)
        for line, where, what, remedy in tree.found
    ]
    return document, problems


def _text(path: Path) -> str:
    try:
        with path.open("rb") as file:
            raw = file.read(MAX_BYTES + 1)
    except OSError as error:
        what = f"cannot be read ({error.strerror})"
        raise _Unusable(None, what, "name a file that exists and that this user may read") from None
    if len(raw) > MAX_BYTES:
        raise _Unusable(None, f"is larger than {MAX_BYTES} bytes", "split it into a folder")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        what = f"is not UTF-8 text (byte 0x{raw[error.start]:02x})"
        raise _Unusable(line, what, "save it with the encoding UTF-8") from None


def _compose(text: str) -> yaml.Node | None:
    try:
        _refuse_depth(text)
        return yaml.compose(text, Loader=loader(fast=True))
    except yaml.YAMLError as error:
        raise _syntax(text, error) from None


def _refuse_depth(text: str) -> None:
    """Composing recurses; libyaml's would overrun the C stack."""
    depth = 0
    for event in yaml.parse(text, Loader=loader(fast=True)):
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
        if depth > MAX_DEPTH:
            line = 1 + (event.start_mark.line if event.start_mark else 0)
            raise _Unusable(line, f"is nested deeper than {MAX_DEPTH} levels", "flatten it")


def _syntax(text: str, error: yaml.YAMLError) -> _Unusable:
    """The same words whether or not libyaml is installed: those of the parser in Python."""
    try:
        yaml.compose(text, Loader=loader(fast=False))
    except yaml.YAMLError as told:
        error = told
    remedy = "indent with blanks, and put text with special signs in quotes"
    if isinstance(error, yaml.MarkedYAMLError) and error.problem_mark is not None:
        problem = error.problem or ""
        if problem.startswith("but"):
            problem = f"{error.context}, {problem}"
        what = f"is not valid YAML ({problem})"
        return _Unusable(error.problem_mark.line + 1, what, remedy)
    if isinstance(error, yaml.reader.ReaderError):
        line = text.count("\n", 0, error.position) + 1
        what = f"has a character that YAML forbids (U+{ord(text[error.position]):04X})"
        return _Unusable(line, what, "remove it")
    return _Unusable(None, f"is not valid YAML ({error})", remedy)


@dataclass
class _Pair:
    key: str
    node: yaml.Node
    line: int


class _Tree:
    """Turns composed nodes into plain data, noting lines and problems on the way."""

    def __init__(self) -> None:
        self.lines: dict[KeyPath, int] = {}
        self.found: list[tuple[int, KeyPath, str, str]] = []  # problems: line, where, what, remedy
        self._values = 0
        self._open: list[yaml.Node] = []  # the collections around the current node

    def value(self, node: yaml.Node | None, path: KeyPath) -> Any:
        if node is None:
            return None
        self._values += 1
        line = node.start_mark.line + 1
        if self._values > MAX_VALUES:
            what = f"has more than {MAX_VALUES} values once its aliases (*) are expanded"
            raise _Unusable(line, what, "use fewer aliases")
        if isinstance(node, yaml.ScalarNode):
            try:
                return scalar(node)
            except ValueError as error:
                self._tell(line, path, str(error), NO_TAG)
                return None
        if any(node is around for around in self._open):
            raise _Unusable(line, "has an alias (*) inside its own anchor (&)", "write it out")
        self._open.append(node)
        found: Any = None
        if node.tag not in CORE_COLLECTIONS:
            self._tell(line, path, f"has the tag {short_tag(node)}, which is not read here", NO_TAG)
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
                self._tell(pair.line, where, what, "keep one of them")
                continue
            self.lines[where] = pair.line
            found[pair.key] = self.value(pair.node, where)
        return found

    def _pairs(self, node: yaml.MappingNode, path: KeyPath) -> Iterator[_Pair]:
        """The pairs of a mapping; those merged in by `<<` last, where no own key stands."""
        merged: list[_Pair] = []
        seen = set()
        for key, value in node.value:
            line = key.start_mark.line + 1
            if key.tag == "tag:yaml.org,2002:merge":
                merged.extend(self._merged(value, path, line))
            elif isinstance(key, yaml.ScalarNode):
                seen.add(key.value)
                yield _Pair(key.value, value, line)
            else:
                self._tell(line, path, "has a list or a mapping as a key", "use text as keys")
        for pair in merged:
            if pair.key not in seen:
                seen.add(pair.key)
                yield pair

    def _merged(self, node: yaml.Node, path: KeyPath, line: int) -> Iterator[_Pair]:
        sources = node.value if isinstance(node, yaml.SequenceNode) else [node]
        for source in sources:
            if not isinstance(source, yaml.MappingNode):
                self._tell(line, path, "merges (<<) what is no mapping", "merge an alias of one")
            elif any(source is around for around in self._open):
                raise _Unusable(line, "merges (<<) a mapping into itself", "write it out")
            else:
                self._open.append(source)
                yield from self._pairs(source, path)
                self._open.pop()

    def _tell(self, line: int, path: KeyPath, what: str, remedy: str) -> None:
        self.found.append((line, path, what, remedy))
