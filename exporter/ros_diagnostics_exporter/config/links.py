"""The key `links`: what people open of a robot beside its page, such as its manual."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, Any
from urllib.parse import quote

from ros_diagnostics_exporter.config.errors import WrongValueError, quoted
from ros_diagnostics_exporter.config.keys import Value, Written
from ros_diagnostics_exporter.config.scalars import matching, text

MAX_NAME = 40  # characters
MAX_URL = 500
ROBOT, ADDRESS = "{robot}", "{address}"
# What a browser opens and nothing that runs in the page, such as javascript:
_URL = r"https?://(?:[!-z|~]|\{robot\}|\{address\})+"


def link_name(value: Any) -> str:
    """What the link is called on the page."""
    found = text(value)
    if not (found.isprintable() and found == found.strip() and 1 <= len(found) <= MAX_NAME):
        what = f"{quoted(found)} cannot be the name of a link"
        raise WrongValueError(what, f"use 1 to {MAX_NAME} letters, such as manual")
    return found


def link(value: Any) -> str:
    """An address of the web, perhaps with the robot's name and host in it."""
    remedy = "write it as https://host/page?r={robot} or http://{address}:80, without spaces"
    return matching(value, _URL, "is no address of the web", remedy, MAX_URL)


LinkName = Annotated[
    str, Value(link_name, "name", type="string", pattern=r"^\S(.*\S)?$", maxLength=MAX_NAME)
]
Link = Annotated[str, Value(link, "URL", type="string", pattern=f"^{_URL}$", maxLength=MAX_URL)]
Links = Annotated[Mapping[str, str], Written(dict[LinkName, Link], MappingProxyType)]


def filled(links: Mapping[str, str], robot: str, host: str) -> dict[str, str]:
    """The links of a robot with its name and its host; one whose host is not known is left out."""
    return {
        name: url.replace(ROBOT, quote(robot, safe="")).replace(ADDRESS, host)
        for name, url in links.items()
        if host or ADDRESS not in url
    }
