"""What Prometheus is asked about robots: expressions, labels of results, names made of them."""

import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, Any

from typing_extensions import override

from ros_diagnostics_exporter.config.errors import WrongValueError, quoted
from ros_diagnostics_exporter.config.keys import Entry, Value, Written, described
from ros_diagnostics_exporter.config.metric_names import Unit
from ros_diagnostics_exporter.config.profiles import Threshold, Thresholds
from ros_diagnostics_exporter.config.scalars import (
    MAX_NAME,
    Duration,
    Name,
    PositiveDuration,
    QueryInterval,
    text,
)
from ros_diagnostics_exporter.model import Feed

MAX_EXPRESSION = 4096  # characters
_LABEL = "[A-Za-z_][A-Za-z0-9_]*"
_COMPONENT = rf"(?:[^{{}}\x00-\x1f\x7f]|\{{{_LABEL}\}})+"
# What the exporter serves, what the rules make of it, and the alerts: none says what it measures.
_OWN = re.compile("ros_diagnostics|RosDiagnostics|ALERTS")
_ANY_NAME = re.compile("__name__")


def expression(value: Any) -> str:
    """A PromQL expression, as far as it can be checked without Prometheus."""
    found = text(value).strip()
    if not 1 <= len(found) <= MAX_EXPRESSION:
        what = f"{quoted(found)} is empty or longer than {MAX_EXPRESSION} characters"
        raise WrongValueError(what, "write a PromQL expression such as node_load1")
    own = _OWN.search(found)
    if own is not None:
        raise WrongValueError(
            f"reads {own[0]}..., which comes from this exporter: its faults would depend on "
            "themselves",
            "query what another exporter measures; of a robot's own components, use `when`, "
            "`values` and `thresholds` of its profile",
        )
    if _ANY_NAME.search(found):
        what = "selects by __name__, which may include this exporter's own families"
        raise WrongValueError(what, "name the metrics")
    return found


def component_template(value: Any) -> str:
    """A component's name, in which ``{label}`` stands for a label of the result."""
    found = text(value)
    if len(found) > MAX_NAME or found != found.strip() or not re.fullmatch(_COMPONENT, found):
        what = f"{quoted(found)} is not a component's name"
        raise WrongValueError(what, "write text and labels in braces, such as disk {mountpoint}")
    return found


def component_name(template: str, labels: dict[str, str]) -> str:
    """The name that a template makes of an element's labels; one that is missing is empty."""
    made = re.sub(rf"\{{({_LABEL})\}}", lambda found: labels.get(found[1], ""), template)
    return " ".join(made.split()) or template


def result_label(value: Any) -> str:
    """The name of a label of a query's result."""
    found = text(value)
    if len(found) > MAX_NAME or not re.fullmatch(_LABEL, found):
        raise WrongValueError(f"{quoted(found)} is not the name of a label", "such as instance")
    return found


Expression = Annotated[
    str, Value(expression, "PromQL", type="string", minLength=1, maxLength=MAX_EXPRESSION)
]
ComponentTemplate = Annotated[
    str, Value(component_template, "text with {label}", type="string", maxLength=MAX_NAME)
]
ResultLabel = Annotated[
    str, Value(result_label, "label", type="string", pattern=f"^{_LABEL}$", maxLength=MAX_NAME)
]


class Query(Entry):
    """What Prometheus measures of robots: each element of an expression's result is a component."""

    expr: Expression = described(
        "The PromQL expression. It may not read this exporter's own families.",
        example="100 * node_filesystem_avail_bytes / node_filesystem_size_bytes",
    )
    component: ComponentTemplate = described(
        "The component's name; `{label}` stands for a label of the result. If several elements of "
        "a robot get the same name, they are one component, as bad as the worst of them.",
        example="disk {mountpoint}",
    )
    group: Name = described("The group of the components.", example="Network", default="Host")
    robot: ResultLabel | None = described(
        "The label of the result that names the robot. By default `robot`, unless `address` is "
        "given.",
        example="vehicle",
        default=None,
    )
    address: ResultLabel | None = described(
        "In place of `robot`: the label of the result that has the robot's `address`. A port "
        "after the address is ignored.",
        example="instance",
        default=None,
    )
    unit: Unit | None = described("The unit of the result.", example="%", default=None)
    thresholds: Annotated[tuple[Threshold, ...], Written(Thresholds, tuple)] = described(
        "The level of a component: WARN beyond `warning`, ERROR beyond `critical`. It ends when "
        "the value is back by `value_hysteresis`. Without thresholds the component is OK, or "
        "STALE.",
        example={"low": {"warning": 20, "critical": 10}},
        default=(),
    )
    interval: QueryInterval = described(
        "How often Prometheus is asked, 5s to 30s.", example="30s", default=15.0
    )
    stale_after: PositiveDuration = described(
        "Time without an element after which its component is STALE; at least twice `interval`.",
        example="2m",
        default=60.0,
    )
    confirm_after: Duration | None = described(
        "Time after which a problem is confirmed, in place of the profile's. If an entry of the "
        "profile's `components` has a time, that one counts.",
        example="1m",
        default=None,
    )

    planned_stale: bool = described(
        "Their STALE is no fault. Use it if another query says that the target does not answer.",
        example=True,
        default=False,
    )
    uplink: bool = described(
        "The query judges uplinks. While the component of an uplink is ERROR, the robots that name "
        "it in their label `uplink` are unreachable: neither their silence nor their measurements "
        "are faults.",
        example=True,
        default=False,
    )

    @property
    def name(self) -> str:
        """Unique in the fleet: what logs, metrics and pages call it."""
        return f"{self.group}/{self.component}"

    @property
    def feed(self) -> Feed:
        """What it delivers."""
        return Feed(
            self.name,
            self.group,
            self.stale_after,
            self.confirm_after,
            self.planned_stale,
            self.uplink,
        )

    @override
    def completed(self, given: Mapping[str, Any]) -> "Query":
        if self.robot and self.address:
            raise WrongValueError("has both robot and address", "keep one of them")
        if self.stale_after < 2 * self.interval:
            what = f"stale_after ({self.stale_after:g}s) is below twice interval"
            raise WrongValueError(
                what, f"use {2 * self.interval:g}s or more, or a shorter interval"
            )
        return self if self.address else replace(self, robot=self.robot or "robot")
