"""Orders to virtual robots, many with one request."""

from __future__ import annotations

from collections.abc import Sequence

from rcl_interfaces.srv import SetParameters
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter


class Orders:
    """Sets parameters of the virtual robots' node, many orders with one request."""

    def __init__(self, domain_id: int) -> None:
        self._context = Context()
        self._context.init(domain_id=domain_id)
        self._node = Node("orders", context=self._context, enable_rosout=False)
        self._client = self._node.create_client(SetParameters, "/virtual_robots/set_parameters")
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)

    def give(self, orders: Sequence[tuple[str, str]]) -> None:
        """Set each (ROBOT/COMPONENT, order); all are carried out on return.

        Raises:
            AssertionError: One is rejected; the text says why.
        """
        assert self._client.wait_for_service(timeout_sec=30), "no virtual robots answer"
        parameters = [
            Parameter(target.replace("/", ".", 1), Parameter.Type.STRING, order).to_parameter_msg()
            for target, order in orders
        ]
        future = self._client.call_async(SetParameters.Request(parameters=parameters))
        self._executor.spin_until_future_complete(future, timeout_sec=60)
        assert future.done(), f"the virtual robots did not answer to {orders}"
        rejected = [each.reason for each in future.result().results if not each.successful]
        assert not rejected, rejected

    def __enter__(self) -> Orders:  # noqa: PYI034 - Self is not in Python 3.10
        return self

    def __exit__(self, *_error: object) -> None:
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()
