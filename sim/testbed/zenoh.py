"""The commands of zenoh's router and of its bridge for ROS 2; their configs are written."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from testbed.programs import MissingProgram

# The bridge speaks Cyclone DDS. On the loopback device, which has no multicast, it looks for the
# participants of a domain by the ports that they have in turn.
LOOPBACK = """<CycloneDDS><Domain>
<General><Interfaces><NetworkInterface name="lo" multicast="false"/></Interfaces></General>
<Discovery>
<Peers><Peer address="127.0.0.1"/></Peers>
<ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>60</MaxAutoParticipantIndex>
</Discovery>
</Domain></CycloneDDS>"""

ALLOWED = {"publishers": [".*/diagnostics_agg"]}  # of what the bridge finds


def program(name: str) -> str:
    """The path of ``zenoh-bridge`` or ``zenohd``, as ./run builds them.

    Raises:
        MissingProgram: They are not built.
    """
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    path = cache / "ros-diagnostics" / "zenoh" / "bin" / name
    if not path.exists():
        raise MissingProgram(f"{path}: not built; sim/zenoh_bridge/build-zenoh builds it")
    return str(path)


def router(config: Path, endpoint: str) -> list[str]:
    """The command of a router that listens at ``endpoint``.

    Raises:
        MissingProgram: It is not built.
    """
    _write(config, {"mode": "router", "listen": {"endpoints": [endpoint]}})
    return [program("zenohd"), "--config", str(config)]


def bridge(config: Path, endpoint: str, domain_id: int, namespace: str) -> list[str]:
    """The command of a bridge.

    Args:
        config: Where its config is written.
        endpoint: Of the router that it connects to.
        domain_id: Of the ROS domain whose diagnostics it brings there.
        namespace: What its keys begin with.

    Raises:
        MissingProgram: It is not built.
    """
    ros = {"namespace": namespace, "domain": domain_id}
    connect = {"endpoints": [endpoint], "timeout_ms": -1, "exit_on_failure": False}
    plugins = {"ros2dds": {**ros, "allow": ALLOWED}}
    # As Eclipse's program has it. Without that no topic is brought whose last message DDS keeps.
    stamped = {"timestamping": {"enabled": True}}
    _write(config, {"mode": "client", "connect": connect, "plugins": plugins, **stamped})
    return [program("zenoh-bridge"), str(config)]


def on_loopback(robots: Mapping[str, str]) -> dict[str, str]:
    """The environment of a bridge on the machine of robots that have the environment ``robots``."""
    kept = {name: of for name, of in robots.items() if name != "ROS_AUTOMATIC_DISCOVERY_RANGE"}
    return {"ROS_DISTRO": "jazzy", **kept, "CYCLONEDDS_URI": LOOPBACK}


def _write(path: Path, config: Mapping[str, Any]) -> None:
    quiet = {"scouting": {"multicast": {"enabled": False}}}
    path.write_text(json.dumps({**config, **quiet}, indent=2))
