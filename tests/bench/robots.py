"""Made-up arrays for the benches: 16 components in 4 groups, 4 key-values each."""

from __future__ import annotations

from ros_diagnostics_exporter.diagnostics import Array, Status

GROUPS, COMPONENTS, VALUES = 4, 4, 4


def aggregated_array(turn: int, *, level: int = 0) -> Array:
    """The aggregated array of one robot; every value differs from turn to turn."""
    statuses: list[Status] = []
    for group in range(GROUPS):
        names = [f"node_{group}: part {part}" for part in range(COMPONENTS)]
        statuses.append(Status(level, f"/Group {group}", "OK", "", tuple((n, "OK") for n in names)))
        statuses.extend(
            Status(
                level,
                f"/Group {group}/{name}",
                "OK",
                "hw-1",
                tuple((f"Voltage {key} (V)", f"{turn % 97 + key / 8}") for key in range(VALUES)),
            )
            for name in names
        )
    return Array(1.7e9 + turn, tuple(statuses), 2400)
