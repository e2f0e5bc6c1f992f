"""TLS: ``tls_server_config`` of the web config, and the server's SSL contexts."""

from __future__ import annotations

import ssl
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, model_validator

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
    """Uses the context that ``current`` returns for each new connection.

    asyncio only calls a context's ``wrap_bio``, at the start of every handshake.
    """

    current: Callable[[], ssl.SSLContext]

    def wrap_bio(self, *args: Any, **kwargs: Any) -> ssl.SSLObject:
        """The server's side of a new connection."""
        return self.current().wrap_bio(*args, **kwargs)


def reloading_context(current: Callable[[], ssl.SSLContext]) -> ReloadingContext:
    """A context for a server whose TLS configuration may be reloaded."""
    context = ReloadingContext(ssl.PROTOCOL_TLS_SERVER)
    context.current = current
    return context
