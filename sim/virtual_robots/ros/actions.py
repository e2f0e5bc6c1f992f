"""The action servers of robots on one node, real ones of rclpy, and the client of each."""

from __future__ import annotations

import importlib
import threading
from collections import deque
from collections.abc import Callable
from typing import Any

from rclpy.action import ActionClient, ActionServer, CancelResponse
from rclpy.action.client import ClientGoalHandle
from rclpy.action.server import ServerGoalHandle
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future

from virtual_robots.ros.contexts import RosError, spin
from virtual_robots.schema.actions import ActionModel
from virtual_robots.simulation.actions import Step

RESULT_TIMEOUT = 10  # seconds for which a server keeps what ended, as by default with Jazzy


class ActionServers:
    """The servers of one node; a thread of their own serves them.

    ``warn`` is called with a text when a goal cannot be sent.
    """

    def __init__(self, node: Node, warn: Callable[[str], None]) -> None:
        self._node, self._warn = node, warn
        self._servers: dict[tuple[str, str], RunningAction] = {}
        self._executor = SingleThreadedExecutor(context=node.context)
        self._executor.add_node(node)
        self._thread = threading.Thread(
            target=spin, args=(self._executor,), name="actions", daemon=True
        )
        self._thread.start()

    def take(self, robot: str, action: ActionModel, step: Step) -> None:
        """Have a step happen; it does so soon, after those before it."""
        self._executor.create_task(self._take, robot, action, step)

    def remove(self, robot: str) -> None:
        """Remove a robot's servers from the graph."""
        self._executor.create_task(self._remove, robot)

    def close(self) -> None:
        """End the thread; the servers end with their node."""
        self._executor.shutdown()
        self._thread.join(timeout=5)

    async def _take(self, robot: str, action: ActionModel, step: Step) -> None:
        key = robot, action.name
        if step in (Step.START, Step.GONE) and key in self._servers:
            self._servers.pop(key).destroy()
        if step is Step.START:
            name = f"/{robot}/{action.name}"
            self._servers[key] = RunningAction(self._node, action_type(action.types), name)
        elif key in self._servers and not await self._servers[key].take(step):
            self._warn(f"{robot}, {action.name}: its client has not found it yet, no goal is sent")

    def _remove(self, robot: str) -> None:
        for key in [each for each in self._servers if each[0] == robot]:
            self._servers.pop(key).destroy()


class RunningAction:
    """A server and its client; each goal runs until `take` ends it. All of it in one thread."""

    def __init__(self, node: Node, kind: Any, name: str) -> None:
        self._kind, self._node = kind, node
        self._ends: deque[Future[str]] = deque()  # of the goals that run, the oldest first
        self._handles: deque[ClientGoalHandle] = deque()
        self._server = ActionServer(
            node,
            kind,
            name,
            self._execute,
            cancel_callback=lambda _goal: CancelResponse.ACCEPT,
            result_timeout=RESULT_TIMEOUT,
        )
        self._client = ActionClient(node, kind, name)

    async def take(self, step: Step) -> bool:
        """Begin a goal, or end the oldest that runs; False where the client has no server yet."""
        if step in (Step.BEGIN, Step.REPLACE):
            if not self._client.server_is_ready():
                return False
            self._handles.append(await self._client.send_goal_async(self._kind.Goal()))
        if step is Step.CANCEL and self._handles:
            await self._handles[0].cancel_goal_async()
        if step is not Step.BEGIN and self._ends and self._handles:
            self._handles.popleft()
            self._ends.popleft().set_result(_HOW[step])
        return True

    def destroy(self) -> None:
        """Leave the graph; the goals that run never end."""
        self._client.destroy()
        self._server.destroy()
        while self._ends:  # what waits for them ends, too, and changes no goal any more
            self._ends.popleft().set_result("abort")

    async def _execute(self, goal: ServerGoalHandle) -> Any:
        end: Future[str] = Future(executor=self._node.executor)
        self._ends.append(end)
        getattr(goal, await end)()
        return self._kind.Result()


_HOW = {
    Step.SUCCEED: "succeed",
    Step.ABORT: "abort",
    Step.REPLACE: "abort",
    Step.CANCEL: "canceled",
}


def action_type(names: tuple[str, ...]) -> Any:
    """The first of these types that is installed. Raises RosError if none is."""
    for name in names:
        package, _, kind = name.split("/")
        try:
            return getattr(importlib.import_module(f"{package}.action"), kind)
        except (ImportError, AttributeError):
            continue
    packages = ", ".join(name.partition("/")[0] for name in names)
    raise RosError(
        f"none of {packages} is installed, of which an action is made: pip install"
        " ros-jazzy-test-msgs, or source a ROS 2 that has one of them"
    )
