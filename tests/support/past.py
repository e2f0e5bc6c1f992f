"""A Prometheus that has only what was recorded elsewhere."""

from pathlib import Path

from testbed import servers
from testbed.engine import Engine
from testbed.site import Site


def start_with(site: Site, samples: Path) -> Engine:
    """Start it with the samples of an OpenMetrics file; it scrapes nothing."""
    servers.import_history(samples, site.folder)
    config = site.write("prometheus.yml", "scrape_configs: []\n")
    retention = "--storage.tsdb.retention.time=50y"
    address = site.addresses.prometheus
    site.start(servers.prometheus(site.folder, config, address, retention))
    site.wait_until_ready()
    return site.engine
