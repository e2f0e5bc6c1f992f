"""Liveliness tokens of zenoh's two ways to carry ROS -> connections and publishers. Pure.

    zenoh-bridge-ros2dds  @/<zenoh id>/@ros2_lv                      the bridge
                          @/<zenoh id>/@ros2_lv/MP/<key>/<type>/<qos>      a publisher
    rmw_zenoh             @ros2_lv/<domain>/<zenoh id>/<node>/<entity>/<kind>/<enclave>/<namespace>/
                              <node's name>[/<topic>/<type>/<type hash>/<qos>]

The bridge writes "/" in keys and types as a section sign, rmw_zenoh in names as "%" (docs/design.md
of ros2/rmw_zenoh). A topic's messages come on its key, of rmw_zenoh on
``<domain>/<topic>/<type>/<type hash>``.
"""

from __future__ import annotations

from typing import NamedTuple

_BRIDGED_TYPE = "diagnostic_msgs§msg§DiagnosticArray"
_RMW_TYPE = "diagnostic_msgs::msg::dds_::DiagnosticArray_"
# Bridges and nodes, which show that what connects a robot is there; publishers of DiagnosticArray,
# and of any type on topics that are named like theirs. Of no other endpoint, so that a robot of
# hundreds costs as much as one of two.
TOKENS = (
    "@/*/@ros2_lv",
    f"@/*/@ros2_lv/MP/*/{_BRIDGED_TYPE}/*",
    "@/*/@ros2_lv/MP/$*diagnostics$*/*/*",
    "@ros2_lv/*/*/*/*/NN/*/*/*",
    f"@ros2_lv/*/*/*/*/MP/*/*/*/*/{_RMW_TYPE}/*/*",
    "@ros2_lv/*/*/*/*/MP/*/*/*/$*diagnostics$*/*/*/*",
)


class Token(NamedTuple):
    """What a token shows: ``connection``, and of a publisher its topic and the key of its messages.

    A connection is a bridge, or the nodes of one namespace in one ROS domain: with rmw_zenoh each
    process is a session of its own. A topic is "/" and the key, of rmw_zenoh without its type.
    ``other_type`` is that of the messages, "" where it is DiagnosticArray.
    """

    connection: str
    topic: str = ""
    key: str = ""
    other_type: str = ""


def parse(token: str) -> Token | None:
    """What a token shows; None for one that is neither of these."""
    parts = token.split("/")
    if parts[0] == "@" and len(parts) >= 3 and parts[2] == "@ros2_lv":
        return _of_bridge(parts)
    if parts[0] == "@ros2_lv" and len(parts) >= 9:
        return _of_rmw(parts)
    return None


def _of_bridge(parts: list[str]) -> Token | None:
    _at, session, _admin, *publisher = parts
    if not publisher:
        return Token(session)
    if len(publisher) != 4 or publisher[0] != "MP":
        return None
    key, kind = (each.replace("§", "/") for each in publisher[1:3])
    return Token(session, f"/{key}", key, "" if publisher[2] == _BRIDGED_TYPE else kind)


def _of_rmw(parts: list[str]) -> Token | None:
    domain, kind, namespace = parts[1], parts[5], parts[7]
    connection = f"{domain}/{namespace}"
    if kind == "NN":
        return Token(connection)
    if kind != "MP" or len(parts) != 13:
        return None
    topic = domain + parts[9].replace("%", "/")
    other = parts[10].replace("dds_::", "").removesuffix("_").replace("::", "/")
    other = "" if parts[10] == _RMW_TYPE else other
    return Token(connection, f"/{topic}", f"{topic}/{parts[10]}/{parts[11]}", other)
