"""Whether a request that changes something comes from a page of another site.

Only browsers send the headers that are looked at here, and pages cannot leave all of them out:
requests of tools (curl, Prometheus, scripts) have none and pass.
"""

from __future__ import annotations

import ipaddress
import socket
from collections.abc import Mapping
from urllib.parse import urlsplit


def is_foreign(headers: Mapping[str, str], scheme: str) -> bool:
    """Whether a browser sent this for another site's page.

    Args:
        headers: The request's; names in lower case.
        scheme: What the exporter itself serves, http or https.
    """
    # https://www.w3.org/TR/fetch-metadata/#sec-fetch-site-header; not sent over plain HTTP.
    if headers.get("sec-fetch-site", "none") not in {"none", "same-origin"}:
        return True
    page = headers.get("origin", headers.get("referer"))
    return page is not None and not _is_own(page, headers.get("host", ""), scheme)


def _is_own(page: str, host: str, scheme: str) -> bool:
    try:
        origin, own = urlsplit(page), urlsplit(f"//{host}")
        same = host != "" and origin.netloc.lower() == own.netloc.lower()
        # Without TLS here, a proxy in front may still serve https to browsers.
        return same and origin.scheme in {scheme, "https"} and _cannot_be_bought(own.hostname or "")
    except ValueError:  # no URL
        return False


def _cannot_be_bought(host: str) -> bool:
    """Whether no other site can have this name and point it here (DNS rebinding)."""
    try:
        ipaddress.ip_address(host)
    except ValueError:
        return "." not in host or host == socket.gethostname().lower()
    return True
