"""Hosts and the monitoring itself: whoever watches is watched here."""

from __future__ import annotations

from grafana_foundation_sdk.builders import bargauge, table, timeseries
from grafana_foundation_sdk.builders import dashboard as builders

from fleet_dashboards.dashboards import hosts, servers
from fleet_dashboards.lib import dashboard as frame
from fleet_dashboards.lib import links, palette, panels, tables, variables
from fleet_dashboards.lib.tables import Column
from fleet_dashboards.queries import monitoring as queries

FLEET = Column("fleet", "Fleet")
UP = palette.up_mappings()
WORKED = palette.worked_mappings()


def build() -> builders.Dashboard:
    """The dashboard of the monitoring."""
    return frame.board(
        links.MONITORING_UID,
        "Hosts and monitoring",
        "Can what the other dashboards show be trusted?",
        [variables.fleet()],
        [
            hosts.hosts(),
            targets(),
            hosts.computers(),
            "Exporters",
            exporters(),
            domains_down(),
            messages(),
            rejected(),
            scrape_time(),
            cpu(),
            memory(),
            series(),
            series_by_family(),
            "Prometheus and Alertmanager",
            servers.rule_failures(),
            servers.not_notified(),
            servers.alertmanagers(),
            servers.prometheus_series(),
            servers.cluster_members(),
            servers.reloaded(),
            servers.rule_time(),
            servers.samples(),
            servers.alerts_known(),
            servers.latency(),
            servers.server_cpu(),
            servers.server_memory(),
            "Computers over time",
            *hosts.over_time(),
        ],
    )


def targets() -> table.Panel:
    """All that Prometheus scrapes."""
    return tables.listing(
        "Scraped",
        "Does everything answer that Prometheus scrapes, how fast, and with how much?",
        "Nothing is scraped",
        {"A": queries.UP, "B": queries.SCRAPE_DURATION, "C": queries.SCRAPE_SAMPLES},
        [
            Column("A", "State", mappings=UP, width=90),
            Column("job", "Job"),
            Column("instance", "Instance"),
            FLEET,
            Column("B", "Took", unit="s", width=100),
            Column("C", "Samples", width=100),
        ],
        descending=False,
        by="job, instance, fleet",
    ).span(12)


def exporters() -> table.Panel:
    """A row for each exporter."""
    return (
        tables.listing(
            "Exporters",
            "Which version serves each fleet, with how many robots, and did its config and its "
            "state file work the last time? Acknowledgements: whether Alertmanager answers when "
            "asked for them; empty where it is not asked.",
            "No exporter is scraped",
            {
                "A": queries.BUILD,
                "B": queries.CONFIG_OK,
                "C": queries.CONFIG_TIME,
                "D": queries.STORAGE_OK,
                "E": queries.STORAGE_TIME,
                "F": queries.ROBOTS,
                "G": queries.DOMAINS,
                "H": queries.DISCOVERY_AGE,
                "I": queries.ALERTMANAGER_UP,
            },
            [
                FLEET,
                Column("version", "Version", width=90),
                Column("ros_distro", "ROS", width=80),
                Column("F", "Robots", width=80),
                Column("G", "Domains", width=80),
                Column("H", "Graph seen", unit="dtdurations", width=120),
                Column("B", "Config", mappings=WORKED, width=90),
                Column("C", "Config read", unit="dateTimeAsIso", width=170),
                Column("D", "State file", mappings=WORKED, width=90),
                Column("E", "State written", unit="dateTimeAsIso", width=170),
                Column("I", "Acknowledgements", mappings=UP, width=140),
            ],
            sort="Fleet",
            descending=False,
            by="fleet",
        )
        .height(8)
        .span(18)
    )


def domains_down() -> table.Panel:
    """DDS domains that could not be joined."""
    return (
        tables.listing(
            "DDS domains down",
            "Which DDS domains could not be joined?",
            "All domains are joined",
            {"A": queries.DOMAINS_DOWN},
            [FLEET, Column("domain_id", "Domain")],
            sort="Domain",
            descending=False,
        )
        .height(8)
        .span(6)
    )


def messages() -> timeseries.Panel:
    """Load from the robots."""
    return panels.graph(
        "Messages",
        "How many arrays does each fleet send in a second?",
        panels.over_time(queries.MESSAGES, "{{fleet}}"),
        unit="cps",
    )


def rejected() -> timeseries.Panel:
    """What was not taken in."""
    return panels.graph(
        "Rejected messages",
        "What is received and not taken in, and why?",
        panels.over_time(queries.REJECTED, "{{fleet}}: {{reason}}"),
        unit="cps",
    )


def scrape_time() -> timeseries.Panel:
    """Time of a scrape."""
    return panels.graph(
        "Time of a scrape",
        "How long does a scrape of each exporter take, and how much of that is rendering?",
        panels.over_time(queries.EXPORTER_SCRAPE_TIME, "{{fleet}}: scrape"),
        panels.over_time(queries.RENDER_TIME, "{{fleet}}: rendering", "B"),
        unit="s",
    )


def cpu() -> timeseries.Panel:
    """CPU of the exporters."""
    return panels.graph(
        "CPU of the exporters",
        "What do the exporters spend their time on? 100 % is one core.",
        panels.over_time(queries.CPU, "{{fleet}}: all"),
        panels.over_time(queries.DECODE, "{{fleet}}: decoding", "B"),
        panels.over_time(queries.INGEST, "{{fleet}}: taking in", "C"),
        unit="percentunit",
    )


def memory() -> timeseries.Panel:
    """Memory of the exporters."""
    return panels.graph(
        "Memory of the exporters",
        "Does an exporter leak?",
        panels.over_time(queries.MEMORY, "{{fleet}}"),
        unit="bytes",
    )


def series() -> timeseries.Panel:
    """Series and their bound."""
    return panels.graph(
        "Series",
        "How near is each exporter to its bound of series? Dashed: the bound.",
        panels.over_time(queries.SERIES, "{{fleet}}"),
        panels.over_time(queries.SERIES_LIMIT, "bound of {{fleet}}", "B"),
    ).override_by_regexp("/^bound of /", panels.dashed(palette.CRITICAL.colour))


def series_by_family() -> bargauge.Panel:
    """Where the series come from."""
    return panels.bars(
        "Series by family",
        "Which metric family costs how many series?",
        panels.at_end(queries.SERIES_BY_FAMILY, "{{fleet}}: {{family}}"),
    )
