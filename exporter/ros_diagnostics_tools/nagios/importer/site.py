"""The objects of a site and how they refer to one another: groups, services, contacts, commands."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from ros_diagnostics_exporter.regex import Pattern, RegexError
from ros_diagnostics_tools.nagios.importer.files import Directive, NagiosError
from ros_diagnostics_tools.nagios.importer.inheritance import Thing, leading_number
from ros_diagnostics_tools.nagios.importer.ledger import ImportLedger

MOST_GROUPS = 200  # within one group
SECONDS = 60.0  # interval_length of Nagios where nagios.cfg does not say


@dataclass(frozen=True)
class Service:
    """One service on one host."""

    thing: Thing
    host: Thing

    @property
    def name(self) -> str:
        """Its description."""
        return self.thing.get("service_description")

    def inherited(self, key: str) -> Thing:
        """The object that says ``key``: the service, or its host (implied inheritance)."""
        return self.thing if key in self.thing.values or key not in self.host.values else self.host


@dataclass
class Site:
    """All objects by kind and name, and the settings of the main file."""

    ledger: ImportLedger
    settings: dict[str, Directive]
    things: dict[str, list[Thing]] = field(default_factory=dict)
    macros: dict[str, Directive] = field(default_factory=dict)

    def all(self, kind: str) -> list[Thing]:
        """All objects of a kind, in the order of the files."""
        return self.things.get(kind, [])

    def find(self, kind: str, name: str) -> Thing | None:
        """The object of a name."""
        return self._by_name(kind).get(name)

    def _by_name(self, kind: str) -> dict[str, Thing]:
        if kind not in self._names:
            found = self.all(kind)
            self._names[kind] = {each.get(f"{kind}_name"): each for each in found}
        return self._names[kind]

    def __post_init__(self) -> None:
        self._names: dict[str, dict[str, Thing]] = {}
        self.hours: dict[str, Any] = {}  # of timeperiods, once they are read
        self._members: dict[str, dict[str, list[str]]] = {}
        self.services: list[Service] = []
        self._services: dict[str, dict[str, Service]] = {}

    def index_services(self) -> None:
        """Put each service on its hosts; the last of a name wins, as in Nagios."""
        for thing in self.all("service"):
            for name in self.hosts_of(thing, "the hosts that have this service"):
                host = self.find("host", name)
                if host is None:
                    thing.lose("host_name", f"there is no host {name}")
                else:
                    service = Service(thing, host)
                    self._services.setdefault(name, {})[service.name] = service
        self.services = [each for of_host in self._services.values() for each in of_host.values()]

    def service(self, host: str, description: str) -> Service | None:
        """One service of a host."""
        return self._services.get(host, {}).get(description)

    # -- groups ------------------------------------------------------------------------------

    def members(self, kind: str) -> dict[str, list[str]]:
        """Of all groups of a kind (``host`` or ``contact``) the names of their members."""
        if kind not in self._members:
            groups = {each.get(f"{kind}group_name"): each for each in self.all(f"{kind}group")}
            self._members[kind] = {
                name: list(dict.fromkeys(self._of_group(kind, groups, name, set())))
                for name in groups
            }
        return self._members[kind]

    def _of_group(
        self, kind: str, groups: dict[str, Thing], name: str, seen: set[str]
    ) -> Iterator[str]:
        if name in seen or name not in groups:
            return
        seen.add(name)
        if len(seen) > MOST_GROUPS:
            place = groups[name].definition
            raise NagiosError(
                f"{place.path}:{place.line}: more than {MOST_GROUPS} groups are within one another"
            )
        where = f"the members of {kind}group {name}"
        groups[name].take("members", where)
        yield from self.names(kind, groups[name].list("members"))
        groups[name].take(f"{kind}group_members", where)
        for inner in groups[name].list(f"{kind}group_members"):
            yield from self._of_group(kind, groups, inner, seen)
        key = "hostgroups" if kind == "host" else "contact_groups"
        for each in self.all(kind):
            if name in each.list(key):
                each.take(key, where)
                yield each.get(f"{kind}_name")

    def names(self, kind: str, written: Iterable[str]) -> list[str]:
        """The objects that a list names: names, ``*``, ``!name``, or regular expressions."""
        known = list(self._by_name(kind))
        chosen: dict[str, None] = {}
        for each in written:
            if each.startswith("!"):
                chosen.pop(each[1:], None)
            elif each == "*":
                chosen.update(dict.fromkeys(known))
            else:
                chosen.update(dict.fromkeys(self._matching(each, known)))
        excluded = {each[1:] for each in written if each.startswith("!")}
        return [each for each in chosen if each not in excluded]

    def _matching(self, written: str, known: list[str]) -> list[str]:
        everywhere = self.setting("use_true_regexp_matching", "0") == "1"
        if everywhere or (
            self.setting("use_regexp_matching", "0") == "1" and set(written) & set("*?+\\")
        ):
            try:
                pattern = Pattern(written)
            except RegexError:
                return [written]
            return [each for each in known if pattern.search(each)]
        return [written]

    def hosts_of(self, thing: Thing, where: str, prefix: str = "") -> list[str]:
        """The hosts that an object names by ``host_name`` and ``hostgroup_name``."""
        thing.take(f"{prefix}host_name", where)
        thing.take(f"{prefix}hostgroup_name", where)
        groups = thing.list(f"{prefix}hostgroup_name")
        members = self.members("host")
        everything = self.names("host", ["*"]) if "*" in groups else []
        found = [
            *self.names("host", [e for e in thing.list(f"{prefix}host_name") if e[0] != "!"]),
            *everything,
        ]
        for group in groups:
            found += members.get(group, [])
        excluded = {each[1:] for each in thing.list(f"{prefix}host_name") if each.startswith("!")}
        for group in groups:
            if group.startswith("!"):
                excluded.update(members.get(group[1:], []))
        return [each for each in dict.fromkeys(found) if each not in excluded]

    # -- settings and commands ---------------------------------------------------------------

    def setting(self, name: str, default: str) -> str:
        """A value of the main file."""
        return self.settings[name].value if name in self.settings else default

    def take_setting(self, name: str, default: str, where: str) -> str:
        """A value of the main file that is translated."""
        if name in self.settings:
            self.ledger.translated((self.settings[name],), where)
        return self.setting(name, default)

    def take_number(self, name: str, default: float, where: str) -> float:
        """A number of the main file that is translated, as Nagios reads it."""
        found = leading_number(self.take_setting(name, str(default), where))
        return default if found is None else found

    def seconds(self, units: float) -> float:
        """Nagios' time units in seconds."""
        return units * self.take_number("interval_length", SECONDS, "all intervals")

    def command_line(self, service: Service) -> str:
        """The command line of a service's check, macros filled in as far as they are known."""
        name, *arguments = _split_command(service.thing.get("check_command"))
        command = self.find("command", name)
        if command is None:
            return ""
        values = {f"ARG{number}": text for number, text in enumerate(arguments, 1)}
        return self.filled(command.get("command_line"), service.host, service, values)

    def filled(
        self,
        text: str,
        host: Thing,
        service: Service | None,
        values: Mapping[str, str] | None = None,
    ) -> str:
        """A text of a host or service with its macros, and ``values``, as far as they are known."""
        return _filled(text, self._macro(host, service, values or {}))

    def _macro(
        self, host: Thing, service: Service | None, values: Mapping[str, str]
    ) -> Callable[[str], str | None]:
        fixed = {
            **values,
            "HOSTNAME": host.get("host_name"),
            "HOSTADDRESS": host.get("address") or host.get("host_name"),
            "HOSTALIAS": host.get("alias"),
            "HOSTDISPLAYNAME": host.get("display_name"),
            **({"SERVICEDESC": service.name} if service else {}),
        }

        def value(name: str) -> str | None:
            if name.startswith("_HOST"):
                return host.get(f"_{name[5:].upper()}")
            if service and name.startswith("_SERVICE"):
                return service.thing.get(f"_{name[8:].upper()}")
            if name.startswith("ARG"):
                return fixed.get(name, "")
            if (macro := self.macros.get(f"${name}$")) is not None:
                self.ledger.translated((macro,), "the command lines that use it")
                return macro.value
            return fixed.get(name)

        return value


def _split_command(text: str) -> list[str]:
    return [each.replace("\\!", "!") for each in re.split(r"(?<!\\)!", text)]


def _filled(text: str, value: Callable[[str], str | None]) -> str:
    """Text with its macros filled in; of a macro's own value again, as Nagios does with $ARGn$."""

    def one(match: re.Match[str]) -> str:
        found = "$" if not match[1] else value(match[1])
        return match[0] if found is None else found

    return re.sub(r"\$([A-Za-z0-9_]*)\$", one, re.sub(r"\$(ARG\d+)\$", one, text))
