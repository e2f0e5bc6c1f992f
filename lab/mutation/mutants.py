"""Mutants of a package: its code with one small mistake in it, as cosmic-ray makes them."""

from __future__ import annotations

import ast
import difflib
import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator

from mutation import handlers
from mutation.left_out import is_left_out

# Mistakes that a person makes. cosmic-ray has more: each operator in place of each other.
_BINARY = ("Add_Sub", "Sub_Add", "Mul_Div", "Div_Mul", "FloorDiv_Div", "BitAnd_BitOr")
_COMPARISON = (
    *("Eq_NotEq", "NotEq_Eq", "Is_IsNot", "IsNot_Is"),
    *("Lt_LtE", "LtE_Lt", "Gt_GtE", "GtE_Gt", "Lt_Gt", "LtE_GtE", "Gt_Lt", "GtE_LtE"),
)
OPERATORS = (
    *(f"core/ReplaceBinaryOperator_{each}" for each in _BINARY),
    *(f"core/ReplaceComparisonOperator_{each}" for each in _COMPARISON),
    *("core/AddNot", "core/ReplaceUnaryOperator_Delete_Not", "core/ReplaceUnaryOperator_USub_UAdd"),
    *("core/ReplaceAndWithOr", "core/ReplaceOrWithAnd"),
    *("core/ReplaceTrueWithFalse", "core/ReplaceFalseWithTrue", "core/NumberReplacer"),
    *("core/ReplaceBreakWithContinue", "core/ReplaceContinueWithBreak"),
    *("core/ZeroIterationForLoop", "core/RemoveDecorator"),
)
HANDLERS = "core/ExceptionReplacer"  # see `handlers`


class Change(NamedTuple):
    """The first changed line, as it was and as it is now, without what it is indented by."""

    file: str  # below the folder of all packages
    was: str
    now: str


class Mutant(NamedTuple):
    """The text of a file with a change; ``lines`` are those of the changed statement."""

    path: Path
    text: str
    lines: range
    change: Change


class _Place(NamedTuple):
    rank: str
    path: Path
    operator: str
    occurrence: int
    start: tuple[int, int]


def draw(package: Path, files: str, seed: int) -> Iterator[Mutant]:
    """All mutants of a package's ``files``, one for each place, in the order that ``seed`` gives.

    Lines that change or are left out do not change the order of the others.
    """
    drawn: set[tuple[Path, tuple[int, int]]] = set()
    for place in sorted(_places(package, files, seed)):
        if (place.path, place.start) not in drawn:
            drawn.add((place.path, place.start))
            yield _mutant(package.parent, place)


def _places(package: Path, files: str, seed: int) -> Iterator[_Place]:
    for path in sorted(package.glob(files)):
        text = path.read_text()
        lines = text.splitlines()
        for name, occurrence, start in _positions(text):
            line = lines[start[0] - 1]
            if is_left_out(name, line, start[1]):
                continue
            rank = hashlib.sha256(repr((seed, path.name, name, line, start[1])).encode())
            yield _Place(rank.hexdigest(), path, name, occurrence, start)


def _positions(text: str) -> Iterator[tuple[str, int, tuple[int, int]]]:
    """Of each mutant its operator, the occurrence of that, and where it begins."""
    nodes = list(ast_nodes(get_ast(text)))
    for name in OPERATORS:
        operator = get_operator(name)()
        places = ((node, at) for node in nodes for at, _ in operator.mutation_positions(node))
        for occurrence, (node, start) in enumerate(places):
            if node.parent is None or node.parent.type != "parameters":  # a star there, no product
                yield name, occurrence, start
    for occurrence, start in enumerate(handlers.positions(text)):
        yield HANDLERS, occurrence, start


def _mutant(packages: Path, place: _Place) -> Mutant:
    text = place.path.read_text()
    if place.operator == HANDLERS:
        changed = handlers.replaced(text, place.occurrence)
    else:
        changed = mutate_code(text, get_operator(place.operator)(), place.occurrence)
    compared = difflib.ndiff(text.splitlines(), changed.splitlines())
    lines = [line for line in compared if line[0] in "+-" and line[1:].strip()]
    was, now = (next((line[2:].strip() for line in lines if line[0] == sign), "") for sign in "-+")
    change = Change(str(place.path.relative_to(packages)), was, now)
    return Mutant(place.path, changed, _statement(text, place.start[0]), change)


def _statement(text: str, line: int) -> range:
    """The lines of the statement at a line; of one with a block, those before the block."""
    found = range(line, line + 1)
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.stmt):
            body = getattr(node, "body", None)
            lines = range(node.lineno, body[0].lineno if body else (node.end_lineno or line) + 1)
            if line in lines:
                found = lines
    return found
