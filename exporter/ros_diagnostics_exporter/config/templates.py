"""Templates with `{robot}` in fleet.yml: for topics, names, hosts, and what a status says."""

from __future__ import annotations

import re
from typing import Annotated, Any

from pydantic import PlainValidator, WithJsonSchema

from ros_diagnostics_exporter.config.errors import WrongValueError
from ros_diagnostics_exporter.config.patterns import MAX_PATTERN, expression
from ros_diagnostics_exporter.config.regex import Pattern, escape
from ros_diagnostics_exporter.config.scalars import MAX_NAME, MAX_TOPIC, shown, text

ROBOT = "{robot}"
# Every topic; a robot's name is the last part of its namespace.
INNERMOST = re.compile(r"(?:/[A-Za-z0-9_]+)*/(?P<robot>[A-Za-z0-9_]+)/[A-Za-z0-9_]+")
_TOPIC = r"(?:/(?:[A-Za-z_][A-Za-z0-9_]*|[A-Za-z0-9_]*\{robot\}[A-Za-z0-9_]*|\*))+"
_NAME = r"(?:[A-Za-z0-9_.:-]|\{robot\}|\{domain_id\})+"


def topic_template(value: Any) -> str:
    """A topic in which one part may hold `{robot}`, and `*` stands for a part."""
    found = text(value)
    if len(found) > MAX_TOPIC or not re.fullmatch(_TOPIC, found, re.ASCII):
        remedy = "write a topic as /{robot}/diagnostics_agg, with * for a part of any name"
        raise WrongValueError(f"{shown(found)} is not a pattern for topics", remedy)
    if found.count(ROBOT) > 1:
        raise WrongValueError(
            f"{shown(found)} has {ROBOT} twice", "keep one and write * for the other"
        )
    return found


def topic_pattern(template: str) -> re.Pattern[str]:
    """The pattern (fullmatch on topics) that a checked template means; group "robot" if it has."""
    source = re.escape(template).replace(re.escape(ROBOT), "(?P<robot>[A-Za-z0-9_]+)")
    return re.compile(source.replace(r"\*", "[A-Za-z0-9_]+"))


def name_template(value: Any) -> str:
    """A name or a host made of `{robot}` and `{domain_id}`."""
    found = text(value)
    if len(found) > MAX_NAME or not re.fullmatch(_NAME, found, re.ASCII):
        remedy = "use letters, digits, - _ . : and {robot}, {domain_id}"
        raise WrongValueError(f"{shown(found)} is not a template for names", remedy)
    return found


def split(value: Any) -> Pattern:
    """How a status names its robot: a template, or {regex: ...} with a group "robot"."""
    if isinstance(value, dict) and set(value) == {"regex"}:
        made = expression(value["regex"])
        groups = made.groups
        twice = any(made.pattern.count(f"<{group}>") > 1 for group in groups)
        if twice or "robot" not in groups or groups - {"robot", "component"}:
            what = f"{shown(made.pattern)} has not the named groups that are looked for"
            raise WrongValueError(
                what, "name the robot's part (?P<robot>...), the rest (?P<component>...), each once"
            )
        return made
    found = text(value)
    source = escape(found[: MAX_PATTERN + 1])
    for group, inner in (("robot", ".+?"), ("component", ".+")):
        source = source.replace(rf"\{{{group}\}}", f"(?P<{group}>{inner})", 1)
    if len(found) > MAX_PATTERN or "(?P<robot>" not in source or r"\{" in source:
        remedy = "write it with {robot} and {component}, each once, as {robot}/{component}"
        raise WrongValueError(f"{shown(found)} does not say where the robot's name is", remedy)
    return Pattern(source, dot_all=True)


TopicTemplate = Annotated[
    str,
    PlainValidator(topic_template),
    WithJsonSchema({"title": "topic with {robot}", "type": "string", "pattern": f"^{_TOPIC}$"}),
]
NameTemplate = Annotated[
    str,
    PlainValidator(name_template),
    WithJsonSchema({"title": "text with {robot}", "type": "string", "pattern": f"^{_NAME}$"}),
]
Split = Annotated[
    Pattern,
    PlainValidator(split),
    WithJsonSchema(
        {
            "title": "text with {robot} and {component}",
            "anyOf": [
                {"type": "string", "pattern": r"\{robot\}", "maxLength": MAX_PATTERN},
                {
                    "type": "object",
                    "properties": {"regex": {"type": "string", "maxLength": MAX_PATTERN}},
                    "required": ["regex"],
                    "additionalProperties": False,
                },
            ],
        }
    ),
]
