"""Action servers as virtual robots have them, in a process of their own which takes commands.

It takes a line for each thing on standard input: a step of virtual_robots.simulation.actions, such
as ``begin`` or ``abort``, and the action's name.
"""

import os
import subprocess
import sys
import threading
import time
from types import TracebackType

from typing_extensions import Self


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
    from rclpy.executors import SingleThreadedExecutor
    from test_msgs.action import Fibonacci

    from virtual_robots.ros.actions import RunningAction
    from virtual_robots.simulation.actions import Step

    rclpy.init()
    node = rclpy.create_node("action_robot", namespace=namespace)
    actions = {name: RunningAction(node, Fibonacci, name) for name in names}
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    threading.Thread(target=executor.spin, daemon=True).start()

    def is_taken(what: str, name: str) -> bool:
        taken = executor.create_task(actions[name].take, Step(what))
        while not taken.done():
            time.sleep(0.01)
        return taken.result()

    for line in sys.stdin:
        while not is_taken(*line.split()):
            time.sleep(0.01)  # the client has not found its server yet
        sys.stdout.write(line)
        sys.stdout.flush()


if __name__ == "__main__":
    main(*sys.argv[1:])
