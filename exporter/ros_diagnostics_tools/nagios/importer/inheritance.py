"""Definitions with their templates filled in, as Nagios does it.

https://assets.nagios.com/downloads/nagioscore/docs/nagioscore/4/en/objectinheritance.html
"""

from __future__ import annotations

import re
from collections.abc import Iterable

from ros_diagnostics_tools.nagios.importer.files import Definition, Directive, NagiosError
from ros_diagnostics_tools.nagios.importer.ledger import Effect, ImportLedger

NOT_INHERITED = frozenset({"name", "use", "register"})
# What a leading + adds to: the lists that xodtemplate.c passes to get_inherited_string.
ADDITIVE = frozenset(
    {
        *("members", "contactgroup_members", "hostgroup_members", "servicegroup_members"),
        *("host_name", "hostgroup_name", "servicegroup_name", "service_description"),
        *("dependent_host_name", "dependent_hostgroup_name", "dependent_servicegroup_name"),
        *("dependent_service_description", "contacts", "contact_groups", "parents", "hostgroups"),
        *("servicegroups", "host_notification_commands", "service_notification_commands"),
    }
)
NULL = "null"
DEEPEST = 100  # templates above one another
LONGEST = 1_000_000  # characters of a value that templates add to
_NUMBER = re.compile(r"\s*[-+]?(\d{1,15}(\.\d*)?|\.\d+)")

Values = dict[str, tuple[str, tuple[Directive, ...]]]


class Thing:
    """One object with everything that it inherits. ``values``: key -> value and its lines."""

    def __init__(self, definition: Definition, values: Values, ledger: ImportLedger) -> None:
        self.kind = definition.kind
        self.definition = definition
        self.values = values
        self._ledger = ledger

    def __contains__(self, key: str) -> bool:
        return self.get(key) != ""

    def get(self, key: str) -> str:
        """A value, "" where it is not given or ``null``; to look only, `take` accounts for it."""
        value = self.values.get(key, ("", ()))[0]
        return "" if value == NULL else value.removeprefix("+") if key in ADDITIVE else value

    def take(self, key: str, where: str) -> str:
        """A value that is translated, to ``where``."""
        self._ledger.translated(self.lines(key), where)
        return self.get(key)

    def lose(self, key: str, remedy: str, part: Effect = Effect.INFORMATION) -> None:
        """Report a value that is given and has no equivalent."""
        self._ledger.lost(self.lines(key), remedy, part)

    def withdraw(self, where: str, remedy: str) -> None:
        """Report that nothing came of it at ``where``, whatever was taken for that."""
        lines = (each for _, of_key in self.values.values() for each in of_key)
        self._ledger.withdraw(lines, where, remedy)

    def lines(self, key: str) -> tuple[Directive, ...]:
        """The lines that make up a value."""
        return self.values.get(key, ("", ()))[1]

    def list(self, key: str) -> list[str]:
        """A value with commas as a list."""
        return [each.strip() for each in self.get(key).split(",") if each.strip()]

    def number(self, key: str, default: float) -> float:
        """A numeric value, as Nagios reads it: what follows the number does not count."""
        text = self.get(key)
        if not text:
            return default
        found = leading_number(text)
        if found is None:
            self.lose(key, f"{text!r} is not a number, and 0 to Nagios", Effect.OTHERWISE)
        return found or 0.0


def leading_number(text: str) -> float | None:
    """The number that a text begins with, as C's ``atof`` reads it; None without one."""
    found = _NUMBER.match(text)
    return None if found is None else float(found[0])


class Templates:
    """Fills in the templates of all definitions."""

    def __init__(self, definitions: Iterable[Definition], ledger: ImportLedger) -> None:
        self._definitions = list(definitions)
        self._ledger = ledger
        self._named = {
            (each.kind, each.value("name")): each
            for each in self._definitions
            if each.value("name")
        }
        self._used: set[int] = set()
        self._filled: dict[int, Values] = {}
        self.effective: set[Directive] = set()

    def things(self) -> list[Thing]:
        """All objects, in the order of the files; templates with ``register 0`` are none."""
        made = []
        for each in self._definitions:
            if each.value("register") != "0":
                thing = Thing(each, self._resolved(each, ()), self._ledger)
                self.effective.update(line for _, lines in thing.values.values() for line in lines)
                made.append(thing)
                self._structure(each)
        return made

    def is_used(self, definition: Definition) -> bool:
        """Whether a definition is an object, or any object inherits from it."""
        return definition.value("register") != "0" or id(definition) in self._used

    def _resolved(self, definition: Definition, above: tuple[str, ...]) -> Values:
        if id(definition) not in self._filled:
            self._filled[id(definition)] = self._fill(definition, above)
        return dict(self._filled[id(definition)])

    def _fill(self, definition: Definition, above: tuple[str, ...]) -> Values:
        values: Values = {}
        for each in definition.directives:
            if each.key not in NOT_INHERITED:
                values[each.key] = (each.value, (each,))
        for name in dict.fromkeys(each.strip() for each in definition.value("use").split(",")):
            if not name:
                continue
            if len(above) > DEEPEST:
                raise NagiosError(
                    f"{definition.path}:{definition.line}: more than {DEEPEST} templates are above "
                    "one another; use fewer"
                )
            if name in above:
                way = " -> ".join((*above, name))
                raise NagiosError(
                    f"{definition.path}:{definition.line}: use runs in a circle: {way}"
                )
            template = self._named.get((definition.kind, name))
            if template is None:
                raise NagiosError(
                    f"{definition.path}:{definition.line}: use {name}: there is no "
                    f"{definition.kind} template of this name; read its file as well"
                )
            self._used.add(id(template))
            self._structure(template)
            _inherit(values, self._resolved(template, (*above, name)))
        return values

    def _structure(self, definition: Definition) -> None:
        lines = [each for each in definition.directives if each.key in NOT_INHERITED]
        self._ledger.translated(lines, "the objects that inherit, filled in")


def _inherit(values: Values, inherited: Values) -> None:
    """Fill in what ``values`` lack, and add to what begins with ``+``."""
    for key, (value, lines) in inherited.items():
        if key not in values:
            values[key] = (value, lines)
            continue
        own, own_lines = values[key]
        if key in ADDITIVE and own.startswith("+") and value not in ("", NULL):
            if len(value) + len(own) > LONGEST:
                raise NagiosError(f"{lines[0].place}: {key} is longer than {LONGEST:,} characters")
            values[key] = (f"{value},{own[1:]}", tuple(dict.fromkeys((*lines, *own_lines))))
