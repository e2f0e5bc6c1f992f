"""The key `topics` of a profile: fields of small topics that become components of a robot."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, Any

from typing_extensions import override

from ros_diagnostics_exporter.config.conditions import LevelWord
from ros_diagnostics_exporter.config.errors import WrongValueError, quoted
from ros_diagnostics_exporter.config.keys import Entry, Value, Written, described, nothing
from ros_diagnostics_exporter.config.patterns import Equals
from ros_diagnostics_exporter.config.scalars import (
    MAX_NAME,
    MAX_TOPIC,
    NAME,
    Name,
    PositiveDuration,
    matching,
    text,
)

LEAST_EVERY = 1.0  # seconds: domains look at what has arrived about once a second
OTHER = "other"  # in levels: all that is not named there
_STEP = r"[A-Za-z][A-Za-z0-9_]*(?:\[(?:[0-9]{1,5}|\*|[A-Za-z][A-Za-z0-9_]*)\])?"
_PATH = rf"{_STEP}(?:\.{_STEP}){{0,9}}"
_WORD = f"^.{{1,{MAX_NAME}}}$"


def _topic_name(value: Any) -> str:
    remedy = "write it as `ros2 topic list` does, or without the robot's namespace: e_stop"
    return matching(value, NAME, "is not the name of a topic", remedy, MAX_TOPIC)


def _field_path(value: Any) -> str:
    remedy = "write it as percentage, status.level, cell_voltage[0] or effort[name]"
    return matching(value, _PATH, "is not the path of a field", remedy)


def _word(value: Any) -> str:
    word = text(value).strip()
    if not 1 <= len(word) <= MAX_NAME:
        remedy = "write a number, a word, true or false, or the name of a constant"
        raise WrongValueError(f"{quoted(word)} is not a value of a field", remedy)
    return word


def _folded(levels: dict[str, int]) -> Mapping[str, int]:
    folded = {word.casefold(): level for word, level in levels.items()}
    if len(folded) < len(levels):
        raise WrongValueError("has a word twice, as case is ignored", "give each one level")
    return MappingProxyType(folded)


TopicName = Annotated[
    str, Value(_topic_name, "topic", type="string", pattern=f"^{NAME}$", maxLength=MAX_TOPIC)
]
FieldPath = Annotated[
    str, Value(_field_path, "path of a field", type="string", pattern=f"^{_PATH}$")
]
Word = Annotated[str, Value(_word, "text", type="string", pattern=_WORD)]


class TopicEntry(Entry, title="Topic"):
    """A small topic of a robot, some fields of which are a component."""

    topic: TopicName = described(
        "The topic. Without a slash at its beginning it is in the robot's namespace.",
        example="battery_state",
    )
    component: Name = described(
        "The name of the component, in the group `Topics`.", example="Battery"
    )
    field: FieldPath | None = described(
        "The field that `levels` or `error_when` judges; it is a value of the component, too. A "
        "path has dots. `[0]` is one element of an array. `[*]` is all elements, named by their "
        "numbers. `[name]` is all elements, named by the array `name` beside it, or by their own "
        "field `name`.",
        example="safety_mode.mode",
        default=None,
    )
    fields: Annotated[Mapping[str, str], Written(dict[FieldPath, Word], MappingProxyType)] = (
        described(
            "Fields that become values of the component. Each has a key, which may have a unit. A "
            "number that is NaN or infinite is left out.",
            example={"percentage": "Charge", "voltage": "Voltage (V)"},
            default_factory=nothing,
        )
    )
    levels: Annotated[Mapping[str, int], Written(dict[Word, LevelWord], _folded)] = described(
        "The level for each value of `field`. A value is a number, text, true or false, or the "
        "name of a constant of the message, in upper or lower case. `other` stands for all values "
        "that are not named. Without `other` they are ERROR.",
        example={"NORMAL": "OK", "2": "WARN", "other": "ERROR"},
        default_factory=nothing,
    )
    error_when: Equals = described(
        "In place of `levels`: the value of `field`, or a list of values, that is ERROR; all "
        "others are OK.",
        example=True,
        default=(),
    )
    every: PositiveDuration = described(
        "The least time between two messages that are read. If half of the robot's `stale_after` "
        "is shorter, that counts, so that the robot is not silent between the two.",
        example="5s",
        default=1.0,
    )

    @override
    def completed(self, given: Mapping[str, Any]) -> "TopicEntry":
        if self.levels and self.error_when:
            raise WrongValueError("has levels and error_when", "keep one of them")
        judged = "levels" if self.levels else "error_when" if self.error_when else ""
        if judged and self.field is None:
            raise WrongValueError(f"has {judged} and no field", "name the field: field: mode")
        if self.field is None and not self.fields:
            raise WrongValueError(
                "has neither field nor fields, so it says nothing",
                "add fields: {percentage: Charge}, or field: and levels:",
            )
        if self.every < LEAST_EVERY:
            what = f"is {self.every:g}s, and topics are read once a second at most"
            raise WrongValueError(what, "write 1s or more", ("every",))
        return self

    def name_in(self, namespace: str, prefix: str = "") -> str:
        """The full name of the topic of a robot in a namespace; ``prefix`` is of zenoh's keys."""
        is_full = self.topic.startswith("/")
        return prefix + self.topic if is_full else f"{namespace}/{self.topic}"

    @property
    def paths(self) -> Mapping[str, str]:
        """The key of the value of each field that is read."""
        judged = {} if self.field is None or self.field in self.fields else {self.field: self.field}
        return {**judged, **self.fields}
