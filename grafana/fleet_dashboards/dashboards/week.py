"""The week, for shift leaders: availability, response, worst parts, beside the week before."""

from __future__ import annotations

from grafana_foundation_sdk.builders import bargauge, stat, table
from grafana_foundation_sdk.builders import dashboard as builders
from grafana_foundation_sdk.models import common

from fleet_dashboards.dashboards.capabilities import availability
from fleet_dashboards.lib import links, palette, panels, tables, variables
from fleet_dashboards.lib.dashboard import new_dashboard
from fleet_dashboards.lib.promql import in_order, label, reached, settled
from fleet_dashboards.lib.tables import Column

_FLEET = 'fleet=~"$fleet"'
_WEEK = "ros_diagnostics_week_"
_BEFORE = " offset 7d"
_AVAILABLE = ', part=~"ok|warning"'
_COUNTED = ', part!~"maintenance|undetermined|pending"'
_DAYS = 7
# The words for the time range; Grafana 12 and later.
_RANGE = builders.TimeOption().display("7 days with today").from_val("now-6d/d").to("now/d")
_NAMES = ("Sun", "Mon", "Tue", "Wed", "Thu", "Fri", "Sat")


def build() -> builders.Dashboard:
    """Return the dashboard of the week until the end of the time range."""
    return (
        new_dashboard(
            links.WEEK_UID,
            "The week",
            "How available were the robots in the last seven days, today included, and how long "
            "did faults take, beside the week before?",
            [variables.fleet(), variables.target()],
            [
                share(),
                budget(),
                panels.now(faults()),
                panels.now(to_acknowledge()),
                panels.now(to_recover()),
                panels.now(notifications()),
                by_day(),
                panels.now(worst_parts()),
                panels.now(by_night()),
                availability(_FLEET),
            ],
        )
        .time("now-6d/d", "now/d")  # whole days of Grafana's time zone
        .timepicker(builders.TimePicker().quick_ranges([_RANGE]))
        .refresh("5m")
    )


def _seconds(by: str, of: str, matchers: str, window: str = "7d", shift: str = "") -> str:
    series = f"{of}:ros_diagnostics_part_seconds:sum5m{{{_FLEET}{matchers}}}"
    return f"sum by ({by}) (sum_over_time({series}[{window}]{shift}))"


def _available(by: str, of: str, window: str = "7d", shift: str = "") -> str:
    """Return the available seconds, 0 where there is none of those that count."""
    counted = _seconds(by, of, _COUNTED, window, shift)
    return f"({_seconds(by, of, _AVAILABLE, window, shift)} or {counted} * 0)"


def _share(by: str, of: str, window: str = "7d", shift: str = "") -> str:
    return f"{_available(by, of, window, shift)} / {_seconds(by, of, _COUNTED, window, shift)}"


def _beside(panel: stat.Panel, this: str, before: str) -> stat.Panel:
    """Show a number of each fleet for this week, and for the week before."""
    return (
        panel.targets(
            [
                panels.at_end(this, "{{fleet}}: this week"),
                panels.at_end(before, "{{fleet}}: week before", "B"),
            ]
        )
        .text_mode(common.BigValueTextMode.VALUE_AND_NAME)
        .span(8)
    )


def share() -> stat.Panel:
    """Show the availability of the fleets."""
    panel = panels.number(
        "Availability",
        "For which share of the time were the robots OK or in WARNING? Of the time without "
        "maintenance, pending and undetermined.",
        "vector(0)",
        "percentunit",
    ).decimals(2)
    return _beside(panel, _share("fleet", "fleet"), _share("fleet", "fleet", shift=_BEFORE))


def budget() -> stat.Panel:
    """Show the minutes that are left until the target is missed."""

    def left(shift: str) -> str:
        counted = _seconds("fleet", "fleet", _COUNTED, shift=shift)
        return f"({_available('fleet', 'fleet', shift=shift)} - $target / 100 * {counted}) / 60"

    panel = panels.number(
        "Budget left (robot minutes)",
        "How many minutes may robots still fail until the target is missed? Below zero it is. The "
        "target is chosen at the top.",
        "vector(0)",
        "none",
    ).decimals(0)
    return _beside(panel, left(""), left(_BEFORE))


def _counted(family: str, shift: str = "") -> str:
    """Return a number of the event log; the halves of a pair have one each, of the same faults."""
    found = f"max by (fleet, exporter) ({_WEEK}{family}{{{_FLEET}}}{shift})"
    return f"sum by (fleet) ({found})"


def faults() -> stat.Panel:
    """Count the critical faults."""
    panel = panels.number(
        "Critical faults", "How many critical faults were confirmed?", "vector(0)", "none"
    )
    return _beside(panel, _counted("faults"), _counted("faults", _BEFORE))


def notifications() -> stat.Panel:
    """Count the notifications."""
    panel = panels.number(
        "Notifications",
        "How many notifications of faults were sent, recoveries apart? Only where Alertmanager "
        "posts them to the exporter.",
        "vector(0)",
        "none",
    )
    return _beside(panel, _counted("notifications"), _counted("notifications", _BEFORE)).span(6)


