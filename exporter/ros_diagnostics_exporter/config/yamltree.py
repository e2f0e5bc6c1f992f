"""Composed YAML nodes -> plain data and lines; finds duplicate keys, tags, aliases run wild."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import yaml

from ros_diagnostics_exporter.config.yamlscalars import scalar, short_tag

KeyPath = tuple[str | int, ...]

CORE_COLLECTIONS = ("tag:yaml.org,2002:map", "tag:yaml.org,2002:seq")
NO_TAG = "remove the tag"
MAX_DEPTH = 32  # of nesting; fleet.yml needs eight, and each level costs stack
MAX_VALUES = 200_000  # after expansion of aliases


class UnusableError(Exception):
    """Nothing of the file can be used; `found` is (line or None, what is wrong, remedy)."""

    def __init__(self, line: int | None, what: str, remedy: str) -> None:
        self.found = (line, what, remedy)


@dataclass
class _Pair:
    key: str
    node: yaml.Node
    line: int


class Tree:
    """Turns composed nodes into plain data, noting lines and problems on the way."""

    def __init__(self) -> None:
        self.lines: dict[KeyPath, int] = {}
        self.found: list[tuple[int, KeyPath, str, str]] = []  # problems: line, where, what, remedy
        self._values = 0
        self._open: list[yaml.Node] = []  # the collections around the current node

    def value(self, node: yaml.Node | None, path: KeyPath) -> Any:
        """What the node, found at `path`, means; None where it means nothing."""
        if node is None:
            return None
        line = node.start_mark.line + 1
        self._count(line)
        if isinstance(node, yaml.ScalarNode):
            try:
                return scalar(node)
            except ValueError as error:
                self._tell(line, path, str(error), NO_TAG)
                return None
        self._enter(node, line)
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
            self._count(line)
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
            else:
                self._enter(source, line)
                yield from self._pairs(source, path)
                self._open.pop()

    def _count(self, line: int) -> None:
        self._values += 1
        if self._values > MAX_VALUES:
            what = f"has more than {MAX_VALUES} values once its aliases (*) are expanded"
            raise UnusableError(line, what, "use fewer aliases")

    def _enter(self, node: yaml.Node, line: int) -> None:
        if any(node is around for around in self._open):
            raise UnusableError(line, "has an alias (*) inside its own anchor (&)", "write it out")
        if len(self._open) >= MAX_DEPTH:
            raise UnusableError(line, f"is nested deeper than {MAX_DEPTH} levels", "flatten it")
        self._open.append(node)

    def _tell(self, line: int, path: KeyPath, what: str, remedy: str) -> None:
        self.found.append((line, path, what, remedy))
