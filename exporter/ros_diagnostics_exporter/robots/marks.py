"""What changed of one robot: noted where it changes, read by whoever makes something of it."""

from __future__ import annotations

from collections.abc import Callable
from operator import attrgetter
from typing import Any, Generic, TypeVar

T = TypeVar("T")


class Mark:
    """What of a robot changed; plain numbers, because an enum's members cost more to look up."""

    NAMES = 0  # a component was added, removed or has another name
    SERIES = 1  # which values are exported, or a hardware_id
    LEVEL = 2  # a component's level, or how it is judged
    VALUE = 3  # a component's number that the config judges
    NUMBER = 4  # any other number
    DETAILS = 5  # a message, why trouble is suppressed, a fault, what faults/ keeps of a component
    GROUPS = 6
    RECEIPT = 7  # messages, whether it is up, what the network shows
    REJECTED = 8
    CONFIG = 9  # its settings, and how the config comes to have it
    DOWNTIME = 10
    GOALS = 11  # of its actions


MARKS = 12  # how many there are


class Marks(Generic[T]):
    """One robot's marks, some of a component (T), each with the number of its last change.

    ``count`` is the number of the last change, ``at`` that of the last of each mark. A reader keeps
    the one up to which it has read, -1 at first: what was noted after that is new to it.
    """

    __slots__ = ("_of", "at", "count")

    def __init__(self) -> None:
        self.count = 0
        self.at = [0] * MARKS
        # Of each component when it was noted last, the latest last.
        self._of: dict[int, dict[T, int]] = {Mark.LEVEL: {}, Mark.VALUE: {}}

    def note(self, mark: int, component: T | None = None) -> None:
        """Note a change; LEVEL and VALUE with the component of which it is."""
        self.count += 1
        self.at[mark] = self.count
        if component is not None:
            of = self._of[mark]
            if component is not next(reversed(of), None):  # else it stays the latest, in its place
                of.pop(component, None)
            of[component] = self.count

    def last(self, *marks: int) -> int:
        """The number of the last change of any of these."""
        return max([self.at[mark] for mark in marks])

    def components(self, mark: int, since: int) -> list[T]:
        """The components of which LEVEL or VALUE was noted after ``since``, the latest last."""
        found = []
        for component, number in reversed(self._of[mark].items()):
            if number <= since:
                break
            found.append(component)
        return found[::-1]

    def forget(self, component: T) -> None:
        """Forget a component that was removed."""
        for of in self._of.values():
            of.pop(component, None)


def marking(**marks: int) -> Callable[[type[T]], type[T]]:
    """Have attributes of a class note these in the ``marks`` of its objects when they change.

    What an object has first is no change.
    """

    def wrapped(of: type[T]) -> type[T]:
        for name, mark in marks.items():
            setattr(of, name, _marked(of, name, mark))
        return of

    return wrapped


def _marked(of: type, name: str, mark: int) -> property:
    slot = vars(of).get(name)
    read: Callable[[Any], object] = attrgetter(f"_{name}") if slot is None else slot.__get__

    def put(instance: Any, value: object) -> None:
        is_first = False
        try:
            if read(instance) == value:
                return
        except AttributeError:
            is_first = True
        if slot is None:
            vars(instance)[f"_{name}"] = value
        else:
            slot.__set__(instance, value)
        if not is_first:
            instance.marks.note(mark)

    return property(read, put)
