"""The file of --web.config.file, in the format of Prometheus' exporter-toolkit.

Owns what the file may say (https://github.com/prometheus/exporter-toolkit, web-configuration.md)
and which of it this server cannot do.
"""

from __future__ import annotations

import re
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

_BCRYPT = re.compile(r"\$2[aby]\$(0[4-9]|1[0-9]|2[0-9]|3[01])\$[./A-Za-z0-9]{53}")
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


class WebConfigError(ValueError):
    """The file cannot be used; the text names file, key and what would be right."""


def _hash(text: str) -> str:
    if not _BCRYPT.fullmatch(text):
        raise ValueError("is not a bcrypt hash; make one with: htpasswd -nBC 10 USER")
    return text


def _cipher(name: str) -> str:
    if name not in _CIPHERS:
        raise ValueError(f"unknown cipher suite {name!r}; known are {', '.join(_CIPHERS)}")
    return _CIPHERS[name]


def _seconds(text: Any) -> float:
    if text in (0, "0"):
        return 0.0
    try:
        return durations.parse(str(text))
    except ValueError:
        raise ValueError(
            f"{text!r} is no duration; write 500ms, 1s, 1m or 1h, or 0 for no limit"
        ) from None


def _version(text: str) -> str:
    if text in {"TLS10", "TLS11"}:
        raise ValueError(f"{text} is not served, RFC 8996 forbids it; write TLS12 or TLS13")
    return text


def _client_auth(text: str) -> str:
    if text in {"RequestClientCert", "RequireAnyClientCert"}:
        raise ValueError(
            f"{text} takes certificates without verifying them and is not served; write "
            "VerifyClientCertIfGiven or RequireAndVerifyClientCert"
        )
    return text


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


Version = Annotated[Literal["TLS12", "TLS13"], BeforeValidator(_version)]


class Tls(_Part):
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
    def _name_what_cannot_be_done(cls, said: Any) -> Any:
        if isinstance(said, dict):
            for key in ("cert", "key"):
                if key in said:
                    raise ValueError(f"{key}: PEM text is not read here; write {key}_file")
            if "curve_preferences" in said:
                raise ValueError("curve_preferences cannot be set here; OpenSSL's own are used")
        return said

    @model_validator(mode="after")
    def _fit_together(self) -> Tls:
        if self.client_ca and self.client_ca_file:
            raise ValueError("client_ca and client_ca_file exclude each other")
        has_ca = bool(self.client_ca or self.client_ca_file)
        if has_ca != (self.client_auth_type != "NoClientCert"):
            raise ValueError("client_ca_file and a client_auth_type that verifies need each other")
        if self.client_allowed_sans and self.client_auth_type != "RequireAndVerifyClientCert":
            raise ValueError(
                "client_allowed_sans needs client_auth_type: RequireAndVerifyClientCert"
            )
        if self.min_version > self.max_version:
            raise ValueError("min_version is above max_version")
        return self

    @property
    def files(self) -> tuple[Path, ...]:
        """The files that are part of the settings."""
        return tuple(filter(None, (self.cert_file, self.key_file, self.client_ca_file)))


_Frame = Literal["", "deny", "sameorigin"]
_Sniff = Literal["", "nosniff"]


class Headers(_Part):
    """``http_server_config.headers``: what every answer carries."""

    content_security_policy: str = Field(default="", alias="Content-Security-Policy")
    x_frame_options: _Frame = Field(default="", alias="X-Frame-Options")
    x_content_type_options: _Sniff = Field(default="", alias="X-Content-Type-Options")
    x_xss_protection: str = Field(default="", alias="X-XSS-Protection")
    strict_transport_security: str = Field(default="", alias="Strict-Transport-Security")


class Http(_Part):
    """``http_server_config``; HTTP/1.1 is served whatever ``http2`` says."""

    http2: bool = True
    headers: Headers = Headers()


class RateLimit(_Part):
    """``rate_limit``: one request every ``interval`` seconds, ``burst`` of them at once."""

    interval: Annotated[float, BeforeValidator(_seconds)] = 0.0
    burst: int = Field(default=0, ge=0)

    @model_validator(mode="after")
    def _fit_together(self) -> RateLimit:
        if self.interval > 0 and self.burst < 1:
            raise ValueError("burst must be at least 1, or nothing is ever answered")
        return self


class WebConfig(_Part):
    """All that the file says."""

    tls_server_config: Tls | None = None
    http_server_config: Http = Http()
    basic_auth_users: Mapping[str, Annotated[str, AfterValidator(_hash)]] = {}
    rate_limit: RateLimit = RateLimit()


def read(path: Path) -> WebConfig:
    """The settings in the file at ``path``; an empty file sets nothing.

    Raises:
        WebConfigError: It cannot be read, or says what it may not; one line per error.
    """
    document, problems = read_yaml(path)
    if document is None or problems:
        raise WebConfigError("\n".join(str(problem) for problem in problems))
    said = {} if document.data is None else document.data
    if isinstance(said, dict) and isinstance(said.get("tls_server_config"), dict):
        said = {**said, "tls_server_config": _beside(path, said["tls_server_config"])}
    try:
        return WebConfig.model_validate(said)
    except ValidationError as error:
        raise WebConfigError("\n".join(_lines(document, error))) from error


def _beside(path: Path, tls: dict[str, Any]) -> dict[str, Any]:
    """File names are meant from the folder that the settings are in, as exporter-toolkit does."""
    return {
        key: path.parent / value if key.endswith("_file") and isinstance(value, str) else value
        for key, value in tls.items()
    }


def _lines(document: Document, error: ValidationError) -> Iterator[str]:
    """One line an error, without what was written there: it may be a secret."""
    for each in error.errors(include_url=False, include_input=False):
        where = each["loc"]
        what = each["msg"].removeprefix("Value error, ")
        if each["type"] == "extra_forbidden":
            what = "unknown key"
        key = ".".join(str(part) for part in where)
        yield f"{document.path}:{document.line(where)}: " + (f"{key}: {what}" if key else what)
