"""The types of a query: its expression, the labels of its result, the name made of them."""

from __future__ import annotations

import re
from typing import Annotated, Any

from ros_diagnostics_exporter.config.errors import WrongValueError, quoted
from ros_diagnostics_exporter.config.keys import Value
from ros_diagnostics_exporter.config.scalars import MAX_NAME, text

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
            f"reads {own[0]}..., which is made of what this exporter serves, so its faults would "
            "rest on themselves",
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
