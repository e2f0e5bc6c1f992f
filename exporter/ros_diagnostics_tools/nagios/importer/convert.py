"""The whole conversion: files in, texts out."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import yaml

from ros_diagnostics_exporter.config.errors import WrongValueError
from ros_diagnostics_exporter.config.scalars import time_zone
from ros_diagnostics_tools.nagios.importer import (
    advice,
    computers,
    files,
    inhibition,
    robots,
    rotas,
    routes,
)
from ros_diagnostics_tools.nagios.importer.files import Definition, Directive, NagiosError
from ros_diagnostics_tools.nagios.importer.inheritance import NOT_INHERITED, Templates, Thing
from ros_diagnostics_tools.nagios.importer.ledger import Effect, ImportLedger
from ros_diagnostics_tools.nagios.importer.merge import merged
from ros_diagnostics_tools.nagios.importer.site import Site

FLEET, QUERIES, ROUTES, ONCALL, REPORT = (
    *("fleet.yml", "queries.d/hosts.yml", "alertmanager-routes.yml"),
    *("oncall.yml", "report.txt"),
)
MERGED = "alertmanager.yml"  # in place of ROUTES
MADE = "Made by ros-diagnostics nagios import"
HEADERS = {
    FLEET: f"{MADE}. Namespaces are made of names: compare with `ros2 topic list`.",
    QUERIES: f"{MADE}. The jobs are those at the end of prometheus/prometheus.yml.",
    ROUTES: f"{MADE}: put each list before what the list of the same name in\n"
    "# alertmanager.yml has (routes: those below route).",
    ONCALL: f"{MADE}: contacts that relieve one another. Until it is built into\n"
    "# alertmanager.yml, all of them receive what their receiver is sent.",
}


TITLES = {
    Effect.NO_LONGER: "No longer notified",
    Effect.OTHERWISE: "Notified otherwise",
    Effect.INFORMATION: "For your information",
}


class ImportOptions(NamedTuple):
    """What the files do not say."""

    fleet: str
    plugins: tuple[str, ...] = ()
    time_zone: str | None = None  # None: use_timezone of nagios.cfg, else UTC
    into: Path | None = None  # the alertmanager.yml that is merged with the routes


class Converted(NamedTuple):
    """The files to write, by name, what became of each directive, and how many robots there are.

    ``commands`` are those of all services, for who has to name the ROS plug-in.
    """

    texts: dict[str, str]
    ledger: ImportLedger
    robots: int
    commands: tuple[str, ...]


def convert(paths: list[Path], options: ImportOptions) -> Converted:
    """Convert the objects of ``paths``, main files, object files and folders.

    Raises:
        NagiosError: Nagios would not read them.
    """
    found, ledger = files.read(paths), ImportLedger()
    templates = Templates(found.definitions, ledger)
    site = _site(found, templates, ledger)
    its_robots = robots.find(site, options.plugins)
    zone = _time_zone(site, options.time_zone)
    fleet = robots.fleet(site, its_robots, options.fleet, zone)
    routing = routes.routing(site, its_robots, zone)
    oncall = rotas.content(site, routing.rotas, zone)
    rules = inhibition.rules(site, its_robots)
    uplinks = [each["name"] for each in fleet["robots"] if each.get("source") == "queries"]
    asked = computers.queries(site, its_robots, uplinks)
    _account_for_commands(site, its_robots)
    _account_for_rest(found, templates, ledger)
    contents: dict[str, Any] = {
        FLEET: fleet,
        **({QUERIES: asked} if asked else {}),
        ROUTES: routing.content(rules),
        **({ONCALL: oncall} if oncall else {}),
    }
    texts = {name: _yaml(name, content) for name, content in contents.items()}
    commands = {each.thing.get("check_command").partition("!")[0] for each in site.services}
    if options.into is not None:
        del texts[ROUTES]
        texts[MERGED] = merged(options.into, routing.content(rules), _dumped)
    texts[REPORT] = report(ledger)
    return Converted(texts, ledger, len(its_robots), tuple(sorted(commands)))


def _time_zone(site: Site, given: str | None) -> str:
    """The zone of all hours: what the user says, else use_timezone of nagios.cfg, else UTC."""
    if given is not None or "use_timezone" not in site.settings:
        return given or "UTC"
    try:
        return str(time_zone(site.take_setting("use_timezone", "UTC", "the zone of all hours")))
    except WrongValueError as error:
        raise NagiosError(f"use_timezone: {error}; name the zone with --time-zone") from None


def _site(files_read: files.Read, templates: Templates, ledger: ImportLedger) -> Site:
    settings = {each.key: each for each in files_read.settings if each.kind == "main"}
    macros = {each.key: each for each in files_read.settings if each.kind == "resource"}
    things: dict[str, list[Thing]] = {}
    for thing in templates.things():
        things.setdefault(thing.kind, []).append(thing)
    site = Site(ledger, settings, things, macros)
    site.index_services()
    return site


def _account_for_commands(site: Site, its_robots: list[robots.Robot]) -> None:
    for robot in its_robots:
        for service, _ in robot.services:
            name = service.thing.get("check_command").partition("!")[0]
            command = site.find("command", name)
            if command is not None:
                command.take("command_name", "the checks of services")
                command.take("command_line", "the checks of services")


def _account_for_rest(files_read: files.Read, templates: Templates, ledger: ImportLedger) -> None:
    """Report every line that nothing has translated or reported."""
    for setting in files_read.settings:
        if setting in files_read.skipped:
            ledger.lost((setting,), files.NOT_FOLLOWED)
        elif setting.key in files.INCLUDES:
            ledger.translated((setting,), "read")
    for definition in files_read.definitions:
        for each in definition.directives:
            if not ledger.knows(each):
                ledger.lost((each,), *_why(definition, each, templates))
    for each in files_read.settings:
        if not ledger.knows(each):
            ledger.lost((each,), advice.advice(each), advice.effect(each))


def _why(definition: Definition, directive: Directive, templates: Templates) -> tuple[str, Effect]:
    if not templates.is_used(definition):
        return "no object inherits from this template", Effect.INFORMATION
    if directive not in templates.effective and directive.key not in NOT_INHERITED:
        why = "overridden: by a later line of the object, or by all objects that inherit it"
        return why, Effect.INFORMATION
    return advice.advice(directive), advice.effect(directive)


def report(ledger: ImportLedger) -> str:
    """What became of each line: what has no equivalent and what to do, then where others went."""
    parts = {
        title: [f"{_line(each)}: {'; '.join(why)}" for each, why in ledger.lost_in(part)]
        for part, title in TITLES.items()
    }
    parts["Translated"] = [
        f"{_line(each)} -> {'; '.join(where)}" for each, where in ledger.translated_rows
    ]
    texts = ("\n".join((f"{title} ({len(lines)}):", *lines)) for title, lines in parts.items())
    return "\n\n".join(texts) + "\n"


def _line(directive: Directive) -> str:
    owner = " ".join(filter(None, (directive.kind, directive.owner)))
    return f"{directive.place}: {owner}: {directive.written} {advice.shown(directive)}".rstrip()


def _yaml(name: str, content: Any) -> str:
    return f"# {HEADERS[name]}\n{_dumped(content)}"


def _dumped(content: Any) -> str:
    return yaml.dump(
        content,
        Dumper=_Dumper,
        sort_keys=False,
        default_flow_style=None,
        allow_unicode=True,
        width=200,
    )


class _Dumper(yaml.SafeDumper):
    """Without anchors: what two receivers have in common is written twice."""

    def represent_str(self, data: str) -> yaml.ScalarNode:
        """A text of several lines as it is."""
        style = "|" if "\n" in data else None
        return self.represent_scalar("tag:yaml.org,2002:str", data, style=style)

    def ignore_aliases(self, data: Any) -> bool:  # noqa: ARG002 - of the base class
        return True


_Dumper.add_representer(str, _Dumper.represent_str)
