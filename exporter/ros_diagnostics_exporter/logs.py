"""The exporter's own log on standard error: logfmt for people and Loki, JSON for the rest."""

from __future__ import annotations

import json
import logging
import sys
import time

from ros_diagnostics_exporter.texts import to_json

FORMATS = ("logfmt", "json")


def set_up(level: str, form: str) -> None:
    """Log from ``level`` (debug, info, warning, error) upwards, in ``form`` (logfmt, json)."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(_Formatter(as_json=form == "json"))
    logging.basicConfig(level=level.upper(), handlers=[handler], force=True)


class _Formatter(logging.Formatter):
    """One line a record, whatever it says: what a robot sends must not forge lines of the log."""

    def __init__(self, *, as_json: bool) -> None:
        super().__init__()
        self._as_json = as_json

    def format(self, record: logging.LogRecord) -> str:
        """The record as one line."""
        fields = {
            "ts": _moment(record.created),
            "level": record.levelname.lower(),
            "logger": record.name,
            "msg": record.getMessage(),
        }
        if record.exc_info:
            fields["error"] = self.formatException(record.exc_info)
        if self._as_json:
            return json.dumps(fields).replace("\x7f", "\\u007f")  # DEL: all else is ASCII by then
        return " ".join(f"{key}={_quoted(value)}" for key, value in fields.items())


def _quoted(value: str) -> str:
    """As logfmt quotes: only where it has to be, invisible characters escaped."""
    plain = value.isascii() and value.isprintable() and not set(value) & set(' ="\\')
    return value if plain and value else to_json(value)


def _moment(created: float) -> str:
    whole = time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime(created))
    return f"{whole}.{int(created % 1 * 1000):03d}Z"
