"""Text messages by Alertmanager's own sns_configs; Amazon's part is played by moto's server."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass
from typing import Any

import yaml

from testbed import http as asking
from testbed.configuration import CHECKOUT

SENT = "/moto-api/data.json"
# The route as it is shipped, switched off; people take its comment signs away.
COMMENTED = """\
    # - matchers: [severity = critical]
    #   receiver: sms
    #   continue: true
"""


def with_text_messages(amazon: str) -> dict[str, Any]:
    """Return the shipped configuration with its route for text messages switched on."""
    text = (CHECKOUT / "alertmanager" / "alertmanager.yml").read_text()
    assert COMMENTED in text
    config = yaml.safe_load(text.replace(COMMENTED, COMMENTED.replace("# ", "")))
    [receiver] = [each for each in config["receivers"] if each["name"] == "sms"]
    [sns] = receiver["sns_configs"]
    sns["api_url"] = f"http://{amazon}"
    sns["sigv4"] = {"region": "eu-central-1", "access_key": "any", "secret_key": "any"}
    return config  # type: ignore[no-any-return]


def sent(amazon: str) -> list[str]:
    """Return the text messages that Amazon's stand-in has taken, oldest first."""
    services = asking.get_json(amazon, SENT)  # a service is there from its first use on
    return [each["message"] for each in services.get("sns", {}).get("SMS", [])]


@dataclass(frozen=True)
class Text:
    """A text message, and when (Unix time) it was first seen: no earlier than it was sent."""

    received: float
    words: str


class Phone:
    """Looks for new text messages in a thread, because the server keeps no time of them."""

    def __init__(self, amazon: str) -> None:
        self._amazon = amazon
        self._texts: list[Text] = []
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._look)

    def start(self) -> None:
        """Begin to look."""
        self._thread.start()

    def stop(self) -> None:
        """Look no more."""
        self._stop.set()
        self._thread.join()

    def texts(self) -> list[Text]:
        """Return all text messages that have arrived until now."""
        return list(self._texts)

    def _look(self) -> None:
        while not self._stop.wait(0.5):
            try:
                words = sent(self._amazon)
            except asking.Unanswered:  # busy; the next look finds what this one missed
                continue
            now = time.time()
            self._texts += [Text(now, each) for each in words[len(self._texts) :]]
