"""TLS: from the settings to a context, and a context that follows them while connections come."""

from __future__ import annotations

import ssl
from collections.abc import Callable, Mapping
from typing import Any

from ros_diagnostics_exporter.web.webconfig import Tls, WebConfigError

_VERSIONS = {"TLS12": ssl.TLSVersion.TLSv1_2, "TLS13": ssl.TLSVersion.TLSv1_3}
_CLIENTS = {
    "NoClientCert": ssl.CERT_NONE,
    "VerifyClientCertIfGiven": ssl.CERT_OPTIONAL,
    "RequireAndVerifyClientCert": ssl.CERT_REQUIRED,
}


class _Side(ssl.SSLObject):
    """The server's side of one connection: the client's certificate must bear an allowed name."""

    def do_handshake(self) -> None:
        super().do_handshake()
        allowed = getattr(self.context, "allowed_sans", ())
        if allowed and _names(self.getpeercert() or {}).isdisjoint(allowed):
            raise ssl.SSLCertVerificationError("no name of the client's certificate is allowed")


def _names(certificate: Mapping[str, Any]) -> set[str]:
    return {name for _kind, name in certificate.get("subjectAltName", ())}


class _Context(ssl.SSLContext):
    allowed_sans: tuple[str, ...] = ()
    sslobject_class = _Side


def make_context(tls: Tls) -> ssl.SSLContext:
    """A server's context for the settings.

    Raises:
        WebConfigError: A certificate, key or CA cannot be read, or they do not belong together.
    """
    context = _Context(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = _VERSIONS[tls.min_version]
    context.maximum_version = _VERSIONS[tls.max_version]
    context.set_alpn_protocols(["http/1.1"])
    context.verify_mode = _CLIENTS[tls.client_auth_type]
    context.allowed_sans = tls.client_allowed_sans
    if not tls.prefer_server_cipher_suites:
        context.options &= ~ssl.OP_CIPHER_SERVER_PREFERENCE
    try:
        if tls.cipher_suites:
            context.set_ciphers(":".join(tls.cipher_suites))
        context.load_cert_chain(tls.cert_file, tls.key_file, password=_refuse_password)
        if tls.client_ca_file or tls.client_ca:
            context.load_verify_locations(cafile=tls.client_ca_file, cadata=tls.client_ca)
    except (OSError, ValueError) as error:  # ssl.SSLError is an OSError
        files = ", ".join(str(path) for path in tls.files)
        raise WebConfigError(f"tls_server_config: {error} (of {files})") from error
    return context


def _refuse_password() -> str:
    # Without this OpenSSL would ask for it on the terminal and wait for ever.
    raise ValueError("the key is encrypted; write it without a passphrase")


class FollowingContext(ssl.SSLContext):
    """Each new connection gets the context that ``current`` returns then.

    asyncio asks a context for nothing but ``wrap_bio``, at the start of every handshake.
    """

    current: Callable[[], ssl.SSLContext]

    def wrap_bio(self, *args: Any, **kwargs: Any) -> ssl.SSLObject:
        """The server's side of a new connection."""
        return self.current().wrap_bio(*args, **kwargs)


def follow(current: Callable[[], ssl.SSLContext]) -> FollowingContext:
    """A context for a server whose settings may change."""
    context = FollowingContext(ssl.PROTOCOL_TLS_SERVER)
    context.current = current
    return context
