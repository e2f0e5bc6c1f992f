"""Single values of fleet.yml: durations, times, domains, names, labels; text in, checked value out.

Each type pairs a function, which raises `WrongValueError`, with the JSON Schema that an editor
needs to check the same. Knows nothing of keys or files.
"""

from __future__ import annotations

import re
import zoneinfo
from collections.abc import Callable
from datetime import datetime
from itertools import chain
from math import inf
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from ros_diagnostics_exporter import durations
from ros_diagnostics_exporter.config.errors import WrongValueError, quoted
from ros_diagnostics_exporter.config.keys import Value, Written
from ros_diagnostics_exporter.model import Domain
from ros_diagnostics_exporter.weekly import Weekly

MAX_DOMAIN_ID = 232  # above it, rclpy ends the whole process (ports would exceed 65535)
MAX_NAME = 128
QUERY_INTERVALS = 5.0, 30.0  # seconds, the shortest and the longest
MAX_LABEL_VALUE = 256
MAX_TOPIC = 247  # RMW_TOPIC_MAX_NAME_LENGTH
TEN_YEARS = 10 * 365 * 86_400.0

_TOPIC = r"(?:/[A-Za-z_][A-Za-z0-9_]*)+"
NAME = r"/?[A-Za-z_][A-Za-z0-9_]*(?:/[A-Za-z_][A-Za-z0-9_]*)*"  # of a node, or a topic
_ADDRESS = r"[A-Za-z0-9_](?:[A-Za-z0-9._:-]*[A-Za-z0-9_])?|::[A-Fa-f0-9:.]*"
_KEY = r"[A-Za-z0-9_][A-Za-z0-9_.:-]*(?:/[A-Za-z0-9_][A-Za-z0-9_.:-]*)*"
_LOCATOR = r"(?:tcp|tls|quic|udp|ws)/\S+:\d{1,5}"
_RANGE = r"(\d{1,3})-(\d{1,3})"
_CAPABILITY = r"[^\W_](?:[\w '-]{0,38}\w)?"
_LABEL = r"[A-Za-z_][A-Za-z0-9_]*"

# Labels of the exporter, of its rules and of Prometheus. (The table of metrics cannot be imported
# here, it is built on the config; a test compares the two.)
RESERVED_LABELS = frozenset(
    {
        # identity of what the exporter serves
        *("fleet", "exporter", "robot", "group", "component"),
        # robot_info's own
        *("ros_namespace", "domain_id", "topic", "profile", "address"),
        # set by Prometheus on targets, histograms, summaries and alerts
        *("job", "instance", "le", "quantile", "alertname", "alertstate", "severity"),
    }
)
RESERVED_LABEL_PREFIXES = ("__", "exported_")

DAYS = ("Mon", "Tue", "Wed", "Thu", "Fri", "Sat", "Sun")
DAY = 24 * 60  # minutes
_DAY = "(?:Mon|Tue|Wed|Thu|Fri|Sat|Sun)"
_DAYS = rf"{_DAY}(?:-{_DAY})?(?:,{_DAY}(?:-{_DAY})?)*|daily"
_CLOCK = r"(?:[01]\d|2[0-3]):[0-5]\d|24:00"
_WEEKLY = re.compile(rf"({_DAYS}) ({_CLOCK})-({_CLOCK})", re.ASCII)
_MOMENT = r"\d{4}-\d\d-\d\d(?:[T ]\d\d:\d\d(?::\d\d)?(?:Z|[+-]\d\d:\d\d)?)?"


def text(value: Any) -> str:
    """`value` if it is text that can be written as UTF-8."""
    if not isinstance(value, str):
        raise WrongValueError(f"{quoted(value)} is not text", "put it in quotes")
    if re.search("[\ud800-\udfff]", value):  # PyYAML without libyaml lets them pass
        raise WrongValueError(
            f"{quoted(value)} has an unpaired surrogate", "remove the escape \\ud..."
        )
    return value


