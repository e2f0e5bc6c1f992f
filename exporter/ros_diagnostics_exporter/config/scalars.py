"""Single values of fleet.yml: durations, domains, names, labels; text in, checked value out.

Each type here pairs a function, which raises `WrongValueError`, with the JSON Schema that tells
editors the same. Knows nothing of keys or files.
"""

from __future__ import annotations

import json
import re
from typing import Annotated, Any

from pydantic import PlainValidator, WithJsonSchema

from ros_diagnostics_exporter.config.errors import WrongValueError
from ros_diagnostics_exporter.config.reserved import RESERVED_LABEL_PREFIXES, RESERVED_LABELS
from ros_diagnostics_exporter.texts import printable

MAX_DOMAIN_ID = 232  # above it, rclpy ends the whole process (ports would exceed 65535)
MAX_NAME = 128
MAX_LABEL_VALUE = 256
MAX_TOPIC = 247  # RMW_TOPIC_MAX_NAME_LENGTH
TEN_YEARS = 10 * 365 * 86_400.0

_DURATION = r"(?:(\d+)w)?(?:(\d+)d)?(?:(\d+)h)?(?:(\d+)m)?(?:(\d+)s)?(?:(\d+)ms)?"
_DURATION_UNITS = (604_800.0, 86_400.0, 3_600.0, 60.0, 1.0, 0.001)
_TOPIC = r"(?:/[A-Za-z_][A-Za-z0-9_]*)+"
_ADDRESS = r"[A-Za-z0-9_](?:[A-Za-z0-9._:-]*[A-Za-z0-9_])?|::[A-Fa-f0-9:.]*"
_RANGE = r"(\d{1,3})-(\d{1,3})"
_LABEL = r"[A-Za-z_][A-Za-z0-9_]*"


def shown(value: object) -> str:
    """A value as an error quotes it: as in the file, on one line, not too long to take in."""
    found = "nothing" if value is None else json.dumps(value, ensure_ascii=False, default=str)
    found = printable(found)
    return found if len(found) <= 60 else found[:57] + "..."


def text(value: Any) -> str:
    """`value` if it is text that can be written as UTF-8."""
    if not isinstance(value, str):
        raise WrongValueError(f"{shown(value)} is not text", "put it in quotes")
    if re.search("[\ud800-\udfff]", value):  # PyYAML without libyaml lets them pass
        raise WrongValueError(
            f"{shown(value)} has half of a character", "remove the escape \\ud..."
        )
    return value


def duration(value: Any) -> float:
    """`5s`, `1m30s`, `24h` or plain seconds -> seconds."""
    remedy = "write seconds or a duration such as 5s, 1m30s, 24h"
    if isinstance(value, str) and value:
        match = re.fullmatch(_DURATION, value, re.ASCII)
        if match is None:
            raise WrongValueError(f"{shown(value)} is not a duration", remedy)
        parts = zip(match.groups(), _DURATION_UNITS, strict=True)
        seconds = sum(float(count) * unit for count, unit in parts if count)
    elif isinstance(value, int | float) and not isinstance(value, bool):
        seconds = float(value)
    else:
        raise WrongValueError(f"{shown(value)} is not a duration", remedy)
    if not 0 <= seconds <= TEN_YEARS:
        raise WrongValueError(f"{shown(value)} is not between 0 and ten years", remedy)
    return seconds


def positive_duration(value: Any) -> float:
    """A duration above zero, in seconds."""
    seconds = duration(value)
    if seconds == 0:
        raise WrongValueError(
            "is 0, so everything would be stale at once", "use a duration above 0, as 5s"
        )
    return seconds


def domain_id(value: Any) -> int:
    """A DDS domain id that rclpy survives."""
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value <= MAX_DOMAIN_ID:
        what = f"{shown(value)} is not a DDS domain"
        raise WrongValueError(what, f"use a whole number from 0 to {MAX_DOMAIN_ID}")
    return value


def domain_ids(value: Any) -> tuple[int, ...]:
    """A list of DDS domains and ranges of them (`10-19`) -> every id once, ascending."""
    items = value if isinstance(value, list) else [value]
    if not items:
        raise WrongValueError("is an empty list", "name at least one DDS domain, as [0]")
    found: set[int] = set()
    for item in items:
        limits = re.fullmatch(_RANGE, item, re.ASCII) if isinstance(item, str) else None
        if limits is None:
            found.add(domain_id(item))
            continue
        first, last = map(domain_id, map(int, limits.groups()))
        if first > last:
            raise WrongValueError(f"the range {item} runs backwards", f"write {last}-{first}")
        found.update(range(first, last + 1))
    return tuple(sorted(found))


def topic(value: Any) -> str:
    """An absolute ROS name; the rules of rmw's validate_full_topic_name."""
    name = text(value)
    if name and not name.startswith("/"):
        raise WrongValueError(f"{shown(name)} is not absolute", f"begin it with a slash: /{name}")
    if len(name) > MAX_TOPIC or not re.fullmatch(_TOPIC, name, re.ASCII):
        raise WrongValueError(
            f"{shown(name)} is not a valid ROS name",
            "use parts of letters, digits and _ that begin with no digit, as /robot_1/diagnostics",
        )
    return name


