#!/usr/bin/env python3
"""A webhook receiver that writes one log line for each alert, and does nothing else.

Do not extend it to act on robots: one that is restarted, driven or switched by an alert can hurt
people, and an alert is neither authenticated nor on time. Propose actions, and let a person act.

    python3 webhook_receiver.py 127.0.0.1:9099

In alertmanager.yml, as a receiver and a route with `continue: true`:

    webhook_configs: [{url: "http://127.0.0.1:9099/", send_resolved: true}]
"""

from __future__ import annotations

import json
import logging
import sys
from http.server import BaseHTTPRequestHandler, HTTPServer
from typing import Any

LOG = logging.getLogger("webhook")
LARGEST = 1_000_000  # bytes; a group of one alert has some thousand


def lines(message: dict[str, Any]) -> list[str]:
    """One line for each alert of a message, as Alertmanager's webhook sends it (version 4)."""
    return [
        " ".join(
            [
                alert["status"],
                alert["labels"].get("alertname", "?"),
                *(
                    f"{name}={alert['labels'][name]!r}"
                    for name in ("fleet", "robot", "component", "severity")
                    if name in alert["labels"]
                ),
            ]
        )
        for alert in message["alerts"]
    ]


class Receiver(BaseHTTPRequestHandler):
    """Receives POSTs; a body that is not a message of Alertmanager is rejected with 400."""

    def do_POST(self) -> None:
        """Log the alerts. Alertmanager sends it again unless the answer is 2xx."""
        try:
            length = min(int(self.headers.get("Content-Length", 0)), LARGEST)
            received = lines(json.loads(self.rfile.read(length)))
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            self.send_error(400, explain=str(error))
            return
        for line in received:
            LOG.info(line)
        self.send_response(204)
        self.end_headers()

    def log_message(self, *_arguments: Any) -> None:
        """Log no line for the request itself."""


def main() -> None:
    """Serve until interrupted."""
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s")
    host, _, port = (sys.argv[1] if len(sys.argv) > 1 else "127.0.0.1:9099").rpartition(":")
    HTTPServer((host, int(port)), Receiver).serve_forever()


if __name__ == "__main__":
    main()
