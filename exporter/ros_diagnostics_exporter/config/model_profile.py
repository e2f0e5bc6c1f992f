"""The shape of profiles in fleet.yml: how a kind of robot is judged."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from ros_diagnostics_exporter.config.errors import WrongValueError
from ros_diagnostics_exporter.config.metric_names import MetricName, Unit
from ros_diagnostics_exporter.config.model_base import Entry, optional, required
from ros_diagnostics_exporter.config.patterns import Wildcards, Words
from ros_diagnostics_exporter.config.scalars import Duration, Name, PositiveDuration

LevelWord = Literal["OK", "WARN", "ERROR", "STALE"]


class CheckEntry(Entry):
    """A named set of components, watched as one; a list of words is short for `match`."""

    match: Words | None = optional(
        "Words, case ignored: a component belongs to the check if its group and name contain "
        'one of them. {regex: "..."} is searched in `group/component` as it is. Without it, all.',
        example=["Motor"],
    )
    expect: Annotated[int, Field(ge=0, le=100_000)] | None = optional(
        "How many components the check should find; fewer are CRITICAL.", example=3
    )


def _short_check(value: Any) -> Any:
    return {"match": value} if isinstance(value, str | list) else value


Check = Annotated[
    CheckEntry, BeforeValidator(_short_check, json_schema_input_type=Words | CheckEntry)
]


class ComponentEntry(Entry):
    """What is special about some components; the first entry that matches is the one."""

    match: Words = required(
        "Words, case ignored, one of which the component's name contains; or {regex: ...}.",
        example="Laser",
    )
    ignore: bool | None = optional(
        "Take these components not in at all.", example=True, default=False
    )
    stale_after: PositiveDuration | None = optional(
        "Their own time without news after which they are STALE, in place of the profile's.",
        example="90s",
    )
    confirm_after: Duration | None = optional(
        "Their own time in a problem after which it is told, in place of the profile's.",
        example="1m",
    )
    levels: dict[LevelWord, LevelWord] | None = optional(
        "The level that counts in place of the one that is said.", example={"ERROR": "WARN"}
    )
    planned_stale: bool | None = optional(
        "Their STALE is planned (a sensor that is switched off) and pages nobody.",
        example=True,
        default=False,
    )


class BoundEntry(Entry):
    """A bound for a value, in the unit in which it is exported."""

    warning: float | None = optional("Beyond it the value is a WARNING.", example=11.5)
    critical: float | None = optional("Beyond it the value is CRITICAL.", example=10.8)


class ThresholdsEntry(Entry):
    """Bounds for a value, exported as `component_value_threshold` for rules and panels."""

    low: BoundEntry | None = optional("The value should not be below.", example={"critical": 10.8})
    high: BoundEntry | None = optional("The value should not be above.", example={"warning": 80})

    @model_validator(mode="after")
    def _in_order(self) -> ThresholdsEntry:
        low, high = self.low or BoundEntry(), self.high or BoundEntry()
        names = ("low critical", "low warning", "high warning", "high critical")
        bounds = (low.critical, low.warning, high.warning, high.critical)
        given = [(n, b) for n, b in zip(names, bounds, strict=True) if b is not None]
        for (below, small), (above, large) in pairwise(given):
            if small > large:
                raise WrongValueError(
                    f"{below} ({small:g}) is above {above} ({large:g})",
                    "order them: low critical, low warning, high warning, high critical",
                )
        return self


class ValueEntry(Entry):
    """How some key-values are read; the first entry that matches is the one."""

    key: Wildcards | None = optional(
        "The key as the driver publishes it, `*` for anything; or {regex: ...} for all of it. "
        "A colon at the end may be left out. Without it, all keys.",
        example="Voltage (V)",
    )
    component: Words | None = optional(
        "Words, case ignored, one of which the component's name contains. Without it, all.",
        example="Battery",
    )
    keep: bool | None = optional("false drops the value.", example=False, default=True)
    unit: Unit | None = optional(
        "The unit, in place of the one found in the key or the value.", example="V"
    )
    enum: dict[str, float] | None = optional(
        "Numbers for words, case ignored.", example={"None": 0, "Adapter": 1, "Dock": 2}
    )
    scale: float | None = optional(
        "Factor from the value to what is exported.", example=0.01, default=1
    )
    offset: float | None = optional("Added after `scale`.", example=-273.15, default=0)
    metric: MetricName | None = optional(
        "Exported under this name of its own, in a base unit, in place of `component_value`; "
        "beside it where there are `thresholds`, so that panels draw both together.",
        example="ros_battery_voltage_volts",
    )
    thresholds: ThresholdsEntry | None = optional(
        "Bounds for the exported value.", example={"low": {"warning": 11.5, "critical": 10.8}}
    )

    @model_validator(mode="after")
    def _something_to_do(self) -> ValueEntry:
        said = self.model_fields_set - {"key", "component", "keep"}
        if self.keep is False and said:
            what = f"drops the value (keep: false) and also sets {', '.join(sorted(said))}"
            raise WrongValueError(what, "remove keep, or the rest")
        if self.scale == 0:
            raise WrongValueError(
                "scale is 0, which makes every value the same", "use another factor"
            )
        if self.enum is not None:
            words = {word.strip().lower() for word in self.enum}
            if not self.enum or len(words) < len(self.enum):
                what = "enum names a word twice, as case is ignored" if words else "enum is empty"
                raise WrongValueError(what, "give each word one number, or remove enum")
        return self


class ProfileEntry(Entry):
    """How a kind of robot is judged. What is not given comes from the profile that is extended."""

    extends: Name | None = optional(
        "The profile to start from. Its checks are added to (same names replaced, null removes "
        "one); its components and values are searched after this profile's own.",
        example="wheeled",
        default="default",
    )
    stale_after: PositiveDuration | None = optional(
        "Silence after which a robot counts as silent.", example="5s", default="10s"
    )
    confirm_after: Duration | None = optional(
        "Time in a problem after which it is told.", example="30s", default="10s"
    )
    forget_after: PositiveDuration | None = optional(
        "Time without news after which a component that was OK when last received is forgotten, "
        "and a robot that was discovered once none of its components is left.",
        example="24h",
        default="24h",
    )
    flap_interval: PositiveDuration | None = optional(
        "Time between two of the 21 states in which changes are counted for "
        "`component_flap_ratio`.",
        example="1m",
        default="15s",
    )
    stale_is_critical: bool | None = optional(
        "Whether STALE counts as CRITICAL; else it is a state of its own between WARNING and "
        "CRITICAL. By default what the whole fleet's `stale_is_critical` says.",
        example=True,
    )
    checks: dict[Name, Check | None] | None = optional(
        "Named sets of components. The check `all` is always there and has no words.",
        example={"motors": ["Motor"], "lasers": {"match": ["Laser"], "expect": 2}},
    )
    components: list[ComponentEntry] | None = optional(
        "Components that are judged on their own; the first that matches is the one.",
        example=[{"match": "Laser", "stale_after": "90s"}],
    )
    values: list[ValueEntry] | None = optional(
        "How key-values are read; the first entry that matches is the one.",
        example=[{"key": "PID", "keep": False}],
    )
