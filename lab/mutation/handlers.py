"""Mutants of `except` clauses: one of the classes that a clause catches is another.

cosmic-ray's operator fails at a dotted name among several: `except (OSError, sqlite3.Error)`.
"""

from __future__ import annotations

import ast

OTHER = "CosmicRayTestingException"  # by which cosmic-ray does it; no file has this name


def positions(text: str) -> list[tuple[int, int]]:
    """Line and column of each class that is caught."""
    return [(each.lineno, each.col_offset) for each in _caught(text)]


def replaced(text: str, occurrence: int) -> str:
    """The text with another class in place of the one with that index in `positions`."""
    caught = _caught(text)[occurrence]
    lines = text.splitlines(keepends=True)
    line = lines[caught.lineno - 1]
    lines[caught.lineno - 1] = line[: caught.col_offset] + OTHER + line[caught.end_col_offset :]
    return "".join(lines)


def _caught(text: str) -> list[ast.expr]:
    types = (node.type for node in ast.walk(ast.parse(text)) if isinstance(node, ast.ExceptHandler))
    return [
        each
        for caught in types
        if caught is not None
        for each in (caught.elts if isinstance(caught, ast.Tuple) else [caught])
    ]
