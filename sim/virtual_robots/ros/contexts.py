"""Contexts of rclpy: domains, participants, shutdown."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

import rclpy
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node

HIGHEST_DOMAIN_ID = 232


class RosError(RuntimeError):
    """A request that ROS cannot fulfil; the text says what to do."""


class DomainError(ValueError):
    """A number that is no DDS domain."""


def check_domain_id(domain_id: int) -> int:
    """Return the id if DDS has such a domain; rclpy would end the process otherwise."""
    if not 0 <= domain_id <= HIGHEST_DOMAIN_ID:
        raise DomainError(f"domain id {domain_id} must be between 0 and {HIGHEST_DOMAIN_ID}")
    return domain_id


def chosen_domain_id(option: int | None) -> int:
    """Return the option's domain, else ROS_DOMAIN_ID's, else 0, as every ROS 2 program does."""
    if option is not None:
        return check_domain_id(option)
    text = os.environ.get("ROS_DOMAIN_ID", "") or "0"
    if not text.isdecimal():
        raise DomainError(f"ROS_DOMAIN_ID is {text!r}, must be a number")
    return check_domain_id(int(text))


def open_context(domain_id: int) -> Context:
    """Return a context (one DDS participant) in a domain; rclpy installs no signal handlers."""
    context = Context()
    rclpy.init(
        context=context,
        domain_id=check_domain_id(domain_id),
        signal_handler_options=rclpy.signals.SignalHandlerOptions.NO,
    )
    return context


@contextmanager
def ros_context(domain_id: int) -> Iterator[Context]:
    """A context that is shut down at the end."""
    context = open_context(domain_id)
    try:
        yield context
    finally:
        context.try_shutdown()


def spin(executor: SingleThreadedExecutor) -> None:
    """Serve the executor's nodes until it or its context is shut down."""
    try:
        executor.spin()
    except ExternalShutdownException:
        return  # the context ended first


def quiet_node(name: str, context: Context, namespace: str | None = None) -> Node:
    """Return a node without rosout and parameter services."""
    return Node(
        name,
        context=context,
        namespace=namespace,
        enable_rosout=False,
        start_parameter_services=False,
        use_global_arguments=False,
    )
