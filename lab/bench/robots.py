"""Made-up arrays for the benches: 16 components in 4 groups, 4 key-values each."""

from __future__ import annotations

from collections.abc import Collection

from ros_diagnostics_exporter.model import Array, Status

GROUPS, COMPONENTS, VALUES = 4, 4, 4


def aggregated_array(turn: int, *, level: int = 0, of: Collection[int] | None = None) -> Array:
    """The aggregated array of one robot; every value differs from turn to turn.

    ``level`` is that of all components and their groups, or of those numbered ``of`` (0 to 15)
    alone.
    """
    statuses: list[Status] = []
    for group in range(GROUPS):
        names = [f"node_{group}: part {part}" for part in range(COMPONENTS)]
        levels = [
            level if of is None or group * COMPONENTS + part in of else 0
            for part in range(COMPONENTS)
        ]
        rows = tuple((name, "OK") for name in names)
        statuses.append(Status(max(levels), f"/Group {group}", "OK", "", rows))
        statuses.extend(
            Status(
                each,
                f"/Group {group}/{name}",
                "OK",
                "hw-1",
                tuple((f"Voltage {key} (V)", f"{turn % 97 + key / 8}") for key in range(VALUES)),
            )
            for name, each in zip(names, levels, strict=True)
        )
    return Array(1.7e9 + turn, tuple(statuses), 2400)
