"""What `when` and `unless` of fleet.yml ask about a robot's components and their values."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field
from typing_extensions import override

from ros_diagnostics_exporter.config.errors import WrongValueError, quoted
from ros_diagnostics_exporter.config.keys import Entry, Value, Written, described
from ros_diagnostics_exporter.config.patterns import Equals, Wildcards, Words, written

MAX_CONDITIONS = 10  # of one when or unless
LEVELS = {"OK": 0, "WARN": 1, "ERROR": 2, "STALE": 3}
LEVEL_NAMES = "|".join("".join(f"[{each}{each.lower()}]" for each in name) for name in LEVELS)
_MOST_WORDS = 200  # characters of a condition as it is shown; what it matches may be longer


def level(value: Any, others: str = "") -> int:
    """The number of a level's name; ``others`` says what else the file may have there."""
    found = LEVELS.get(value.upper()) if isinstance(value, str) else None
    if found is None:
        what = f"{quoted(value)} is no level"
        raise WrongValueError(what, f"use one of {', '.join(LEVELS)}{others}")
    return found


LevelWord = Annotated[int, Value(level, "level", type="string", pattern=f"^({LEVEL_NAMES})$")]


def _list_of_one(value: Any) -> Any:
    if value == []:
        raise WrongValueError("is an empty list", "remove it or fill it in")
    return value if isinstance(value, list) else [value]


def _one_or_more(kind: Any, most: int | None = None) -> Any:
    """A list in the file, or the only one of it without a list."""
    only = BeforeValidator(_list_of_one, json_schema_input_type=kind | list[kind])
    return Annotated[list[kind], Field(min_length=1, max_length=most), only]


class Condition(Entry):
    """What a component, or a value, of the same robot has to be like."""

    text: str = ""  # for people
    component: Words = described(
        "The component's name contains one of these words, in upper or lower case. If several "
        "components match, one of them is enough. Without it, the component itself.",
        example="Charger",
        default=(),
    )
    levels: Annotated[
        tuple[int, ...],
        Written(
            _one_or_more(Literal["OK", "WARN", "ERROR"]),
            lambda words: tuple(LEVELS[each] for each in words),
        ),
    ] = described(
        "The component has this level, or one of this list. In place of `key`.",
        example="ERROR",
        default=(),
        key="level",
    )
    key: Wildcards = described(
        "The key of one of its values.", example="Charging state", default=()
    )
    texts: Equals = described(
        "The driver publishes this text, or one of this list, in upper or lower case; `*` stands "
        "for anything. Or {regex: ...}, matched against the whole text.",
        example="charging",
        default=(),
        key="equals",
    )
    below: float | None = described(
        "The number is below this. It counts as it is exported: after `enum`, `scale` and "
        "`offset`.",
        example=20,
        default=None,
    )
    above: float | None = described(
        "The number is above this, as it is exported.", example=0.5, default=None
    )

    @override
    def completed(self, given: Mapping[str, Any]) -> "Condition":
        if bool(self.levels) == bool(self.key):
            what = "has level and key" if self.key else "has neither level nor key"
            remedy = (
                "give one: {component: Gripper, level: ERROR} or {key: State, equals: charging}"
            )
            raise WrongValueError(what, remedy)
        if self.levels and not self.component:
            what = "is about the component's own level"
            raise WrongValueError(what, "name another component, or use levels to change a level")
        is_number = self.below is not None or self.above is not None
        if self.levels and (is_number or self.texts):
            raise WrongValueError("compares a level with a value", "give key in place of level")
        if self.key and is_number == bool(self.texts):
            what = (
                "compares a text and a number" if is_number else "compares the value with nothing"
            )
            raise WrongValueError(what, "give equals, or below, above or both of these")
        if self.below is not None and self.above is not None and self.below <= self.above:
            what = f"never holds: nothing is above {self.above:g} and below {self.below:g}"
            raise WrongValueError(what, "give one of them, or two conditions")
        return replace(self, text=" ".join(filter(None, self._in_words()))[:_MOST_WORDS])

    def _in_words(self) -> Iterator[str]:
        """The condition as people read it: "Charger State is charging"."""
        yield written(self.component)
        yield written(self.key)
        yield "is"
        yield " or ".join(word for word, level in LEVELS.items() if level in self.levels)
        yield written(self.texts)
        bounds = (("above", self.above), ("below", self.below))
        yield " and ".join(f"{word} {number:g}" for word, number in bounds if number is not None)


ConditionList = Annotated[
    tuple[Condition, ...], Written(_one_or_more(Condition, most=MAX_CONDITIONS), tuple)
]


@dataclass(frozen=True)
class Conditions:
    """When a component's or a value's trouble is a fault: all of ``when``, none of ``unless``."""

    when: tuple[Condition, ...] = ()
    unless: tuple[Condition, ...] = ()


class Conditional:
    """What has the keys ``when`` and ``unless``."""

    when: tuple[Condition, ...]
    unless: tuple[Condition, ...]

    @cached_property
    def conditions(self) -> Conditions | None:
        """Of its faults; None = always."""
        return Conditions(self.when, self.unless) if self.when or self.unless else None
