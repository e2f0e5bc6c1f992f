"""Fault injection while a fleet runs: the parameters of a ROS node, and a client that sets them."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParameters
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter

from virtual_robots.ros.contexts import RosError, quiet_node, ros_context, spin

CONTROL_NODE = "virtual_robots"
DECLARED_BY_RCLPY = {"use_sim_time", "start_type_description_service"}


class Control:
    """The node `/virtual_robots`: its parameter `ROBOT.COMPONENT` is that component's fault.

    Its parameter `ROBOT` is an event of the whole robot.

    ``inject`` is called in another thread with name and value of each parameter that is set; it
    raises ValueError or KeyError with the reason to reject the value.
    """

    def __init__(self, context: Context, inject: Callable[[str, str], None]) -> None:
        self._inject = inject
        self._node = Node(
            CONTROL_NODE, context=context, allow_undeclared_parameters=True, enable_rosout=False
        )
        self._node.add_on_set_parameters_callback(self._on_set)
        self._executor = SingleThreadedExecutor(context=context)
        self._executor.add_node(self._node)
        self._thread = threading.Thread(
            target=spin, args=(self._executor,), name="control", daemon=True
        )
        self._thread.start()

    def close(self) -> None:
        """Leave the graph; the thread has ended on return."""
        self._executor.shutdown()
        self._thread.join(timeout=5)
        self._node.destroy_node()

    def _on_set(self, parameters: list[Parameter[Any]]) -> SetParametersResult:
        for parameter in parameters:
            if parameter.name in DECLARED_BY_RCLPY:
                continue
            try:
                self._inject(parameter.name, str(parameter.value))
            except (ValueError, KeyError) as error:
                return SetParametersResult(successful=False, reason=str(error.args[0]))
        return SetParametersResult(successful=True)


def set_parameter(domain_id: int, name: str, value: str, timeout: float = 10.0) -> None:
    """Set a text parameter of the control node, as `ros2 param set` does.

    Raises RosError if no fleet answers within ``timeout`` seconds or the value is rejected.
    """
    with ros_context(domain_id) as context:
        node = quiet_node("virtual_robots_fault", context)
        client = node.create_client(SetParameters, f"/{CONTROL_NODE}/set_parameters")
        if not client.wait_for_service(timeout_sec=timeout):
            raise RosError(
                f"no virtual robots answer in domain {domain_id}: start them, or give their domain "
                "with --domain-id"
            )
        request = SetParameters.Request()
        request.parameters = [Parameter(name, Parameter.Type.STRING, value).to_parameter_msg()]
        result = _answer(client, node, request, timeout)
        if not result.successful:
            raise RosError(result.reason)


def _answer(client: Any, node: Node, request: Any, timeout: float) -> Any:
    future = client.call_async(request)
    executor = SingleThreadedExecutor(context=node.context)
    executor.add_node(node)
    executor.spin_until_future_complete(future, timeout_sec=timeout)
    executor.shutdown()
    if not future.done():
        raise RosError(f"the virtual robots did not answer within {timeout:.0f} s")
    return future.result().results[0]