def to_acknowledge() -> table.Panel:
    """Show how long acknowledging took."""
    return _times(
        "Time to acknowledge",
        "How long did it take from the confirmation of a critical fault until somebody "
        "acknowledged it? Of the faults that were.",
        "acknowledge",
    )


def to_recover() -> table.Panel:
    """Show how long repairs took."""
    return _times(
        "Time to recover",
        "How long did it take from the begin of the trouble until a critical fault recovered? Of "
        "the faults that did.",
        "recover",
    )


def _times(title: str, description: str, what: str) -> table.Panel:
    by = "fleet, exporter"

    def each(expr: str, shift: str) -> str:
        family, _, matchers = expr.partition("{")
        return f"max by ({by}) ({_WEEK}{family}{{{_FLEET}{matchers}}}{shift})"

    median = f'{what}_seconds{{, quantile="0.5"'
    longest = f'{what}_seconds{{, quantile="1"'
    number = f"{'acknowledged' if what == 'acknowledge' else 'recovered'}_faults{{"
    return (
        tables.joined(
            title,
            description,
            {
                "A": each(number, ""),
                "B": each(median, ""),
                "C": each(longest, ""),
                "D": each(median, _BEFORE),
                "E": each(number, _BEFORE),
            },
            [
                tables.FLEET,
                Column("exporter", "Exporter", width=90),
                Column("B", "Median", unit=tables.DURATION, width=85),
                Column("C", "Longest", unit=tables.DURATION, width=85),
                Column("A", "Faults", width=70),
                Column("D", "Median before", unit=tables.DURATION, width=120),
                Column("E", "Faults before", width=110),
            ],
            by=by,
            sort=("Fleet",),
            ascending=("Fleet",),
        )
        .span(9)
        .height(4)
    )


def by_day() -> table.Panel:
    """Show the availability of each robot on each day."""
    robot = "fleet, robot"
    week = in_order(_share(robot, "robot"))
    days = [
        f"{in_order(_share(robot, 'robot', '1d', f' offset {back}d' if back else ''))}"
        f" * on () group_left (day) {_day(back)}"
        for back in range(_DAYS - 1, -1, -1)
    ]
    known = label(in_order(f"({_seconds(robot, 'robot', '')})"), "day", "Known for")
    expr = "\nor\n".join([label(f"({week})", "day", "Week"), known, *days])
    return tables.pivot(
        "Availability by day",
        "On which days was which robot available? The worst first. Days are those of "
        "Grafana's time zone, by default the browser's; the last one is today. Known for says how "
        "much of the week the robot has been known.",
        expr,
        [
            tables.ROBOT_IN_ORDER,
            Column(
                "Week",
                "Week",
                "percentunit",
                palette.share_mappings(),
                width=95,
                decimals=2,
                background=True,
            ),
            Column("Known for", "Known for", unit="s", width=95, decimals=1),
            tables.FLEET,
            tables.NAME,
        ],
        label="day",
        sort="Week",
        others=palette.share_mappings(),
        unit="percentunit",
        descending=False,
    ).height(12)


def _day(back: int) -> str:
    """Return a series with the name of a day that ends with the time range in its label ``day``.

    PromQL has dates in UTC: at noon a day has the same date in any time zone.
    """
    noon = f"vector(time() - {back * 86400 + 43200})"
    named = f'count_values("weekday", day_of_week({noon}))'
    for number, name in enumerate(_NAMES):
        named = label(named, "weekday", name, "weekday", str(number))
    dated = f'count_values("date", day_of_month({noon}))'
    joined = f"({named} * on () group_left (date) {dated})"
    return f'label_join({joined}, "day", " ", "weekday", "date")'


def worst_parts() -> table.Panel:
    """List what was faulty for longest."""
    by = "fleet, robot, faulty"

    def of(family: str) -> str:
        return (
            f"max by ({by}) (label_replace({_WEEK}{family}{{{_FLEET}}},"
            ' "faulty", "$1", "part", "(.*)"))'
        )

    return tables.joined(
        "Faulty for longest",
        "Which parts were faulty for longest, and how often? The ten worst of each exporter.",
        {"A": of("faulty_seconds"), "B": of("faulty_times")},
        [
            tables.ROBOT,
            Column("faulty", "Part", min_width=180, wrapped=True),
            Column("A", "In all", unit=tables.DURATION, width=115),
            Column("B", "Times", width=70),
            tables.FLEET,
        ],
        by=by,
        empty=tables.Empty("Nothing was faulty", reached(settled(_FLEET)), "faulty"),
        sort=("In all",),
    ).span(14)


def by_night() -> bargauge.Panel:
    """Show the notifications of each night."""
    each = f"max by (fleet, exporter, night) ({_WEEK}night_notifications{{{_FLEET}}})"
    panel = panels.bars(
        "Notifications by night",
        "How many notifications were sent in each night, from 22:00 to 06:00 of the exporter's "
        "time zone? A night has the date of its evening.",
        panels.at_end(f"sum by (night) ({each})", "{{night}}"),
    )
    return panel.min(0).decimals(0).height(10).span(10)