def matching(value: Any, pattern: str, what: str, remedy: str, most: float = inf) -> str:
    """`value` if it is text that the whole pattern matches, of at most ``most`` characters.

    ``what`` is said of a text that is not, as in "is not a host", and ``remedy`` how to mend it.
    """
    found = text(value)
    if len(found) > most or not re.fullmatch(pattern, found, re.ASCII):
        raise WrongValueError(f"{quoted(found)} {what}", remedy)
    return found


def duration(value: Any) -> float:
    """`5s`, `1m30s`, `24h` or plain seconds -> seconds."""
    remedy = "write seconds or a duration such as 5s, 1m30s, 24h"
    try:
        seconds = durations.parse(value) if isinstance(value, str) else _number(value)
    except ValueError:
        raise WrongValueError(f"{quoted(value)} is not a duration", remedy) from None
    if not 0 <= seconds <= TEN_YEARS:
        raise WrongValueError(f"{quoted(value)} is not between 0 and ten years", remedy)
    return seconds


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError("is not a number")  # noqa: TRY004 - of a text
    return float(value)


def positive_duration(value: Any) -> float:
    """A duration above zero, in seconds."""
    seconds = duration(value)
    if seconds == 0:
        raise WrongValueError("is 0", "use a duration above 0, such as 5s")
    return seconds


def _within(least: float, most: float, what: str, remedy: str) -> Value:
    """A duration from ``least`` to ``most`` seconds; ``what`` is said of any other."""

    def made(value: Any) -> float:
        seconds = duration(value)
        if not least <= seconds <= most:
            raise WrongValueError(f"{quoted(value)} {what}", remedy)
        return seconds

    limits = {"minimum": least} if most == inf else {"minimum": least, "maximum": most}
    return Value(made, "duration", anyOf=_seconds(**limits))


def domain_id(value: Any) -> int:
    """A DDS domain id that rclpy survives."""
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value <= MAX_DOMAIN_ID:
        what = f"{quoted(value)} is not a DDS domain"
        raise WrongValueError(what, f"use a whole number from 0 to {MAX_DOMAIN_ID}")
    return value


def domain_ids(value: Any) -> tuple[int, ...]:
    """A list of DDS domains and ranges of them (`10-19`) -> every id once, ascending."""
    items = value if isinstance(value, list) else [value]
    if not items:
        raise WrongValueError("is an empty list", "name at least one DDS domain, such as [0]")
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
        raise WrongValueError(f"{quoted(name)} is not absolute", f"start it with a slash: /{name}")
    remedy = "use parts of letters, digits and _, not starting with a digit: /robot_1/diagnostics"
    return matching(name, _TOPIC, "is not a valid ROS name", remedy, MAX_TOPIC)


def namespace(value: Any) -> str:
    """A ROS namespace, absolute; `/` is the root and becomes the empty string."""
    return "" if value == "/" else topic(value)


def key_prefix(value: Any) -> str:
    """The beginning of zenoh keys, as topics begin: `a/b` -> `/a/b`; `/`, for none, -> ``."""
    if value == "/":
        return ""
    remedy = "write it as customer_a/robot_1, or / where the keys begin with the topic"
    return "/" + matching(value, _KEY, "is not the beginning of a zenoh key", remedy, MAX_TOPIC)


def locator(value: Any) -> str:
    """Where zenoh connects to."""
    remedy = "write protocol, host and port, as in tls/centre.example.org:7447"
    return matching(value, _LOCATOR, "is not a zenoh locator", remedy)


def file(value: Any) -> Path:
    """The absolute path of a file."""
    found = Path(text(value))
    if not found.is_absolute():
        raise WrongValueError(f"{quoted(str(found))} is not absolute", "begin it with /")
    return found


def name(value: Any) -> str:
    """The name of a robot, a fleet, a profile or a check."""
    found = text(value)
    if not is_name(found):
        raise WrongValueError(
            f"{quoted(found)} cannot be a name",
            f"use 1 to {MAX_NAME} characters, no slashes and no spaces at the ends",
        )
    return found


