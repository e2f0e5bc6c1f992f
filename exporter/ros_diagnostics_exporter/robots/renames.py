"""Which component, known under another name, a row of an aggregated array continues.

One row is one component. But an aggregator names a component exactly only in the values of its
group's header, and while it runs the header may get or lose these, and the tree another base path.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from os.path import commonpath

from ros_diagnostics_exporter.robots.component import Component, Identity


def path_of(component: Component) -> str:
    """The path of the row that an aggregator had for it, as far as its names say."""
    name, group, _hardware_id = component.identity
    return f"{group or component.group}/{name if group else name.replace('/', ' ')}"


def find_former(
    rows: Mapping[Identity, str], vanished: Mapping[Component, str], *, is_moved: bool
) -> dict[Identity, Component]:
    """The component that each row continues, if there is one.

    Args:
        rows: The path of the row of each identity that is not known.
        vanished: The components that are no longer listed, each with the path of its row.
        is_moved: Whether these are all rows, so that the whole tree may have another base path.
    """
    former = _match(rows, {path: component for component, path in vanished.items()})
    if former or not is_moved:
        return former
    listed = {path: component for component, path in vanished.items() if not component.missing}
    if not listed:
        return {}
    below, before = _below(rows.values()), _below(listed)
    return _match(
        {identity: below[path] for identity, path in rows.items()},
        {before[path]: component for path, component in listed.items()},
    )


def _match(
    rows: Mapping[Identity, str], vanished: Mapping[str, Component]
) -> dict[Identity, Component]:
    """By the path; two exact names are two components, whatever their paths."""
    return {
        identity: component
        for identity, path in rows.items()
        if (component := vanished.get(path)) is not None and (identity[1] or not component.is_exact)
    }


def _below(paths: Collection[str]) -> dict[str, str]:
    """For each path what is below the one that all of them have in common."""
    base = commonpath([path.rpartition("/")[0] or "/" for path in paths])
    end = len(base.rstrip("/"))
    return {path: path[end:] for path in paths}
