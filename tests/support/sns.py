"""Text messages sent by Alertmanager's sns_configs to moto's server instead of Amazon SNS."""

import sys
import threading
import time
from dataclasses import dataclass
from typing import Any

from support.uncommented import uncommented
from testbed import http
from testbed.site import Site, free_address

SENT = "/moto-api/data.json"
# The shipped routes, commented out.
COMMENTED = """\
    # - matchers: [severity = critical, alertname != RosDiagnosticsUnacknowledged]
    #   receiver: sms
    #   continue: true
    # - matchers: [alertname = RosDiagnosticsUnacknowledged, step =~ "1|2"]
    #   receiver: sms-escalation
    #   continue: true
"""


def with_text_messages(sns_server: str) -> dict[str, Any]:
    """Return the shipped configuration with its routes for text messages enabled."""
    config = uncommented(COMMENTED)
    for receiver in config["receivers"]:
        for sns in receiver.get("sns_configs", ()):
            sns["api_url"] = f"http://{sns_server}"
            sns["sigv4"] = {"region": "eu-central-1", "access_key": "any", "secret_key": "any"}
    return config


def start_server(site: Site) -> str:
    """Start moto's server; returns its address."""
    address = free_address()
    host, _, port = address.partition(":")
    argv = [sys.executable, "-m", "moto.server", "-H", host, "-p", port]
    site.start_program("moto", argv, address, SENT).wait_until_ready()
    return address


def sent(sns_server: str) -> list[str]:
    """Return the text messages that the server received, oldest first."""
    services = http.get_json(sns_server, SENT)  # without "sns" before the first message
    return [each["message"] for each in services.get("sns", {}).get("SMS", [])]


@dataclass(frozen=True)
class TextMessage:
    """A text message, and when (Unix time) it was first seen, which is not before it was sent."""

    received: float
    text: str


class Phone:
    """Polls for text messages in a thread, because the server has no time of arrival."""

    def __init__(self, sns_server: str) -> None:
        self._sns_server = sns_server
        self._texts: list[TextMessage] = []
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._poll)

    def start(self) -> None:
        """Start polling."""
        self._thread.start()

    def stop(self) -> None:
        """Stop polling."""
        self._stop.set()
        self._thread.join()

    def texts(self) -> list[TextMessage]:
        """Return all text messages received until now."""
        return list(self._texts)

    def _poll(self) -> None:
        while not self._stop.wait(0.5):
            try:
                texts = sent(self._sns_server)
            except http.Unanswered:  # busy: the next poll has them too
                continue
            now = time.time()
            self._texts += [TextMessage(now, each) for each in texts[len(self._texts) :]]
