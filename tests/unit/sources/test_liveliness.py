"""Tokens of the bridge (as version 1.10.2 sends them) and of rmw_zenoh's published design."""

import pytest

from ros_diagnostics_exporter.sources.zenoh import TOKENS, Token, parse

BRIDGE = "9f3c2b"
HASH = "RIHS01_7ac8d2"
# docs/design.md of ros2/rmw_zenoh, with this type and, where it says so, another topic.
TALKER = (
    "@ros2_lv/2/8b20917502ee955ac4476e0266340d5c/0/10/MP/%/%/talker/%chatter/{}/"
    + HASH
    + "/::,7:,:,:,,"
)
BOOL = "std_msgs/msg/Bool"
ARRAY = "diagnostic_msgs::msg::dds_::DiagnosticArray_"


@pytest.mark.parametrize(
    ("token", "shown"),
    [
        (f"@/{BRIDGE}/@ros2_lv", Token(BRIDGE)),
        (
            f"@/{BRIDGE}/@ros2_lv/MP/a§r1§diagnostics_agg/diagnostic_msgs§msg§DiagnosticArray/:1:::;",
            Token(BRIDGE, "/a/r1/diagnostics_agg", "a/r1/diagnostics_agg"),
        ),
        (
            f"@/{BRIDGE}/@ros2_lv/MP/r1§diagnostics/std_msgs§msg§String/:1:::;",
            Token(BRIDGE, "/r1/diagnostics", "r1/diagnostics", "std_msgs/msg/String"),
        ),
        (
            f"@/{BRIDGE}/@ros2_lv/MP/r1§soc/std_msgs§msg§Float32/:1:::;typehash=RIHS01_0a;",
            Token(BRIDGE, "/r1/soc", "r1/soc", "std_msgs/msg/Float32", "RIHS01_0a"),
        ),
        (
            TALKER.format("std_msgs::msg::dds_::Bool_"),
            Token(
                "2/%", "/2/chatter", f"2/chatter/std_msgs::msg::dds_::Bool_/{HASH}", *(BOOL, HASH)
            ),
        ),
        (f"@/{BRIDGE}/@ros2_lv/MS/r1§x/diagnostic_msgs§msg§DiagnosticArray/:1:::;", None),
        ("@ros2_lv/2/aac3178e146ba6f1fc6e6a4085e77f21/0/0/NN/%/%/listener", Token("2/%")),
        ("@ros2_lv/0/aac3/0/0/NN/%/%r1/aggregator", Token("0/%r1")),
        (TALKER.format(ARRAY), Token("2/%", "/2/chatter", f"2/chatter/{ARRAY}/{HASH}")),
        (
            TALKER.replace("%chatter", "%r1%diagnostics_agg").format(ARRAY),
            Token("2/%", "/2/r1/diagnostics_agg", f"2/r1/diagnostics_agg/{ARRAY}/{HASH}"),
        ),
        ("@ros2_lv/2/8b/0/10/MP", None),
        ("", None),
    ],
)
def test_a_token_shows_a_connection_or_a_publisher(token, shown):
    assert parse(token) == shown


def test_what_is_asked_for_is_what_is_read():
    zenoh = pytest.importorskip("zenoh")
    keys = [zenoh.KeyExpr(each) for each in TOKENS]
    for token in (
        f"@/{BRIDGE}/@ros2_lv",
        f"@/{BRIDGE}/@ros2_lv/MP/r1§diagnostics/diagnostic_msgs§msg§DiagnosticArray/:1:::;",
        "@ros2_lv/0/aac3/0/0/NN/%/%r1/aggregator",
        TALKER.format(ARRAY),
        f"@/{BRIDGE}/@ros2_lv/MP/diagnostics_agg/std_msgs§msg§String/:1:::;",
        TALKER.replace("%chatter", "%r1%diagnostics").format("std_msgs::msg::dds_::String_"),
    ):
        assert any(key.includes(token) for key in keys)
        assert parse(token)
    for token in (
        f"@/{BRIDGE}/@ros2_lv/MP/chatter/std_msgs§msg§String/:1:::;",
        TALKER.format("std_msgs::msg::dds_::String_"),
    ):
        assert not any(key.includes(token) for key in keys)
