"""The kinds of robots that come with the package, and how any kind file becomes components.

A kind is a YAML file (schema/kinds.py) and a diagnostics.yaml of analyzers.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from random import Random

from virtual_robots.aggregator import Parameters, load_parameters
from virtual_robots.schema.documents import DocumentError, parse, read_mapping
from virtual_robots.schema.kinds import ComponentModel, KindModel
from virtual_robots.simulation.actions import Action
from virtual_robots.simulation.components import Component

HERE = Path(__file__).parent


def known_kinds() -> tuple[str, ...]:
    """The names of the kinds that come with the package."""
    return tuple(sorted(p.stem for p in HERE.glob("*.yaml") if not p.stem.endswith(".analyzers")))


def kind_path(kind: str, relative_to: Path = Path()) -> Path:
    """The file of a kind: one of known_kinds(), or the path of a user's own file.

    Raises DocumentError for anything else.
    """
    if kind in known_kinds():
        return HERE / f"{kind}.yaml"
    if kind.endswith((".yaml", ".yml")):
        return relative_to / kind
    raise DocumentError(
        f"kind {kind!r} is not known; it is one of {', '.join(known_kinds())},"
        " or the path of a .yaml file"
    )


@lru_cache(maxsize=64)
def load_kind(path: Path) -> KindModel:
    """Read a kind file. Raises DocumentError."""
    return parse(KindModel, read_mapping(path), str(path))


@lru_cache(maxsize=64)
def load_analyzers(path: Path) -> Parameters:
    """The diagnostics.yaml of the kind whose file is ``path``. Raises AnalyzerConfigError."""
    analyzers = load_kind(path).analyzers
    if analyzers is None:
        raise DocumentError(f"{path}: robots of this kind have no diagnostics, so no aggregator")
    return load_parameters(path.parent / analyzers)


def build_components(kind: KindModel, seed: str) -> list[Component]:
    """The components of one robot, each with random numbers of its own drawn from ``seed``."""
    return [
        _build(model, number, seed)
        for model in kind.components
        for number in range(1, model.count + 1)
    ]


def build_actions(kind: KindModel, seed: str) -> list[Action]:
    """The actions of one robot, each with random numbers of its own drawn from ``seed``."""
    return [Action(model, Random(f"{seed}/{model.name}")) for model in kind.actions]


def _build(model: ComponentModel, number: int, seed: str) -> Component:
    name = model.name.format(n=number)
    return Component(model, name, model.hardware_id.format(n=number), Random(f"{seed}/{name}"))