def namespace(value: Any) -> str:
    """A ROS namespace, absolute; `/` is the root and becomes the empty string."""
    return "" if value == "/" else topic(value)


def name(value: Any) -> str:
    """The name of a robot, a fleet, a profile, a check: a label's value that people read."""
    found = text(value)
    if not is_name(found):
        raise WrongValueError(
            f"{shown(found)} cannot be a name",
            f"use 1 to {MAX_NAME} characters without slashes and blanks at the ends",
        )
    return found


def is_name(found: str) -> bool:
    """Whether a text, the config's or a robot's, can be the name of a robot."""
    is_clean = found.isprintable() and found == found.strip() and "/" not in found
    return is_clean and 1 <= len(found) <= MAX_NAME


def address(value: Any) -> str:
    """A host name or an IP address, without port, scheme or blanks."""
    found = text(value)
    if len(found) > 253 or not re.fullmatch(_ADDRESS, found, re.ASCII):
        raise WrongValueError(f"{shown(found)} is not a host", "write a host name or an IP address")
    return found


def label_name(value: Any) -> str:
    """A label's name that Prometheus takes and that is not used for something else."""
    found = text(value)
    if not re.fullmatch(_LABEL, found, re.ASCII) or len(found) > MAX_NAME:
        remedy = "use letters, digits and _, not beginning with a digit"
        raise WrongValueError(f"{shown(found)} cannot be the name of a label", remedy)
    if found in RESERVED_LABELS or found.startswith(RESERVED_LABEL_PREFIXES):
        raise WrongValueError(f"the label {shown(found)} is reserved", "choose another name for it")
    return found


def label_value(value: Any) -> str:
    """A label's value: text; a whole number is taken as it would be written."""
    if isinstance(value, int) and not isinstance(value, bool):
        return str(value)
    found = text(value)
    if len(found) > MAX_LABEL_VALUE:
        raise WrongValueError(
            f"{shown(found)} has {len(found)} characters", f"use at most {MAX_LABEL_VALUE}"
        )
    return found


def folder(value: Any) -> str:
    """The path of a folder, relative to fleet.yml or absolute."""
    found = text(value)
    if not found or not found.isprintable():
        raise WrongValueError(f"{shown(found)} is not a path", "name a folder, as robots.d")
    return found


def _schema(title: str, **more: Any) -> WithJsonSchema:
    return WithJsonSchema({"title": title, **more})


def _whole(regex: str) -> str:
    """The regular expression for JSON Schema, which searches."""
    return f"^(?:{regex})$"


_SECONDS = {"type": "number", "minimum": 0}
_ID = {"type": "integer", "minimum": 0, "maximum": MAX_DOMAIN_ID}
_TEXT_DURATION = {"type": "string", "minLength": 2, "pattern": _whole(_DURATION)}

Duration = Annotated[
    float, PlainValidator(duration), _schema("duration", anyOf=[_SECONDS, _TEXT_DURATION])
]
PositiveDuration = Annotated[
    float,
    PlainValidator(positive_duration),
    _schema("duration", anyOf=[{"type": "number", "exclusiveMinimum": 0}, _TEXT_DURATION]),
]
DomainId = Annotated[int, PlainValidator(domain_id), _schema("DDS domain", **_ID)]
DomainIds = Annotated[
    tuple[int, ...],
    PlainValidator(domain_ids),
    _schema(
        "list of DDS domains",
        anyOf=[
            _ID,
            {
                "type": "array",
                "minItems": 1,
                "items": {"anyOf": [_ID, {"type": "string", "pattern": _whole(_RANGE)}]},
            },
        ],
    ),
]
Topic = Annotated[
    str, PlainValidator(topic), _schema("topic", type="string", pattern=_whole(_TOPIC))
]
Namespace = Annotated[
    str,
    PlainValidator(namespace),
    _schema("namespace", type="string", pattern=_whole(_TOPIC + "|/")),
]
Name = Annotated[
    str,
    PlainValidator(name),
    _schema("name", type="string", pattern="^[^/]+$", maxLength=MAX_NAME),
]
Address = Annotated[str, PlainValidator(address), _schema("host", type="string", minLength=1)]
Folder = Annotated[str, PlainValidator(folder), _schema("folder", type="string", minLength=1)]
LabelName = Annotated[
    str,
    PlainValidator(label_name),
    WithJsonSchema(
        {
            "title": "label name",
            "type": "string",
            "pattern": _whole(_LABEL),
            "not": {
                "anyOf": [
                    {"enum": sorted(RESERVED_LABELS)},
                    {"pattern": f"^({'|'.join(RESERVED_LABEL_PREFIXES)})"},
                ]
            },
        }
    ),
]
LabelValue = Annotated[
    str,
    PlainValidator(label_value),
    _schema("label value", type=["string", "integer"], maxLength=MAX_LABEL_VALUE),
]
