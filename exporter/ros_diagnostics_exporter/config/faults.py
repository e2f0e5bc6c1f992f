"""When a problem is a fault: confirmation, flapping, larger causes, hours; what a recording has."""

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import Field
from typing_extensions import override

from ros_diagnostics_exporter.config.errors import WrongValueError
from ros_diagnostics_exporter.config.keys import Entry, Written, described
from ros_diagnostics_exporter.config.scalars import (
    Count,
    Duration,
    RecordedTime,
    Share,
    TimeZone,
    WeeklyTime,
    joined,
)
from ros_diagnostics_exporter.weekly import Weekly

FlapRatio = Annotated[float, Field(ge=0.01, le=1)]


class CauseSettings(Entry):
    """From how many on several problems are one: ``number`` and ``share``, or ``absolute``."""

    number: int
    share: float
    absolute: int | None = None

    @override
    def completed(self, given: Mapping[str, Any]) -> "CauseSettings":
        absolute = self.absolute
        if absolute is not None and "absolute" not in given:
            absolute = max(absolute, self.number)  # a number that is written down counts
        return CauseSettings(self.number, self.share, absolute)


class Many(CauseSettings):
    """When components of one robot that fail at once are one fault."""

    number: Count = described(
        "At least this many of its components.", example=10, default=8, key="components"
    )
    share: Share = described(
        "At least this share of all that it has, too.", example=0.3, default=0.5
    )
    absolute: Count | None = described(
        "Or this many components, however many it has.", example=40, default=20
    )


class Site(CauseSettings):
    """When robots of one site that fall silent at once are one fault."""

    number: Count = described(
        "At least this many of its robots.", example=3, default=5, key="robots"
    )
    share: Share = described("At least this share of them, too.", example=0.3, default=0.5)
    absolute: Count | None = described(
        "Or this many robots, however large the site is.", example=50, default=20
    )


class Common(CauseSettings):
    """When one component that is ERROR on many robots is one fault."""

    number: Count = described("At least this many robots.", example=3, default=5, key="robots")
    share: Share = described("At least this share of the fleet, too.", example=0.2, default=0.25)
    absolute: Count | None = described(
        "Or this many robots, however large the fleet is.", example=50, default=20
    )


class WarningHours(Entry):
    """The hours of the week in which faults of severity warning begin."""

    weekly: Annotated[Weekly, Written(Annotated[list[WeeklyTime], Field(min_length=1)], joined)] = (
        described(
            "Times of each week, in `time_zone`, also across midnight.",
            example=["Mon-Fri 06:00-18:00"],
        )
    )
    time_zone: TimeZone = described(
        "The IANA time zone of the times.", example="Europe/Berlin", default="UTC"
    )


class Flapping(Entry):
    """When something changes too often: Nagios' ratio of changes between its last 21 states."""

    start: FlapRatio = described("From this ratio on it is flapping.", example=0.5, default=0.4)
    stop: FlapRatio = described(
        "Below this ratio it is no longer flapping.", example=0.25, default=0.2
    )

    @override
    def completed(self, given: Mapping[str, Any]) -> "Flapping":
        if self.stop >= self.start:
            what = f"stop ({self.stop:g}) is not below start ({self.start:g})"
            raise WrongValueError(what, "use a stop below start, such as start: 0.4, stop: 0.2")
        return self


class Intermittent(Entry):
    """When faults too short to be confirmed are too many to be chance."""

    changes: Annotated[Count, Field(ge=2, le=20)] = described(
        "This many changes of a component's level are a fault. One short failure is two changes.",
        example=6,
        default=4,
    )
    within: Duration = described("Within this time.", example="1h", default=600.0)


class Falling(Entry):
    """When a value that falls will soon be below its critical threshold."""

    over: Duration = described(
        "The time over which the fall is measured.", example="5m", default=900.0
    )
    ahead: Duration = described(
        "It is a fault if the value will be too low within this time, at this speed.",
        example="1h",
        default=1800.0,
    )


class RecordingSettings(Entry, title="Recordings"):
    """What a recording has of the messages around the begin of its fault (docs/time-machine.md)."""

    before: RecordedTime = described(
        "How long before the begin of the fault the recording begins, at most 10m. More takes more "
        "memory.",
        example="2m",
        default=60.0,
    )
    after: RecordedTime = described(
        "How long after the begin of the fault the recording ends, at most 10m. The recording is "
        "there after this time.",
        example="30s",
        default=10.0,
    )


class FaultSettings(Entry, title="Faults"):
    """How the exporter decides which problems are faults, for the whole fleet."""

    restart_grace: Duration = described(
        "For this time after a start of the exporter, missing data begins no fault.",
        example="1m",
        default=30.0,
    )
    pending_after: Duration = described(
        "A robot that fleet.yml names is a fault after this time, if neither a message nor a "
        "publisher of it was ever seen.",
        example="1h",
        default=900.0,
    )
    confirm_after: Duration = described(
        "Time after which a fault of a site, or one that is common to many robots, is confirmed; "
        "for robots and components see the profile.",
        example="30s",
        default=10.0,
    )
    flapping: Flapping = described(
        "When components, and robots that come and go, are flapping.",
        example={"start": 0.5},
        default=Flapping(),
    )
    intermittent: Intermittent = described(
        "When a component that fails again and again, each time too briefly to be confirmed, has "
        "an *intermittent* fault.",
        example={"changes": 6},
        default=Intermittent(),
    )
    falling: Falling = described(
        "When a value with a critical low threshold falls too fast.",
        example={"ahead": "1h"},
        default=Falling(),
    )
    value_hysteresis: Share = described(
        "Share of a threshold by which a value has to come back before its fault ends.",
        example=0.05,
        default=0.02,
    )
    many: Annotated[CauseSettings, Written(Many)] = described(
        "When components of one robot that fail at once are one fault.",
        example={"components": 5},
        default=Many().completed({}),
    )
    site: Annotated[CauseSettings, Written(Site)] = described(
        "When robots of one site that fall silent at once are one fault. Robots with the same "
        "label `site` are one site, and so are those without this label.",
        example={"robots": 3, "share": 0.3},
        default=Site().completed({}),
    )
    common: Annotated[CauseSettings, Written(Common)] = described(
        "When one component that is ERROR on many robots is one fault.",
        example={"robots": 10, "absolute": 50},
        default=Common().completed({}),
    )
    warning_hours: WarningHours | None = described(
        "The hours of the week in which faults of severity warning begin. By default all.",
        example={"weekly": ["Mon-Fri 06:00-18:00"], "time_zone": "Europe/Berlin"},
        default=None,
    )
