"""The settings of --web.config.file as they hold now: read again when a file has changed."""

from __future__ import annotations

import logging
import ssl
from pathlib import Path

from ros_diagnostics_exporter.file_watcher import Signature, signature
from ros_diagnostics_exporter.web.tls import make_context
from ros_diagnostics_exporter.web.webconfig import WebConfig, WebConfigError, read

_log = logging.getLogger(__name__)


class Settings:
    """What the file says, or what holds without one. Used by the event loop's thread alone.

    Args:
        path: The file; None for plain HTTP and nobody asked who he is.

    Raises:
        WebConfigError: The file cannot be used. Later on, the last good settings stay instead.

    Attributes:
        config: The settings.
        context: For TLS; None where there is none.
    """

    def __init__(self, path: Path | None) -> None:
        self._path = path
        self.config = WebConfig()
        self.context: ssl.SSLContext | None = None
        if path is not None:
            self._take(read(path))
        self._marks = self._mark()

    def refresh(self) -> None:
        """Read again if a file has changed; what cannot be used is logged and changes nothing."""
        marks = self._mark()
        if self._path is None or marks == self._marks:
            return
        self._marks = marks
        try:
            self._take(self._reread(self._path))
        except WebConfigError as error:
            _log.error("the web config's last good settings stay: %s", error)
        else:
            _log.info("read the web config %s again", self._path)

    def _reread(self, path: Path) -> WebConfig:
        fresh = read(path)
        if (opened := _opened(self.config, fresh)) is not None:
            raise WebConfigError(
                f"{path}: {opened} cannot be taken away while the exporter runs: the file may be "
                "half written. If it is meant, restart the exporter"
            )
        if fresh.tls_server_config is not None and self.context is None:
            raise WebConfigError(
                f"{path}: tls_server_config: TLS cannot be switched on while the exporter runs; "
                "restart it"
            )
        return fresh

    def _take(self, fresh: WebConfig) -> None:
        if fresh.tls_server_config is not None:
            self.context = make_context(fresh.tls_server_config)
        self.config = fresh

    def _mark(self) -> Signature:
        tls = self.config.tls_server_config
        paths = (*((self._path,) if self._path else ()), *(tls.files if tls else ()))
        return signature(paths)


def _opened(old: WebConfig, new: WebConfig) -> str | None:
    """The key of a lock that ``old`` has and ``new`` has no more; None where there is none."""
    for name in ("tls_server_config", "basic_auth_users"):
        if getattr(old, name) and not getattr(new, name):
            return name
    if old.tls_server_config is None or new.tls_server_config is None:
        return None
    verified = "RequireAndVerifyClientCert"
    if old.tls_server_config.client_auth_type == verified != new.tls_server_config.client_auth_type:
        return "tls_server_config.client_auth_type"
    if old.tls_server_config.client_allowed_sans and not new.tls_server_config.client_allowed_sans:
        return "tls_server_config.client_allowed_sans"
    return None
