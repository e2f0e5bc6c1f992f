"""The fixtures of a web server on a fake backend."""

from support.web_server import ca, plain, serve, tls_config

__all__ = ["ca", "plain", "serve", "tls_config"]
