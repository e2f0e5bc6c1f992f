"""What anybody in a domain can make, and rclpy cannot read: a topic whose name is no UTF-8.

By rmw, as rclpy takes no such name.
"""

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager

import rclpy
from rclpy.context import Context

NAME = b"rt/evil\xff/diagnostics"


class _Duration(ctypes.Structure):
    _fields_ = (("sec", ctypes.c_uint64), ("nsec", ctypes.c_uint64))


class _Qos(ctypes.Structure):  # rmw_qos_profile_t
    _fields_ = (
        ("history", ctypes.c_int),
        ("depth", ctypes.c_size_t),
        ("reliability", ctypes.c_int),
        ("durability", ctypes.c_int),
        ("deadline", _Duration),
        ("lifespan", _Duration),
        ("liveliness", ctypes.c_int),
        ("lease", _Duration),
        ("is_no_ros_name", ctypes.c_bool),
    )


class _Options(ctypes.Structure):  # rmw_publisher_options_t
    _fields_ = (("payload", ctypes.c_void_p), ("unique_flow", ctypes.c_int))


@contextmanager
def unreadable_topic(domain_id: int) -> Iterator[None]:
    """A publisher of DiagnosticArray on `NAME`."""
    context = Context()
    rclpy.init(context=context, domain_id=domain_id)
    node = rclpy.create_node("evil", context=context)
    rmw = ctypes.CDLL(f"lib{rclpy.get_rmw_implementation_identifier()}.so")
    rmw.rmw_create_publisher.restype = ctypes.c_void_p
    qos = _Qos(history=1, depth=1, reliability=1, durability=2, liveliness=1, is_no_ros_name=True)
    made = rmw.rmw_create_publisher(
        _rmw_node(node), _type(), NAME, ctypes.byref(qos), ctypes.byref(_Options())
    )
    assert made, "the middleware made no publisher"
    try:
        yield
    finally:
        rmw.rmw_destroy_publisher(_rmw_node(node), ctypes.c_void_p(made))
        node.destroy_node()
        context.try_shutdown()


def _rmw_node(node) -> ctypes.c_void_p:
    handle = ctypes.CDLL("librcl.so").rcl_node_get_rmw_handle
    handle.restype = ctypes.c_void_p
    return ctypes.c_void_p(handle(ctypes.c_void_p(node.handle.pointer)))


def _type() -> ctypes.c_void_p:
    library = ctypes.CDLL("libdiagnostic_msgs__rosidl_typesupport_c.so")
    prefix = "rosidl_typesupport_c__get_message_type_support_handle"
    handle = getattr(library, f"{prefix}__diagnostic_msgs__msg__DiagnosticArray")
    handle.restype = ctypes.c_void_p
    return ctypes.c_void_p(handle())
