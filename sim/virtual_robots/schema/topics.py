"""The schema of a topic that a component has of its own, and the fields of its messages.

The fields are a tree as the message is: a text, number or yes and no for each plain field, a
mapping for a message in it, a list for an array. Texts may use variables.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, TypeAlias

from pydantic import Field, StringConstraints, field_validator

from virtual_robots.schema.conditions import Condition
from virtual_robots.schema.documents import Document, parse

Tree: TypeAlias = Any  # str | int | float | bool | tuple[Tree, ...] | dict[str, Tree] | Element
Values: TypeAlias = Mapping[str, float | str]


class Element(Condition):
    """An element of an array that is there while the condition holds."""

    then: Tree


class TopicModel(Document):
    """A topic of a component's own: a message of ``type`` with these ``fields``.

    What is ``latched`` is published when it changes, and kept for late joiners.
    """

    topic: Annotated[str, StringConstraints(pattern=r"^[a-z][a-z0-9_]*(/[a-z][a-z0-9_]*)*$")]
    type: Annotated[str, StringConstraints(pattern=r"^[a-z][a-z0-9_]*/msg/[A-Z][A-Za-z0-9]*$")]
    fields: dict[str, Tree] = Field(default_factory=dict)
    latched: bool = False

    @field_validator("fields")
    @classmethod
    def _are_trees(cls, fields: dict[str, Tree]) -> dict[str, Tree]:
        return {name: _parsed(tree) for name, tree in fields.items()}


def leaves(tree: Tree) -> Iterator[Tree]:
    """Every text, number, yes and no, and Element of a tree."""
    if isinstance(tree, dict):
        for each in tree.values():
            yield from leaves(each)
    elif isinstance(tree, tuple):
        for each in tree:
            yield from leaves(each)
    else:
        yield tree
        if isinstance(tree, Element):
            yield from leaves(tree.then)


def filled(tree: Tree, values: Values) -> Tree:
    """The tree with its texts filled in, and those elements of arrays whose condition holds."""
    if isinstance(tree, dict):
        return {name: filled(each, values) for name, each in tree.items()}
    if isinstance(tree, tuple):
        there = (each for each in tree if not isinstance(each, Element) or _holds(each, values))
        return tuple(filled(each, values) for each in there)
    if isinstance(tree, Element):
        return filled(tree.then, values)
    return tree.format_map(values) if isinstance(tree, str) else tree


def _holds(element: Element, values: Values) -> bool:
    return element.holds(float(values[element.variable]))


def _parsed(raw: Any) -> Tree:
    if isinstance(raw, dict):
        return {str(name): _parsed(each) for name, each in raw.items()}
    if isinstance(raw, list | tuple):
        return tuple(_element(each) if _is_element(each) else _parsed(each) for each in raw)
    if isinstance(raw, str | int | float):
        return raw
    raise ValueError(f"a field is a text, a number, a list or a mapping, not {raw!r}")


def _is_element(raw: Any) -> bool:
    return isinstance(raw, dict) and "if" in raw


def _element(raw: dict[str, Any]) -> Element:
    then = {"then": _parsed(raw["then"])} if "then" in raw else {}
    return parse(Element, {**raw, **then}, "an element of an array")
