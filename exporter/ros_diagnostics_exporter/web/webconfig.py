"""The file of --web.config.file: its format, TLS, what is in force, reloaded on change.

The format is that of Prometheus' exporter-toolkit
(https://github.com/prometheus/exporter-toolkit, docs/web-configuration.md); what this server does
not support is an error.
"""

from __future__ import annotations

import logging
import re
import ssl
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
    model_validator,
)

from ros_diagnostics_exporter import durations
from ros_diagnostics_exporter.config.yaml_file import Document
from ros_diagnostics_exporter.config.yaml_file import read as read_yaml
from ros_diagnostics_exporter.files import Signature, signature

_CIPHERS = {
    f"TLS_ECDHE_{key}_WITH_{go}": f"ECDHE-{key}-{openssl}"
    for key in ("RSA", "ECDSA")
    for go, openssl in {
        "AES_128_CBC_SHA": "AES128-SHA",
        "AES_256_CBC_SHA": "AES256-SHA",
        "AES_128_GCM_SHA256": "AES128-GCM-SHA256",
        "AES_256_GCM_SHA384": "AES256-GCM-SHA384",
        "CHACHA20_POLY1305_SHA256": "CHACHA20-POLY1305",
    }.items()
}
_VERSIONS = {"TLS12": ssl.TLSVersion.TLSv1_2, "TLS13": ssl.TLSVersion.TLSv1_3}
_VERIFY_MODES = {
    "NoClientCert": ssl.CERT_NONE,
    "VerifyClientCertIfGiven": ssl.CERT_OPTIONAL,
    "RequireAndVerifyClientCert": ssl.CERT_REQUIRED,
}


def _cipher(name: str) -> str:
    if name not in _CIPHERS:
        raise ValueError(f"unknown cipher suite {name!r}; known are {', '.join(_CIPHERS)}")
    return _CIPHERS[name]


def _version(text: str) -> str:
    if text in {"TLS10", "TLS11"}:
        raise ValueError(f"{text} is not supported, RFC 8996 forbids it; write TLS12 or TLS13")
    return text


def _client_auth(text: str) -> str:
    if text in {"RequestClientCert", "RequireAnyClientCert"}:
        raise ValueError(
            f"{text} accepts certificates without verifying them and is not supported; write "
            "VerifyClientCertIfGiven or RequireAndVerifyClientCert"
        )
    return text


class Section(BaseModel):
    """A part of the web config; unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True)


Version = Annotated[Literal["TLS12", "TLS13"], BeforeValidator(_version)]


class TlsConfig(Section):
    """``tls_server_config``; file names are already relative to the file's own folder."""

    cert_file: Path
    key_file: Path
    client_ca_file: Path | None = None
    client_ca: str | None = None
    client_auth_type: Annotated[
        Literal["NoClientCert", "VerifyClientCertIfGiven", "RequireAndVerifyClientCert"],
        BeforeValidator(_client_auth),
    ] = "NoClientCert"
    client_allowed_sans: tuple[str, ...] = ()
    min_version: Version = "TLS12"
    max_version: Version = "TLS13"
    cipher_suites: tuple[Annotated[str, AfterValidator(_cipher)], ...] = ()
    prefer_server_cipher_suites: bool = True

    @model_validator(mode="before")
    @classmethod
    def _name_unsupported_keys(cls, data: Any) -> Any:
        if isinstance(data, dict):
            for key in ("cert", "key"):
                if key in data:
                    raise ValueError(f"{key}: PEM text is not supported here; write {key}_file")
            if "curve_preferences" in data:
                raise ValueError("curve_preferences is not supported; OpenSSL's own are used")
        return data

    @model_validator(mode="after")
    def _check_combinations(self) -> TlsConfig:
        if self.client_ca and self.client_ca_file:
            raise ValueError("give client_ca or client_ca_file, not both")
        has_ca = bool(self.client_ca or self.client_ca_file)
        if has_ca != (self.client_auth_type != "NoClientCert"):
            raise ValueError(
                "give both client_ca_file and a client_auth_type that verifies, or neither"
            )
        if self.client_allowed_sans and self.client_auth_type != "RequireAndVerifyClientCert":
            raise ValueError(
                "client_allowed_sans needs client_auth_type: RequireAndVerifyClientCert"
            )
        if self.min_version > self.max_version:
            raise ValueError("min_version is above max_version")
        return self

    @property
    def files(self) -> tuple[Path, ...]:
        """The files that belong to the configuration."""
        return tuple(filter(None, (self.cert_file, self.key_file, self.client_ca_file)))


