"""How many connections the limit of open files leaves for clients."""

from __future__ import annotations

import logging
import resource

MOST = 500  # connections
LEAST = 20  # connections, however low the limit is
OWN = 60  # files of the exporter itself: libraries, the state file, logs, listening sockets
DOMAIN = 20  # files of a DDS domain; measured: eleven

_log = logging.getLogger(__name__)


def allowed_connections(domains: int) -> int:
    """Raise the limit of open files as far as may be; how many connections it leaves room for.

    Go's runtime raises it for its servers, too. What is too low is logged, with the way out.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft != hard:
        try:
            resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
            soft = hard
        except (OSError, ValueError) as error:  # a sandbox may forbid it
            _log.warning("the limit of open files cannot be raised above %d: %s", soft, error)
    others = OWN + DOMAIN * domains
    connections = max(LEAST, min(MOST, soft - others))
    if connections < MOST:
        _log.warning(
            "only %d files may be open: %d connections are accepted at once instead of %d; raise "
            "the limit to %d (LimitNOFILE= of a systemd unit, ulimit -n, --ulimit nofile=)",
            soft,
            connections,
            MOST,
            MOST + others,
        )
    return connections
