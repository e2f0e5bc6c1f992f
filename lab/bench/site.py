"""An exporter and the actors of `bench.actors`, in a ROS domain or around a zenoh router."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from testbed.processes import Process
from testbed.site import Site, free_address

CONFIG = """\
fleet: bench
{routers}\
discovery:
  - {{topic: "/{{robot}}/diagnostics_agg", {found}}}
"""


# The password is "right"; its hash is the quickest that there is.
LOGIN = """\
basic_auth_users:
  bench: $2b$04$RWXYT/S/v9Zud63z9wZgve9oBXXnWkkUTayZKV62XNunkpLEtCV2.
"""


class BenchSite(Site):
    """Its exporter finds every robot there, and asks no Alertmanager."""

    def __init__(
        self, folder: Path, *, zenoh: bool, seconds: float, more: str, options: Sequence[str]
    ) -> None:
        """Start the router, if there is one; it lasts for so many seconds."""
        super().__init__(folder)
        self.where = f"tcp/{free_address()}" if zenoh else str(self.domain_id)
        found, routers = f"domain_ids: [{self.where}]", ""
        if zenoh:
            found, routers = "zenoh: /", f"zenoh: {{routers: [{self.where}]}}\n"
            self.start_actor("router", self.where, seconds=seconds).wait_for_output("ready")
        more = more.replace("DOMAIN", self.where)
        self.slow = free_address()
        login = str(self.write("web.yml", LOGIN))
        options = [each.replace("SLOW", self.slow).replace("LOGIN", login) for each in options]
        self.config = CONFIG.format(found=found, routers=routers) + more
        self.make_exporter(self.write("fleet.yml", self.config), *options, alertmanager="")

    def start_actor(self, kind: str, *arguments: str, seconds: float) -> Process:
        """Start one of `bench.actors`, which ends by itself after so many seconds."""
        argv = [sys.executable, "-m", "bench.actors", kind, *arguments, str(seconds)]
        name = f"{kind}-{len(self.started)}"
        return self.start_program(name, argv, domain_id=self.domain_id).process


@contextmanager
def running(
    *, zenoh: bool = False, seconds: float, more: str = "", options: Sequence[str] = ()
) -> Iterator[BenchSite]:
    """A site in a folder of its own.

    ``seconds`` is how long a router lasts, ``more`` are lines of fleet.yml after its discovery, in
    which DOMAIN is where the robots are, ``options`` those of the exporter.
    """
    with tempfile.TemporaryDirectory(prefix="bench-") as folder:
        site = BenchSite(Path(folder), zenoh=zenoh, seconds=seconds, more=more, options=options)
        with site:
            yield site
