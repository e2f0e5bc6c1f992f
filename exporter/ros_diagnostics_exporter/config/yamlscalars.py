"""Which text in a YAML file is a number, a truth value, nothing, or text: YAML 1.2's core schema.

PyYAML reads YAML 1.1, where `on`, `no`, `1:30` and `2026-01-01` are no text; editors read 1.2.
Source: https://yaml.org/spec/1.2.2/#103-core-schema
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

import yaml

_TAG = "tag:yaml.org,2002:"

# tag, what the text looks like, the characters it can begin with
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
    """A loader class with these rules and no others; with libyaml if `fast` and it is there."""
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
        raise ValueError(f"has the tag {short_tag(node)}, which is not read here")
    try:
        return reader(node.value)
    except ValueError:
        raise ValueError(f"has the tag {short_tag(node)}, which {node.value!r} is not") from None


def short_tag(node: yaml.Node) -> str:
    """A node's tag as it is written in the file."""
    return str(node.tag).replace(_TAG, "!!")
