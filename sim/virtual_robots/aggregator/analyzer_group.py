"""AnalyzerGroup: the analyzers below a path, created from a node's parameters.

As upstream, the type and path of a failed analyzer also apply to the parameters that follow.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from virtual_robots.aggregator.analyzers import (
    Analyzer,
    DiscardAnalyzer,
    GenericAnalyzer,
    IgnoreAnalyzer,
    build_generic,
)
from virtual_robots.aggregator.parameters import Parameters
from virtual_robots.aggregator.status_item import MESSAGE_OF_LEVEL, StatusItem, missing_item
from virtual_robots.model import ERROR, OK, STALE, Status

LOAD_FAILED = "Pluginlib exception loading analyzer"
INIT_FAILED = "Analyzer init failed"
WHY_INIT_FAILS = (
    "is rejected by the real diagnostic_aggregator: an analyzer needs startswith, contains, regex"
    " or find_and_remove_prefix ('name' and 'expected' alone match nothing), a group needs"
    " analyzers of which none is rejected"
)


@dataclass
class AnalyzerGroup:
    """Analyzers below ``path``; ``stale_is_error`` is the roll-up of releases before 4.2.7."""

    path: str
    stale_is_error: bool = False
    analyzers: list[Analyzer] = field(default_factory=list)
    failures: list[StatusItem] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    _matched: dict[str, list[Analyzer]] = field(default_factory=dict)

    @property
    def complete(self) -> bool:
        """Whether all analyzers below it were created; otherwise the group fails as a whole."""
        return not self.failures and (bool(self.analyzers) or not self.path)

    @property
    def nice_name(self) -> str:
        """Its full path, unlike an analyzer's."""
        return self.path

    def match(self, name: str) -> bool:
        """Whether any analyzer below matches the name; cached, because it never changes."""
        if name not in self._matched:
            self._matched[name] = [a for a in self.analyzers if a.match(name)]
        return bool(self._matched[name])

    def analyze(self, item: StatusItem) -> bool:
        """Let every analyzer that matches the name store the item."""
        analyzed = [analyzer.analyze(item) for analyzer in self._matched[item.status.name]]
        return any(analyzed)

    def report(self, now: float) -> list[Status]:
        """The rows of all below, then the group's own (none at an empty path), then failures."""
        if not self.analyzers:
            # As upstream: the failures are not reported then.
            name = self.path if self.path not in {"", "/"} else "/AnalyzerGroup"
            return [Status(ERROR, name, "No analyzers")]
        output: list[Status] = []
        children: list[tuple[str, Status]] = []
        for analyzer in self.analyzers:
            rows = analyzer.report(now)
            output += rows
            children += [(analyzer.nice_name, r) for r in rows if r.name == analyzer.path]
        if self.path not in {"", "/"}:
            output.append(self._parent(children))
        return output + [item.to_status(self.path, stale=True) for item in self.failures]

    def _parent(self, children: list[tuple[str, Status]]) -> Status:
        level = rolled_up([row.level for _, row in children], stale_is_error=self.stale_is_error)
        values = tuple((nice_name, row.message) for nice_name, row in children)
        return Status(level, self.path, MESSAGE_OF_LEVEL[level], "", values)


def rolled_up(levels: list[int], *, stale_is_error: bool) -> int:
    """The level of a group over its children's (OK without any).

    4.2.7: the worst of OK, WARN, ERROR if that is not OK; else STALE if anything is. Before: any
    STALE beside something else is an ERROR.
    """
    worst = max((level for level in levels if level != STALE), default=OK)
    if STALE not in levels:
        return worst
    if stale_is_error:
        return STALE if set(levels) == {STALE} else ERROR
    return worst or STALE


def build_group(
    path: str, breadcrumb: str, parameters: Parameters, now: float, *, stale_is_error: bool
) -> AnalyzerGroup:
    """A group from the parameters below ``breadcrumb``.

    The real one keeps the type and the path that it saw last until an analyzer was made of them,
    so a type that cannot be loaded is tried, and fails, again at each parameter that follows.
    Failures are also in the group's ``warnings``.
    """
    group = AnalyzerGroup(path, stale_is_error)
    kind = below = ""
    for name, full_name in parameters.under(breadcrumb).items():
        owner = _owner(name)
        if name == f"{owner}.type":
            kind = parameters.printed(full_name)
        if name == f"{owner}.path":
            below = parameters.printed(full_name)
        if not kind or not below:
            continue
        if kind not in KINDS:
            group.failures.append(missing_item(owner, now, LOAD_FAILED))
            if name == f"{owner}.type":
                _warn(group, parameters, full_name, f"{kind!r} is none of {', '.join(KINDS)}")
            continue
        below = f"{path}/{below}" if kind.endswith("Group") else path
        inner = f"{breadcrumb}.{owner}" if breadcrumb else owner
        analyzer = _build(kind, below, inner, parameters, now, stale_is_error=stale_is_error)
        if isinstance(analyzer, AnalyzerGroup):
            group.warnings += analyzer.warnings
        if analyzer is None or (isinstance(analyzer, AnalyzerGroup) and not analyzer.complete):
            group.failures.append(missing_item(owner, now, INIT_FAILED))
            _warn(group, parameters, full_name, WHY_INIT_FAILS)
            continue
        group.analyzers.append(analyzer)
        kind = below = ""
    _warn_of_missing_paths(group, parameters, breadcrumb)
    return group


def _owner(name: str) -> str:
    """The analyzer that a parameter belongs to: `motor`, or `analyzers.motor` inside a group."""
    start = len("analyzers.") if name.startswith("analyzers.") else 0
    end = name.find(".", start)
    return name if end < 0 else name[:end]


def _warn(group: AnalyzerGroup, parameters: Parameters, name: str, why: str) -> None:
    group.warnings.append(f"{parameters.source}: {name.rpartition('.')[0]}: {why}")


def _warn_of_missing_paths(group: AnalyzerGroup, parameters: Parameters, breadcrumb: str) -> None:
    names = parameters.under(breadcrumb)
    for name, full_name in names.items():
        owner = _owner(name)
        if owner and name == f"{owner}.type" and f"{owner}.path" not in names:
            _warn(group, parameters, full_name, "has no path and so shows nothing")


KINDS: dict[str, type[GenericAnalyzer | IgnoreAnalyzer | AnalyzerGroup]] = {
    "diagnostic_aggregator/GenericAnalyzer": GenericAnalyzer,
    "diagnostic_aggregator/DiscardAnalyzer": DiscardAnalyzer,
    "diagnostic_aggregator/IgnoreAnalyzer": IgnoreAnalyzer,
    "diagnostic_aggregator/AnalyzerGroup": AnalyzerGroup,
}


def _build(
    kind: str,
    path: str,
    breadcrumb: str,
    parameters: Parameters,
    now: float,
    *,
    stale_is_error: bool,
) -> Analyzer | None:
    analyzer_type = KINDS[kind]
    if issubclass(analyzer_type, AnalyzerGroup):
        return build_group(path, breadcrumb, parameters, now, stale_is_error=stale_is_error)
    if issubclass(analyzer_type, GenericAnalyzer):
        return build_generic(analyzer_type, path, breadcrumb, parameters, now)
    return analyzer_type()
