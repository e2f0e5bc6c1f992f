"""What became of each directive: translated, without equivalent, or both, each with its reasons.

Nothing is lost silently: what nobody took is reported by `report`.
"""

from __future__ import annotations

from collections.abc import Iterable
from enum import IntEnum

from ros_diagnostics_tools.nagios.importer.files import Directive


class Effect(IntEnum):
    """What a line that has no equivalent means to those who were notified, the worst first."""

    NO_LONGER = 0  # Nagios notified, and nobody does here
    OTHERWISE = 1  # it is notified at another time, of another state, or in another way
    INFORMATION = 2  # no notification depends on it


class ImportLedger:
    """The account of all directives."""

    def __init__(self) -> None:
        self._translated: dict[Directive, dict[str, None]] = {}
        self._lost: dict[Directive, dict[str, None]] = {}
        self._parts: dict[Directive, Effect] = {}

    def translated(self, directives: Iterable[Directive], where: str) -> None:
        """Note that the directives are in the output, at ``where``."""
        for each in directives:
            self._translated.setdefault(each, {})[where] = None

    def lost(
        self,
        directives: Iterable[Directive],
        remedy: str,
        part: Effect = Effect.INFORMATION,
    ) -> None:
        """Note that they, or a part of what they say, have no equivalent, and what to do."""
        for each in directives:
            self._lost.setdefault(each, {})[remedy] = None
            self._parts[each] = min(part, self._parts.get(each, part))

    def withdraw(self, directives: Iterable[Directive], where: str, remedy: str) -> None:
        """Note that nothing came of the directives at ``where`` after all, and what to do."""
        for each in directives:
            kept = {at: None for at in self._translated.pop(each, {}) if not at.startswith(where)}
            if kept:
                self._translated[each] = kept
            else:
                self.lost((each,), remedy)

    def knows(self, directive: Directive) -> bool:
        """Whether the directive is accounted for."""
        return directive in self._translated or directive in self._lost

    @property
    def lost_rows(self) -> list[tuple[Directive, tuple[str, ...]]]:
        """What has no equivalent, by file and line."""
        return _rows(self._lost)

    def lost_in(self, part: Effect) -> list[tuple[Directive, tuple[str, ...]]]:
        """The rows of one part."""
        return [row for row in self.lost_rows if self._parts[row[0]] is part]

    @property
    def translated_rows(self) -> list[tuple[Directive, tuple[str, ...]]]:
        """What is translated, by file and line."""
        return _rows(self._translated)


def _rows(named: dict[Directive, dict[str, None]]) -> list[tuple[Directive, tuple[str, ...]]]:
    ordered = sorted(named, key=lambda each: (str(each.path), each.line))
    return [(each, tuple(named[each])) for each in ordered]
