"""Puts the lists of an import before those of an alertmanager.yml, whose text stays as it is."""

from __future__ import annotations

import textwrap
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml

from ros_diagnostics_tools import limits
from ros_diagnostics_tools.nagios.importer.files import NagiosError
from ros_diagnostics_tools.yaml_nodes import get, items, scalar

MOST_BYTES = 16 * 2**20
OURS = "RosDiagnostics.+"  # in the matcher of the route that docs/existing-servers.md adds
Dump = Callable[[Any], str]


def merged(path: Path, content: dict[str, Any], dump: Dump) -> str:
    """The file with the import's lists, each before what its list of the same name has.

    Raises:
        NagiosError: it is no configuration of Alertmanager, or has been merged already.
    """
    text = _text(path)
    root = _composed(path, text)
    names = {scalar(get(each, "name")) for each in items(get(root, "receivers"))}
    if twice := names & {each["name"] for each in content["receivers"]}:
        raise NagiosError(f"{path}: has a receiver {min(twice)} already; give the file before that")
    route = get(root, "route")
    if not isinstance(route, yaml.MappingNode):
        raise NagiosError(f"{path}: has no route; give Alertmanager's configuration")
    places = [(_ours(route), "routes", content["routes"])]
    places += [(root, key, content[key]) for key in content if key != "routes"]
    edits = [_edit(path, node, key, added, dump) for node, key, added in places if added]
    for line, lines in sorted(edits, reverse=True):
        text = _inserted(text, line, lines)
    _composed(path, text)
    return text


def _text(path: Path) -> str:
    try:
        text = limits.read(path, MOST_BYTES).decode("utf-8")
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise NagiosError(f"{path}: {reason}; give Alertmanager's configuration") from None
    return text if text.endswith("\n") else f"{text}\n"


def _composed(path: Path, text: str) -> yaml.MappingNode:
    try:
        root = yaml.compose(text, yaml.SafeLoader)
    except (yaml.YAMLError, RecursionError) as error:
        raise NagiosError(f"{path}: is not YAML: {error}; correct it") from None
    if not isinstance(root, yaml.MappingNode):
        raise NagiosError(f"{path}: has no route; give Alertmanager's configuration")
    return root


def _ours(route: yaml.MappingNode) -> yaml.MappingNode:
    """The route of the alerts about robots: that of a site which has others, or the whole."""
    for each in items(get(route, "routes")):
        matchers = [str(one.value) for one in items(get(each, "matchers"))]
        if any(OURS in one for one in matchers) and get(each, "routes") is not None:
            found: yaml.MappingNode = each
            return found
    return route


def _edit(
    path: Path, node: yaml.MappingNode, key: str, added: list[Any], dump: Dump
) -> tuple[int, str]:
    """Before which line of the file something is inserted, and what."""
    found = get(node, key)
    if isinstance(found, yaml.SequenceNode) and found.value and not found.flow_style:
        first = found.value[0].start_mark
        indent = found.start_mark.column
        return first.line, textwrap.indent(dump(added), " " * indent)
    if found is not None and items(found):
        line = found.start_mark.line + 1
        raise NagiosError(f"{path}:{line}: write {key} as a list with a line for each entry")
    column = node.start_mark.column
    text = f"{key}:\n{textwrap.indent(dump(added), '  ')}"
    if found is not None:
        raise NagiosError(f"{path}:{found.start_mark.line + 1}: {key} is empty; remove the line")
    return node.start_mark.line, textwrap.indent(text, " " * column)


def _inserted(text: str, line: int, added: str) -> str:
    lines = text.splitlines(keepends=True)
    return "".join((*lines[:line], added, *lines[line:]))
