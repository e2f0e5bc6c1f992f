"""The keys `actions` and `modes` of a profile: whether a robot does its work, and when not."""

from collections.abc import Mapping
from functools import cached_property
from typing import Annotated, Any

from pydantic import BeforeValidator, Field
from typing_extensions import override

from ros_diagnostics_exporter.config.conditions import Condition, ConditionList
from ros_diagnostics_exporter.config.errors import WrongValueError
from ros_diagnostics_exporter.config.keys import Entry, Written, described
from ros_diagnostics_exporter.config.patterns import Equals, Wildcards, Words, written
from ros_diagnostics_exporter.config.scalars import PositiveDuration

MOST_COUNTED = 100  # goals of one action that an entry may count
Count = Annotated[int, Field(ge=1, le=MOST_COUNTED)]


def _alternatives(value: Any) -> Any:
    """Names of ROS have no bar, so one between them separates them."""
    return value.split("|") if isinstance(value, str) and "|" in value else value


ActionNames = Annotated[Wildcards, BeforeValidator(_alternatives, json_schema_input_type=Wildcards)]


class TooMany(Entry, title="Count"):
    """How many goals of an action are too many."""

    warning: Count | None = described("This many are a WARNING.", example=2, default=None)
    critical: Count | None = described("This many are CRITICAL.", example=4, default=None)
    within: PositiveDuration = described(
        "Within this time. Time in which the robot is not received does not count.",
        example="30m",
        default=600.0,
    )

    @override
    def completed(self, given: Mapping[str, Any]) -> "TooMany":
        if self.warning is None and self.critical is None:
            what = "has neither warning nor critical, so nothing is too many"
            raise WrongValueError(what, "give one, such as {critical: 3}")
        if self.warning and self.critical and self.warning > self.critical:
            what = f"warning ({self.warning}) is above critical ({self.critical})"
            raise WrongValueError(what, "let warning be the smaller number")
        return self


class ActionRule(Entry, title="Action"):
    """Which goals of an action are faults; the first entry that matches applies."""

    patterns: ActionNames = described(
        "The action's name in the robot's namespace, or its full name; `*` stands for anything. "
        "Several in a list, or with `|` between them.",
        example="spin|backup|wait",
        key="match",
    )
    aborted: TooMany | None = described(
        "This many aborted goals are a fault. It is over when as many goals in a row have "
        "succeeded, or when `within` has passed.",
        example={"warning": 2, "critical": 4, "within": "10m"},
        default=None,
    )
    started: TooMany | None = described(
        "This many goals are a fault, however they end. Use it for recoveries such as `spin`.",
        example={"warning": 3, "within": "10m"},
        default=None,
    )
    longer_than: PositiveDuration | None = described(
        "A goal that runs for longer is a WARNING.", example="15m", default=None
    )
    ignore_result: bool = described(
        "The action's goals are no work of the robot, so they are in no success ratio.",
        example=True,
        default=False,
    )

    @override
    def completed(self, given: Mapping[str, Any]) -> "ActionRule":
        if self.ignore_result and self.aborted is not None:
            what = "ignores how goals end (ignore_result) and counts those that were aborted"
            raise WrongValueError(what, "remove ignore_result or aborted")
        return self

    def matches(self, *names: str) -> bool:
        """Whether the entry is about an action that has these names."""
        return any(each.fullmatch(name) for each in self.patterns for name in names)


class Modes(Entry):
    """Where a robot says whether it works by itself; leaving that is an intervention."""

    component: Words = described(
        "The component that has the mode: its name contains one of these words, in upper or lower "
        "case.",
        example="Mode",
    )
    key: Wildcards = described("The key of the mode.", example="mode")
    autonomous: Equals = described(
        "The modes in which the robot works by itself, in upper or lower case; `*` stands for "
        "anything.",
        example=["auto", "mission"],
    )
    interventions: ConditionList = described(
        "It is an intervention, too, if one of these conditions becomes true while the robot works "
        "by itself.",
        example={"component": "E-stop", "key": "pressed", "equals": True},
        default=(),
    )

    @override
    def completed(self, given: Mapping[str, Any]) -> "Modes":
        if any(not each.component for each in self.interventions):
            what = "has a condition in interventions that names no component"
            remedy = "add one, such as {component: E-stop, key: pressed, equals: true}"
            raise WrongValueError(what, remedy)
        return self

    @cached_property
    def condition(self) -> Condition:
        """What holds while the robot works by itself."""
        parts = (written(self.component), written(self.key), "is", written(self.autonomous))
        return Condition(" ".join(parts), self.component, (), self.key, self.autonomous)


ActionRules = Annotated[tuple[ActionRule, ...], Written(list[ActionRule], tuple)]


def rule_for(rules: tuple[ActionRule, ...], namespace: str, action: str) -> ActionRule | None:
    """The entry for an action by its name in the robot's namespace."""
    full = f"{namespace}/{action}"
    return next((each for each in rules if each.matches(action, full)), None)