def capability_name(value: Any) -> str:
    """A capability, as it follows "has lost"."""
    found = text(value)
    if not re.fullmatch(_CAPABILITY, found):
        what = f"{quoted(found)} cannot be a capability"
        raise WrongValueError(what, "name what the robot can do in 1 to 40 letters: lifting")
    return found


def is_name(text: str) -> bool:
    """Whether a text, from the config or from a robot, can be a robot's name."""
    is_clean = text.isprintable() and text == text.strip() and "/" not in text
    return is_clean and 1 <= len(text) <= MAX_NAME


def address(value: Any) -> str:
    """A host name or an IP address, without port, scheme or spaces."""
    return matching(value, _ADDRESS, "is not a host", "write a host name or an IP address", 253)


def label_name(value: Any) -> str:
    """The name of a label: valid for Prometheus and not reserved."""
    remedy = "use letters, digits and _, not beginning with a digit"
    found = matching(value, _LABEL, "cannot be the name of a label", remedy, MAX_NAME)
    if found in RESERVED_LABELS or found.startswith(RESERVED_LABEL_PREFIXES):
        raise WrongValueError(f"the label {quoted(found)} is reserved", "choose another name")
    return found


def label_value(value: Any) -> str:
    """The value of a label: text, or a whole number, which becomes text."""
    if isinstance(value, int) and not isinstance(value, bool):
        return str(value)
    found = text(value)
    if len(found) > MAX_LABEL_VALUE:
        raise WrongValueError(
            f"{quoted(found)} has {len(found)} characters", f"use at most {MAX_LABEL_VALUE}"
        )
    return found


def folder(value: Any) -> str:
    """The path of a folder, relative to fleet.yml or absolute."""
    found = text(value)
    if not found or not found.isprintable():
        raise WrongValueError(f"{quoted(found)} is not a path", "name a folder, such as robots.d")
    return found


def weekly(value: Any) -> Weekly:
    """`Mon-Fri 22:00-06:00` -> (weekday, from, to) in minutes; beyond 1440 is the day after."""
    found = text(value)
    match = _WEEKLY.fullmatch(found)
    if match is None:
        remedy = (
            "write days and times like Mon-Fri 22:00-06:00, Sat,Sun 00:00-24:00, daily 12:00-13:00"
        )
        raise WrongValueError(f"{quoted(found)} is not a weekly time", remedy)
    days, start, end = match.groups()
    first, last = _minutes(start), _minutes(end)
    if first in (last, DAY):
        raise WrongValueError(f"{quoted(found)} has no length", "write 00:00-24:00 for a whole day")
    return tuple((day, first, last if last > first else last + DAY) for day in _days(days))


def _days(written: str) -> list[int]:
    if written == "daily":
        return list(range(7))
    found: set[int] = set()
    for part in written.split(","):
        first, _, last = part.partition("-")
        begin, end = DAYS.index(first), DAYS.index(last or first)
        found.update(day % 7 for day in range(begin, end + 1 if end >= begin else end + 8))
    return sorted(found)


def _minutes(clock: str) -> int:
    hours, minutes = clock.split(":")
    return int(hours) * 60 + int(minutes)


def moment(value: Any) -> datetime:
    """A date and time by ISO 8601; without an offset, in the entry's time zone."""
    remedy = "write it like 2026-03-28T22:00 or 2026-03-28T22:00:00+01:00"
    found = matching(value, _MOMENT, "is not a date and time", remedy)
    try:
        # Python 3.10 does not know "Z".
        return datetime.fromisoformat(found.replace("Z", "+00:00"))
    except ValueError:
        raise WrongValueError(f"{quoted(found)} is not in the calendar", remedy) from None


