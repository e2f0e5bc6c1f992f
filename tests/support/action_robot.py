"""A robot's action servers as rclpy has them, in a process of their own which takes commands.

It takes a line for each thing on standard input: ``begin NAME`` (a client sends a goal),
``succeed NAME``, ``abort NAME``, ``cancel NAME`` (of the goal that began first), ``replace NAME``
(as Nav2 does: a new goal is accepted, and the old one aborted).
"""

from __future__ import annotations

import os
import queue
import subprocess
import sys
import threading
import time
from types import TracebackType

from typing_extensions import Self

RESULT_TIMEOUT = 10  # seconds for which a server keeps what ended, as by default with Jazzy


class ActionRobot:
    """The process, as a test has it; ``before`` are words before its command."""

    def __init__(
        self,
        namespace: str,
        *actions: str,
        environment: dict[str, str],
        before: tuple[str, ...] = (),
    ) -> None:
        self._process = subprocess.Popen(
            [*before, sys.executable, __file__, namespace, *actions],
            env={**os.environ, **environment},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def tell(self, what: str, action: str) -> None:
        """Have something happen to the goals of an action; returns once it was begun."""
        told, answers = self._process.stdin, self._process.stdout
        assert told is not None
        assert answers is not None
        told.write(f"{what} {action}\n")
        told.flush()
        assert answers.readline() == f"{what} {action}\n"

    def kill(self) -> None:
        """End it without a goodbye."""
        self._process.kill()
        self._process.wait()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        _kind: type[BaseException] | None,
        _error: BaseException | None,
        _traceback: TracebackType | None,
    ) -> None:
        self.kill()
        for pipe in (self._process.stdin, self._process.stdout):
            assert pipe is not None
            pipe.close()


def main(namespace: str, *names: str) -> None:
    """Serve the actions until standard input ends."""
    import rclpy
    from rclpy.executors import MultiThreadedExecutor

    rclpy.init()
    node = rclpy.create_node("action_robot", namespace=namespace)
    actions = {name: _Action(node, name) for name in names}
    executor = MultiThreadedExecutor(num_threads=8)
    executor.add_node(node)
    threading.Thread(target=executor.spin, daemon=True).start()
    for line in sys.stdin:
        what, name = line.split()
        getattr(actions[name], what)()
        sys.stdout.write(line)
        sys.stdout.flush()


class _Action:
    """One server and its client; each goal waits in a thread to be told how it ends."""

    def __init__(self, node: object, name: str) -> None:
        from rclpy.action import ActionClient, ActionServer, CancelResponse
        from rclpy.callback_groups import ReentrantCallbackGroup
        from test_msgs.action import Fibonacci

        self._type, group = Fibonacci, ReentrantCallbackGroup()
        self._told: list[queue.Queue[str]] = []  # of the goals that run, the oldest first
        self._handles: list[object] = []
        self._server = ActionServer(
            node,
            Fibonacci,
            name,
            self._execute,
            callback_group=group,
            cancel_callback=lambda _goal: CancelResponse.ACCEPT,
            result_timeout=RESULT_TIMEOUT,
        )
        self._client = ActionClient(node, Fibonacci, name, callback_group=group)

    def begin(self) -> None:
        """Send a goal, and wait until it is executed."""
        before = len(self._told)
        self._client.wait_for_server()
        sent = self._client.send_goal_async(self._type.Goal())
        sent.add_done_callback(lambda each: self._handles.append(each.result()))
        while len(self._told) == before or len(self._handles) < len(self._told):
            time.sleep(0.01)

    def succeed(self) -> None:
        self._end("succeed")

    def abort(self) -> None:
        self._end("abort")

    def cancel(self) -> None:
        """By the client; the goal ends once the server has accepted that."""
        told = self._told.pop(0)
        cancelled = self._handles.pop(0).cancel_goal_async()
        cancelled.add_done_callback(lambda _future: told.put("canceled"))

    def replace(self) -> None:
        self.begin()
        self._end("abort")

    def _end(self, how: str) -> None:
        del self._handles[0]
        self._told.pop(0).put(how)

    def _execute(self, goal: object) -> object:
        told = queue.Queue[str]()
        self._told.append(told)
        getattr(goal, told.get())()
        return self._type.Result()


if __name__ == "__main__":
    main(*sys.argv[1:])
