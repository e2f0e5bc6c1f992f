"""One YAML file -> plain data, and the line on which each key stands.

Owns what can be wrong before the meaning is looked at: reading, encoding, syntax, size. Knows
nothing of fleets.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from ros_diagnostics_exporter.config.errors import Problem
from ros_diagnostics_exporter.config.yamlscalars import loader
from ros_diagnostics_exporter.config.yamltree import MAX_DEPTH, KeyPath, Tree, UnusableError
from ros_diagnostics_exporter.files import read_regular

MAX_BYTES = 8 * 1024 * 1024


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


def read(path: Path) -> tuple[Document | None, list[Problem]]:
    """Read one file; no document where a problem leaves nothing to go on with."""
    try:
        node = _compose(_text(path))
        tree = Tree()
        data = tree.value(node, ())
    except UnusableError as error:
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
            raise UnusableError(line, f"is nested deeper than {MAX_DEPTH} levels", "flatten it")


def _syntax(text: str, error: yaml.YAMLError) -> UnusableError:
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
        return UnusableError(error.problem_mark.line + 1, what, remedy)
    if isinstance(error, yaml.reader.ReaderError):
        line = text.count("\n", 0, error.position) + 1
        what = f"has a character that YAML forbids (U+{ord(text[error.position]):04X})"
        return UnusableError(line, what, "remove it")
    return UnusableError(None, f"is not valid YAML ({error})", remedy)
