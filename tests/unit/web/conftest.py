"""The fixtures of a server on simple functions."""

from support.web_server import ca, plain, serve, tls_config

__all__ = ["ca", "plain", "serve", "tls_config"]
