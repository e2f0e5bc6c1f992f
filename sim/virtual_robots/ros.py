"""The only file of this package that imports rclpy: publishers, and the control node.

Bytes and names go through it; what they mean is decided elsewhere.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from virtual_robots.cdr import encode_array, encode_status
from virtual_robots.fleet import Message, Topic

CONTROL_NODE = "virtual_robots"
HIGHEST_DOMAIN_ID = 232

try:
    import rclpy
    from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
    from rcl_interfaces.msg import SetParametersResult
    from rcl_interfaces.srv import SetParameters
    from rclpy.context import Context
    from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
    from rclpy.node import Node
    from rclpy.parameter import Parameter
    from rclpy.qos import QoSProfile, ReliabilityPolicy
except ImportError as error:
    MISSING: ImportError | None = error
else:
    MISSING = None


class RosError(RuntimeError):
    """ROS cannot be used as asked; the text says what to do."""


class DomainError(ValueError):
    """A number that is no DDS domain."""


def require_ros() -> None:
    """Raise RosError with the way out where ROS' Python packages cannot be imported."""
    if MISSING is not None:
        raise RosError(
            f"ROS 2 cannot be imported ({MISSING}). Install it with this package, as in"
            " pip install 'ros-diagnostics-exporter[ros]', or source a ROS 2 installation first,"
            " as in source /opt/ros/jazzy/setup.bash"
        )


def check_domain_id(domain_id: int) -> int:
    """The id itself if DDS has such a domain: rclpy would end the process otherwise."""
    if not 0 <= domain_id <= HIGHEST_DOMAIN_ID:
        raise DomainError(f"domain id {domain_id} must be between 0 and {HIGHEST_DOMAIN_ID}")
    return domain_id


def chosen_domain_id(asked: int | None) -> int:
    """The asked domain, else ROS_DOMAIN_ID's, else 0, as every ROS 2 program does."""
    if asked is not None:
        return check_domain_id(asked)
    text = os.environ.get("ROS_DOMAIN_ID", "") or "0"
    if not text.isdecimal():
        raise DomainError(f"ROS_DOMAIN_ID is {text!r}, must be a number")
    return check_domain_id(int(text))


@contextmanager
def ros_context(domain_id: int) -> Iterator[Context]:
    """An rclpy context in a domain; signals stay with the caller."""
    require_ros()
    context = Context()
    rclpy.init(
        context=context,
        domain_id=check_domain_id(domain_id),
        signal_handler_options=rclpy.signals.SignalHandlerOptions.NO,
    )
    try:
        yield context
    finally:
        rclpy.try_shutdown(context=context)


class Publishers:
    """The topics of every robot, published by one node (one DDS participant)."""

    def __init__(self, context: Context, robots: list[str]) -> None:
        self._node = rclpy.create_node(
            "virtual_robot_drivers",
            context=context,
            enable_rosout=False,
            start_parameter_services=False,
        )
        # As the real ones: reliable, volatile, and the last message only.
        qos = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
        types = {Topic.TOPLEVEL: DiagnosticStatus}
        self._publishers = {
            (robot, topic): self._node.create_publisher(
                types.get(topic, DiagnosticArray), f"/{robot}/{topic.value}", qos
            )
            for robot in robots
            for topic in Topic
        }

    def publish(self, message: Message, started: float) -> None:
        """Send a message; ``started`` is the fleet's start in seconds since the epoch."""
        if message.topic is Topic.TOPLEVEL:
            data = encode_status(message.statuses[0])
        else:
            data = encode_array(message.statuses, started + message.stamp)
        self._publishers[message.robot, message.topic].publish(data)

    def close(self) -> None:
        """Leave the graph, with goodbye."""
        self._node.destroy_node()


class Control:
    """The node `/virtual_robots`: faults are its parameters `ROBOT.COMPONENT`.

    ``decide`` is called with name and value of each parameter that someone sets, in another thread;
    it raises ValueError or KeyError with the reason to refuse it.
    """

    def __init__(self, context: Context, decide: Callable[[str, str], None]) -> None:
        self._decide = decide
        self._node = Node(
            CONTROL_NODE, context=context, allow_undeclared_parameters=True, enable_rosout=False
        )
        self._node.add_on_set_parameters_callback(self._on_set)
        self._executor = SingleThreadedExecutor(context=context)
        self._executor.add_node(self._node)
        self._thread = threading.Thread(target=self._spin, name="control", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Leave the graph; the thread has ended on return."""
        self._executor.shutdown()
        self._thread.join(timeout=5)
        self._node.destroy_node()

    def _spin(self) -> None:
        try:
            self._executor.spin()
        except ExternalShutdownException:
            return

    def _on_set(self, parameters: list[Parameter[Any]]) -> SetParametersResult:
        for parameter in parameters:
            if "." not in parameter.name:
                continue
            try:
                self._decide(parameter.name, str(parameter.value))
            except (ValueError, KeyError) as error:
                return SetParametersResult(successful=False, reason=str(error.args[0]))
        return SetParametersResult(successful=True)


def set_parameter(domain_id: int, name: str, value: str, timeout: float = 10.0) -> None:
    """Set a text parameter of the control node, as `ros2 param set` does.

    Raises RosError where no fleet answers within ``timeout`` seconds or it refuses.
    """
    with ros_context(domain_id) as context:
        node = rclpy.create_node(
            "virtual_robots_fault",
            context=context,
            enable_rosout=False,
            start_parameter_services=False,
        )
        client = node.create_client(SetParameters, f"/{CONTROL_NODE}/set_parameters")
        if not client.wait_for_service(timeout_sec=timeout):
            raise RosError(f"no virtual robots answer in domain {domain_id}; are they running?")
        result = _answer(client, context, node, _request(name, value), timeout)
        if not result.successful:
            raise RosError(result.reason)


def _request(name: str, value: str) -> Any:
    request = SetParameters.Request()
    request.parameters = [Parameter(name, Parameter.Type.STRING, value).to_parameter_msg()]
    return request


def _answer(client: Any, context: Context, node: Node, request: Any, timeout: float) -> Any:
    future = client.call_async(request)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    executor.spin_until_future_complete(future, timeout_sec=timeout)
    executor.shutdown()
    if not future.done():
        raise RosError(f"the virtual robots did not answer within {timeout:.0f} s")
    return future.result().results[0]
