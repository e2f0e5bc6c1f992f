"""diagnostics.yaml as the flat, typed parameters that a ROS node would have declared."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import yaml

NODE = "analyzers"

# Parameters that rclcpp declares on every node. They matter: the real program walks over all
# parameters in byte order, and a type that it could not load also applies to those that follow.
OF_EVERY_NODE: Mapping[str, Any] = {
    "qos_overrides./parameter_events.publisher.depth": 1000,
    "qos_overrides./parameter_events.publisher.durability": "volatile",
    "qos_overrides./parameter_events.publisher.history": "keep_last",
    "qos_overrides./parameter_events.publisher.reliability": "reliable",
    "start_type_description_service": True,
    "use_sim_time": False,
}


class AnalyzerConfigError(ValueError):
    """A diagnostics.yaml that the real diagnostic_aggregator rejects, aborts on or ignores."""


class Parameters:
    """Flat parameters in byte order, with ROS' typed access: a wrong type is an error.

    ``source`` names the file in errors. Access to a parameter of another type raises
    AnalyzerConfigError, where rclcpp would throw and end the process.
    """

    def __init__(self, flat: Mapping[str, Any], source: str) -> None:
        self.source = source
        self._flat = dict(sorted(flat.items()))

    def __iter__(self) -> Iterator[str]:
        return iter(self._flat)

    def under(self, prefix: str) -> dict[str, str]:
        """Names below ``prefix`` without it -> full names, in byte order ("" for all)."""
        if not prefix:
            return {name: name for name in self._flat}
        start = prefix + "."
        return {n[len(start) :]: n for n in self._flat if n.startswith(start)}

    def text(self, name: str) -> str:
        """A parameter that must be a string."""
        value = self._flat[name]
        if not isinstance(value, str):
            raise self._wrong(name, "a string (in quotes)")
        return value

    def texts(self, name: str) -> list[str]:
        """A parameter that must be a list of strings."""
        value = self._flat[name]
        if not isinstance(value, list) or not all(isinstance(v, str) for v in value):
            raise self._wrong(name, "a list of strings, as in ['Motor']")
        return list(value)

    def number(self, name: str) -> float:
        """A parameter that must be a floating point number: ROS rejects an integer."""
        value = self._flat[name]
        if not isinstance(value, float):
            better = f"{value}.0" if type(value) is int else "5.0"
            raise self._wrong(name, f"a number with a decimal point, as in {better}")
        return value

    def integer(self, name: str) -> int:
        """A parameter that must be an integer."""
        value = self._flat[name]
        if type(value) is not int:
            raise self._wrong(name, "an integer")
        return value

    def flag(self, name: str) -> bool:
        """A parameter that must be true or false."""
        value = self._flat[name]
        if not isinstance(value, bool):
            raise self._wrong(name, "true or false, without quotes")
        return value

    def printed(self, name: str) -> str:
        """Any parameter as text, as rclcpp's value_to_string gives it for a string."""
        return str(self._flat[name])

    def _wrong(self, name: str, right: str) -> AnalyzerConfigError:
        return AnalyzerConfigError(
            f"{self.source}: {name}: is {self._flat[name]!r}, must be {right}"
            " (the real diagnostic_aggregator aborts on it)"
        )


def load_parameters(path: Path) -> Parameters:
    """Read the file that ``--params-file`` would give to the real aggregator.

    Raises AnalyzerConfigError naming file and key; OSError where the file cannot be read.
    """
    try:
        document = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise AnalyzerConfigError(f"{path}: is not YAML: {error}") from error
    sections = list(_sections(document, str(path)))
    if not sections:
        raise AnalyzerConfigError(
            f"{path}: has no section for the node {NODE!r}; write"
            f" '{NODE}:' or '/**:' and under it 'ros__parameters:'"
        )
    flat: dict[str, Any] = dict(OF_EVERY_NODE)
    for section in sections:
        flat.update(_flatten(section, str(path)))
    return Parameters(flat, str(path))


def _sections(document: Any, source: str) -> Iterator[Mapping[str, Any]]:
    """The ros__parameters that apply to a node `analyzers` in any namespace, general ones first."""
    if not isinstance(document, dict):
        raise AnalyzerConfigError(f"{source}: must be a mapping that begins with '{NODE}:'")
    for key in ("/**", f"/**/{NODE}", f"/{NODE}", NODE):
        body = document.get(key)
        if not isinstance(body, dict):
            continue
        if key == "/**" and NODE in body:
            body = body[NODE]
        if "ros__parameters" not in body:
            raise AnalyzerConfigError(f"{source}: {key}: 'ros__parameters:' is missing under it")
        yield body["ros__parameters"] or {}


def _flatten(tree: Mapping[str, Any], source: str, prefix: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in tree.items():
        name = f"{prefix}{key}"
        if isinstance(value, dict):
            yield from _flatten(value, source, f"{name}.")
        elif value is None or value == []:
            raise AnalyzerConfigError(f"{source}: {name}: has no value; give one or leave it out")
        else:
            yield name, value
