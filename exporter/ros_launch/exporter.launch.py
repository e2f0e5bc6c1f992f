"""The exporter in a colcon workspace, started again when it ends.

    ros2 launch ros_diagnostics_exporter exporter.launch.py config:=fleet.yml
    ros2 launch ros_diagnostics_exporter exporter.launch.py domain:=7

Without a config it receives every robot of one DDS domain that publishes NAME/diagnostics_agg.
"""

import tempfile
from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import EnvironmentVariable, LaunchConfiguration
from launch_ros.actions import Node

FLEET = """\
fleet: robots
discovery:
  - {{topic: "/{{robot}}/diagnostics_agg", domain_ids: [{domain}]}}
"""


def exporter(context: LaunchContext) -> list[Node]:
    """The process, when the arguments are known."""
    config, domain, respawn = (
        LaunchConfiguration(name).perform(context) for name in ("config", "domain", "respawn")
    )
    node = Node(
        package="ros_diagnostics_exporter",
        executable="ros-diagnostics-exporter",
        arguments=["--config.file", config or written(domain)],
        respawn=respawn == "true",
        respawn_delay=5.0,
        output="screen",
    )
    return [node]


def written(domain: str) -> str:
    """The path of a fleet.yml for all robots of a domain."""
    path = Path(tempfile.mkdtemp(prefix="ros-diagnostics-")) / "fleet.yml"
    path.write_text(FLEET.format(domain=domain))
    return str(path)


def generate_launch_description() -> LaunchDescription:
    """What `ros2 launch` asks for."""
    domain = EnvironmentVariable("ROS_DOMAIN_ID", default_value="0")
    return LaunchDescription(
        [
            DeclareLaunchArgument("config", default_value="", description="fleet.yml"),
            DeclareLaunchArgument(
                "domain", default_value=domain, description="DDS domain, without a config"
            ),
            DeclareLaunchArgument(
                "respawn",
                default_value="true",
                choices=["true", "false"],
                description="start again",
            ),
            OpaqueFunction(function=exporter),
        ]
    )