class _ServerSide(ssl.SSLObject):
    """The server's side of one connection; checks the name in the client's certificate."""

    def do_handshake(self) -> None:
        super().do_handshake()
        allowed = getattr(self.context, "allowed_sans", ())
        if allowed and _names(self.getpeercert() or {}).isdisjoint(allowed):
            raise ssl.SSLCertVerificationError("no name of the client's certificate is allowed")


def _names(certificate: Mapping[str, Any]) -> set[str]:
    return {name for _kind, name in certificate.get("subjectAltName", ())}


class _Context(ssl.SSLContext):
    allowed_sans: tuple[str, ...] = ()
    sslobject_class = _ServerSide


def make_context(tls: TlsConfig) -> ssl.SSLContext:
    """The server's context for a configuration.

    Raises:
        ValueError: A certificate, key or CA cannot be read, or they do not belong together.
    """
    context = _Context(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = _VERSIONS[tls.min_version]
    context.maximum_version = _VERSIONS[tls.max_version]
    context.set_alpn_protocols(["http/1.1"])
    context.verify_mode = _VERIFY_MODES[tls.client_auth_type]
    context.allowed_sans = tls.client_allowed_sans
    if not tls.prefer_server_cipher_suites:
        context.options &= ~ssl.OP_CIPHER_SERVER_PREFERENCE
    try:
        if tls.cipher_suites:
            context.set_ciphers(":".join(tls.cipher_suites))
        context.load_cert_chain(tls.cert_file, tls.key_file, password=_reject_passphrase)
        if tls.client_ca_file or tls.client_ca:
            context.load_verify_locations(cafile=tls.client_ca_file, cadata=tls.client_ca)
    except (OSError, ValueError) as error:  # ssl.SSLError is an OSError
        files = ", ".join(str(path) for path in tls.files)
        raise ValueError(f"tls_server_config: {error} (of {files})") from error
    return context


def _reject_passphrase() -> str:
    # Without this OpenSSL would ask for it on the terminal and wait for ever.
    raise ValueError("the key is encrypted; write it without a passphrase")


class ReloadingContext(ssl.SSLContext):
    """Uses ``current`` for each new connection, so that it may be replaced.

    asyncio only calls a context's ``wrap_bio``, at the start of every handshake.
    """

    current: ssl.SSLContext

    def wrap_bio(self, *args: Any, **kwargs: Any) -> ssl.SSLObject:
        """The server's side of a new connection."""
        return self.current.wrap_bio(*args, **kwargs)


_BCRYPT = re.compile(r"\$2[aby]\$(0[4-9]|1[0-9]|2[0-9]|3[01])\$[./A-Za-z0-9]{53}")

_log = logging.getLogger(__name__)


class WebConfigError(ValueError):
    """The file is invalid; the text names the file, the key and what would be right."""


def _hash(text: str) -> str:
    if not _BCRYPT.fullmatch(text):
        raise ValueError("is not a bcrypt hash; make one with: htpasswd -nBC 10 USER")
    return text


def _seconds(text: Any) -> float:
    if text in (0, "0"):
        return 0.0
    try:
        return durations.parse(str(text))
    except ValueError as error:
        raise ValueError(f"{error}; write 500ms, 1s, 1m, 1h, or 0 for no limit") from None


_Frame = Literal["", "deny", "sameorigin"]
_Sniff = Literal["", "nosniff"]


class Headers(Section):
    """``http_server_config.headers``: headers of every response."""

    content_security_policy: str = Field(default="", alias="Content-Security-Policy")
    x_frame_options: _Frame = Field(default="", alias="X-Frame-Options")
    x_content_type_options: _Sniff = Field(default="", alias="X-Content-Type-Options")
    x_xss_protection: str = Field(default="", alias="X-XSS-Protection")
    strict_transport_security: str = Field(default="", alias="Strict-Transport-Security")


class HttpConfig(Section):
    """``http_server_config``; HTTP/1.1 is served whatever ``http2`` says."""

    http2: bool = True
    headers: Headers = Headers()


class RateLimit(Section):
    """``rate_limit``: one request every ``interval`` seconds, up to ``burst`` at once."""

    interval: Annotated[float, BeforeValidator(_seconds)] = 0.0
    burst: int = Field(default=0, ge=0)

    @model_validator(mode="after")
    def _check_burst(self) -> RateLimit:
        if self.interval > 0 and self.burst < 1:
            raise ValueError("burst must be at least 1, or every request is rejected")
        return self


class WebConfig(Section):
    """The content of the file."""

    tls_server_config: TlsConfig | None = None
    http_server_config: HttpConfig = HttpConfig()
    basic_auth_users: Mapping[str, Annotated[str, AfterValidator(_hash)]] = {}
    rate_limit: RateLimit = RateLimit()


def read(path: Path) -> WebConfig:
    """The configuration in the file at ``path``; an empty file sets nothing.

    Raises:
        WebConfigError: It cannot be read or is invalid; one line per error.
    """
    document, problems = read_yaml(path)
    if document is None or problems:
        raise WebConfigError("\n".join(str(problem) for problem in problems))
    data = {} if document.data is None else document.data
    if isinstance(data, dict) and isinstance(data.get("tls_server_config"), dict):
        data = {**data, "tls_server_config": _resolve_files(path, data["tls_server_config"])}
    try:
        return WebConfig.model_validate(data)
    except ValidationError as error:
        raise WebConfigError("\n".join(_lines(document, error))) from error


def _resolve_files(path: Path, tls: dict[str, Any]) -> dict[str, Any]:
    """File names are relative to the folder of the web config, as in exporter-toolkit."""
    return {
        key: path.parent / value if key.endswith("_file") and isinstance(value, str) else value
        for key, value in tls.items()
    }


def _lines(document: Document, error: ValidationError) -> Iterator[str]:
    """One line per error, without the value: it may be a secret."""
    for each in error.errors(include_url=False, include_input=False):
        where = each["loc"]
        what = each["msg"].removeprefix("Value error, ")
        if each["type"] == "extra_forbidden":
            what = "unknown key"
        key = ".".join(str(part) for part in where)
        yield f"{document.path}:{document.line(where)}: " + (f"{key}: {what}" if key else what)


class LiveWebConfig:
    """The web config in force, reloaded when one of its files changes.

    `refresh` is called by one loop: its files may hang. The event loop uses what it has read.

    Args:
        path: The file; None for plain HTTP without logins.

    Raises:
        WebConfigError: The file is invalid. Later on, the previous configuration is kept instead.

    Attributes:
        config: The configuration.
        context: For TLS; None without.
    """

    def __init__(self, path: Path | None) -> None:
        self._path = path
        self.config = WebConfig()
        self.context: ReloadingContext | None = None
        if path is not None:
            self._apply(read(path))
        self._signature = self._files_signature()

    def refresh(self) -> None:
        """Reload if a file has changed; errors are logged and change nothing."""
        current = self._files_signature()
        if self._path is None or current == self._signature:
            return
        self._signature = current
        try:
            self._apply(self._reread(self._path))
        except WebConfigError as error:
            _log.error("web config reload failed, keeping the previous one: %s", error)
        else:
            _log.info("reloaded the web config %s", self._path)

    def _reread(self, path: Path) -> WebConfig:
        fresh = read(path)
        if (removed := _removed_protection(self.config, fresh)) is not None:
            raise WebConfigError(
                f"{path}: {removed} cannot be removed while the exporter runs, because the file "
                "may be incomplete. To remove it, restart the exporter"
            )
        if fresh.tls_server_config is not None and self.context is None:
            raise WebConfigError(
                f"{path}: tls_server_config: TLS cannot be switched on while the exporter runs; "
                "restart it"
            )
        return fresh

    def _apply(self, fresh: WebConfig) -> None:
        if fresh.tls_server_config is not None:
            try:
                made = make_context(fresh.tls_server_config)
            except ValueError as error:
                raise WebConfigError(str(error)) from error
            self.context = self.context or ReloadingContext(ssl.PROTOCOL_TLS_SERVER)
            self.context.current = made
        self.config = fresh

    def _files_signature(self) -> Signature:
        tls = self.config.tls_server_config
        paths = (*((self._path,) if self._path else ()), *(tls.files if tls else ()))
        return signature(paths)


def _removed_protection(old: WebConfig, new: WebConfig) -> str | None:
    """The key of a restriction that is in ``old`` and not in ``new``; None without one."""
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
