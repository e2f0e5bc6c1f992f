"""Virtual robots with the real diagnostic_aggregator and rqt_robot_monitor, where ROS is installed.

    ros2 launch sim/ros_launch/real_aggregator.launch.py robots:=3 kind:=thesis

Each robot has a diagnostic_aggregator in its namespace, given the same diagnostics.yaml that the
virtual aggregator reads; rqt_robot_monitor shows one robot (monitor:=robot_1, or '' for none).
"""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from virtual_robots.simulation.kinds import kind_path, load_kind


def robots(context: LaunchContext) -> list[ExecuteProcess | Node]:
    """The processes, when the arguments are known."""
    count = LaunchConfiguration("robots").perform(context)
    kind = LaunchConfiguration("kind").perform(context)
    monitor = LaunchConfiguration("monitor").perform(context)
    path = kind_path(kind)
    analyzers = path.parent / load_kind(path).analyzers
    fleet = ExecuteProcess(
        cmd=["virtual-robots", "--robots", count, "--kind", kind, "--aggregator", "none"],
        output="screen",
    )
    names = [f"robot_{number}" for number in range(1, int(count) + 1)]
    processes = [fleet, *(aggregator(name, str(analyzers)) for name in names)]
    if monitor:
        processes.append(robot_monitor(monitor))
    return processes


def aggregator(robot: str, analyzers: str) -> Node:
    """The C++ aggregator of one robot; its topics are absolute, so each must be moved."""
    topics = ("diagnostics", "diagnostics_agg", "diagnostics_toplevel_state")
    return Node(
        package="diagnostic_aggregator",
        executable="aggregator_node",
        namespace=robot,
        parameters=[analyzers],
        remappings=[(f"/{topic}", topic) for topic in topics],
    )


def robot_monitor(robot: str) -> Node:
    """The window that shows one robot's tree."""
    return Node(
        package="rqt_robot_monitor",
        executable="rqt_robot_monitor",
        remappings=[
            ("/diagnostics_agg", f"/{robot}/diagnostics_agg"),
            ("/diagnostics_toplevel_state", f"/{robot}/diagnostics_toplevel_state"),
        ],
    )


def generate_launch_description() -> LaunchDescription:
    """What ros2 launch asks for."""
    return LaunchDescription(
        [
            DeclareLaunchArgument("robots", default_value="3", description="how many"),
            DeclareLaunchArgument("kind", default_value="thesis", description="which kind"),
            DeclareLaunchArgument("monitor", default_value="robot_1", description="shown in rqt"),
            OpaqueFunction(function=robots),
        ]
    )
