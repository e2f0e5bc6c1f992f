"""A listener on real topics, and the command under test."""

import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from support.called import called
from testbed.polling import until
from testbed.processes import Process

COMMAND = Path(sys.executable).parent / "virtual-robots"


class Listener:
    """Collects what arrives on topics of one domain, in order of arrival."""

    def __init__(self, domain_id: int) -> None:
        rclpy = pytest.importorskip("rclpy", reason="needs ROS 2")
        from rclpy.executors import SingleThreadedExecutor

        self.context = rclpy.Context()
        self.context.init(domain_id=domain_id)
        self.node = rclpy.create_node("listener", context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.received: list[tuple[str, Any]] = []

    def listen(self, topic: str, message_type: str = "DiagnosticArray") -> None:
        import diagnostic_msgs.msg

        def on_message(message: Any) -> None:
            self.received.append((topic, message))

        kind = getattr(diagnostic_msgs.msg, message_type)
        self.node.create_subscription(kind, topic, on_message, 100)

    def of(self, topic: str) -> list[Any]:
        return [message for received, message in self.received if received == topic]

    def until(self, condition: Callable[[], Any], what: str, seconds: float = 20.0) -> Any:
        """Listen until the condition holds."""

        def spun() -> Any:
            self.executor.spin_once(timeout_sec=0.1)
            return condition()

        return until(spun, what, seconds, every=0)

    def close(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()


@pytest.fixture
def make_listener() -> Iterator[Callable[[int], Listener]]:
    """A function (domain id): a listener there, closed with the test."""
    made: list[Listener] = []

    def make(domain_id: int) -> Listener:
        made.append(Listener(domain_id))
        return made[-1]

    yield make
    for listening in made:
        listening.close()


@pytest.fixture
def listener(make_listener: Callable[[int], Listener], ros_domain: int) -> Listener:
    """One in the test's own domain."""
    return make_listener(ros_domain)


@pytest.fixture
def virtual_robots(
    start_process: Callable[..., Process], dds_environment: dict[str, str]
) -> Callable[..., Process]:
    """A function (arguments): starts `virtual-robots` and returns when it is ready."""

    def start(*arguments: str) -> Process:
        process = start_process("virtual-robots", [COMMAND, *arguments], dds_environment)
        process.wait_for_output(r"ready: .*\n")
        return process

    return start


@pytest.fixture
def command(dds_environment: dict[str, str]) -> Callable[..., subprocess.CompletedProcess[str]]:
    """A function (arguments, code=0): runs `virtual-robots` to its end with that exit code."""

    def run(*arguments: str, code: int = 0) -> subprocess.CompletedProcess[str]:
        return called([COMMAND, *arguments], env=dds_environment, code=code, timeout=60)

    return run