def time_zone(value: Any) -> str:
    """The IANA name of a time zone that this machine has rules for."""
    found = text(value)
    try:
        zoneinfo.ZoneInfo(found)
    except (zoneinfo.ZoneInfoNotFoundError, ValueError, OSError):
        remedy = (
            "use a name from the IANA list, such as Europe/Berlin (install tzdata if it is missing)"
        )
        raise WrongValueError(f"{quoted(found)} is not a time zone known here", remedy) from None
    return found


def _whole(regex: str) -> str:
    """The regular expression for JSON Schema, which searches."""
    return f"^(?:{regex})$"


def _seconds(**least: float) -> list[dict[str, Any]]:
    text = {"type": "string", "minLength": 2, "pattern": _whole(durations.PATTERN)}
    return [{"type": "number", **least}, text]


_ID = {"type": "integer", "minimum": 0, "maximum": MAX_DOMAIN_ID}
_IDS = {"anyOf": [_ID, {"type": "string", "pattern": _whole(_RANGE)}]}
_RESERVED = [
    {"enum": sorted(RESERVED_LABELS)},
    {"pattern": f"^({'|'.join(RESERVED_LABEL_PREFIXES)})"},
]


def _value(made: Callable[[Any], Any], title: str, pattern: str, **more: Any) -> Value:
    return Value(made, title, type="string", pattern=pattern, **more)


def joined(weekly: list[Weekly]) -> Weekly:
    """Several times of each week as one."""
    return tuple(chain.from_iterable(weekly))


Duration = Annotated[float, Value(duration, "duration", anyOf=_seconds(minimum=0))]
PositiveDuration = Annotated[
    float, Value(positive_duration, "duration", anyOf=_seconds(exclusiveMinimum=0))
]
CanaryInterval = Annotated[
    float,
    _within(60, inf, "is too often for a canary", "use 1m or more, such as 5m; omit it for none"),
]
RecordedTime = Annotated[
    float, _within(0, 600, "is more than a recording may have", "use 10m or less, such as 2m")
]
QueryInterval = Annotated[
    float, _within(*QUERY_INTERVALS, "is not between 5s and 30s", "use 15s, or omit it")
]
DomainId = Annotated[Domain, Value(domain_id, "DDS domain", **_ID)]
DomainIds = Annotated[
    tuple[Domain, ...],
    Value(
        domain_ids,
        "list of DDS domains",
        anyOf=[_ID, {"type": "array", "minItems": 1, "items": _IDS}],
    ),
]
Topic = Annotated[str, _value(topic, "topic", _whole(_TOPIC))]
Namespace = Annotated[str, _value(namespace, "namespace", _whole(_TOPIC + "|/"))]
KeyPrefix = Annotated[str, _value(key_prefix, "beginning of a key", _whole(_KEY + "|/"))]
Locator = Annotated[str, _value(locator, "locator", _whole(_LOCATOR))]
File = Annotated[Path, _value(file, "absolute path", "^/")]
Name = Annotated[str, _value(name, "name", "^[^/]+$", maxLength=MAX_NAME)]
CapabilityName = Annotated[str, _value(capability_name, "capability", "^[^;,/]+$", maxLength=40)]
Address = Annotated[str, Value(address, "host", type="string", minLength=1)]
Folder = Annotated[str, Value(folder, "folder", type="string", minLength=1)]
LabelName = Annotated[
    str, _value(label_name, "label name", _whole(_LABEL), **{"not": {"anyOf": _RESERVED}})
]
LabelValue = Annotated[
    str,
    Value(label_value, "label value", type=["string", "integer"], maxLength=MAX_LABEL_VALUE),
]
WeeklyTime = Annotated[Weekly, _value(weekly, "weekly time", f"^{_WEEKLY.pattern}$")]
Moment = Annotated[datetime, _value(moment, "date and time", f"^{_MOMENT}$")]
TimeZone = Annotated[str, Value(time_zone, "time zone", type="string", minLength=1)]
WeeklyTimes = Annotated[Weekly, Written(list[WeeklyTime], joined)]
Count = Annotated[int, Field(ge=1, le=10_000_000)]
Share = Annotated[float, Field(ge=0, le=1)]
