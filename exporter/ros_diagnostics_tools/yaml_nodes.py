"""Looks into YAML's nodes, which keep how and where everything is written."""

from __future__ import annotations

from typing import Any

import yaml


def get(node: yaml.Node | None, key: str) -> Any:
    """The value of a key of a mapping; None without it."""
    pairs = node.value if isinstance(node, yaml.MappingNode) else []
    return next((value for name, value in pairs if scalar(name) == key), None)


def made(data: Any) -> Any:
    """Plain data as a node; lists and mappings of nothing but scalars in one line."""
    text = yaml.safe_dump(
        data, default_flow_style=None, sort_keys=False, allow_unicode=True, width=10_000
    )
    return yaml.compose(text, Loader=yaml.BaseLoader)


def items(node: yaml.Node | None) -> list[Any]:
    """The nodes of a list; none of anything else."""
    return list(node.value) if isinstance(node, yaml.SequenceNode) else []


def scalar(node: yaml.Node | None) -> str:
    """A scalar as it is written; "" of anything else."""
    return str(node.value) if isinstance(node, yaml.ScalarNode) else ""
