"""All topics and nodes of a domain, also where others have names that rclpy cannot read; by rcl.

Anybody in a domain can make a topic whose name is no UTF-8, or say that there is a node without a
name: rclpy then raises, and names nothing at all. So the lists are asked of rcl, which reads them.
"""

from __future__ import annotations

import ctypes
from typing import Any

from rclpy.utilities import get_rmw_implementation_identifier

Topics = list[tuple[str, list[str]]]
Nodes = list[tuple[str, str]]
MAX_SHOWN = 100  # characters of a name that cannot be read


class Allocator(ctypes.Structure):
    """What allocates memory in ROS' C libraries: rcutils_allocator_t."""

    _fields_ = (
        ("functions", ctypes.c_void_p * 4),  # allocate, deallocate, reallocate, zero_allocate
        ("state", ctypes.c_void_p),
    )


class _Texts(ctypes.Structure):  # rcutils_string_array_t
    _fields_ = (
        ("size", ctypes.c_size_t),
        ("data", ctypes.POINTER(ctypes.c_char_p)),
        ("allocator", Allocator),
    )

    def read(self) -> list[bytes]:
        """All texts as they are."""
        return [self.data[index] or b"" for index in range(self.size)]


class _NamesAndTypes(ctypes.Structure):  # rmw_names_and_types_t
    _fields_ = (("names", _Texts), ("types", ctypes.POINTER(_Texts)))


def list_topics(node: Any) -> tuple[Topics, list[str]]:
    """(topics with their types, the names that are no UTF-8) of a node's domain."""
    try:
        return node.get_topic_names_and_types(), []
    except UnicodeDecodeError:
        return _read(_topics(node))


def _read(raw: list[tuple[bytes, list[bytes]]]) -> tuple[Topics, list[str]]:
    topics = [
        (text, [_text(each) or "" for each in types])
        for name, types in raw
        if (text := _text(name))
    ]
    unreadable = [name for name, _types in raw if not _text(name)]
    return topics, [each.decode(errors="backslashreplace")[:MAX_SHOWN] for each in unreadable]


def _text(name: bytes) -> str:
    """A name; "" where it cannot be read."""
    try:
        return name.decode()
    except UnicodeDecodeError:
        return ""


def list_nodes(node: Any) -> tuple[Nodes, int]:
    """((name, namespace) of all nodes, how many have no name that can be read)."""
    try:
        return node.get_node_names_and_namespaces(), 0
    except (RuntimeError, UnicodeDecodeError):
        raw = _nodes(node)
    named = [(name, _text(namespace) or "/") for each, namespace in raw if (name := _text(each))]
    return named, len(raw) - len(named)


def _topics(node: Any) -> list[tuple[bytes, list[bytes]]]:
    rcl, found = ctypes.CDLL("librcl.so"), _NamesAndTypes()
    allocator = default_allocator()
    with node.handle:
        pointer = ctypes.c_void_p(node.handle.pointer)
        arguments = (pointer, ctypes.byref(allocator), ctypes.c_bool(False))
        _check(rcl.rcl_get_topic_names_and_types(*arguments, ctypes.byref(found)))
    try:
        return [(name, found.types[at].read()) for at, name in enumerate(found.names.read())]
    finally:
        ctypes.CDLL("librmw.so").rmw_names_and_types_fini(ctypes.byref(found))


def _nodes(node: Any) -> list[tuple[bytes, bytes]]:
    """By rmw: rcl takes a node without a name for an error of all."""
    rcl = ctypes.CDLL("librcl.so")
    rmw = ctypes.CDLL(f"lib{get_rmw_implementation_identifier()}.so")
    rcl.rcl_node_get_rmw_handle.restype = ctypes.c_void_p
    names, namespaces = _Texts(), _Texts()
    with node.handle:
        handle = ctypes.c_void_p(rcl.rcl_node_get_rmw_handle(ctypes.c_void_p(node.handle.pointer)))
        _check(rmw.rmw_get_node_names(handle, ctypes.byref(names), ctypes.byref(namespaces)))
    try:
        return list(zip(names.read(), namespaces.read(), strict=True))
    finally:
        rcutils = ctypes.CDLL("librcutils.so")
        for each in (names, namespaces):
            rcutils.rcutils_string_array_fini(ctypes.byref(each))


def default_allocator() -> Allocator:
    """The usual one."""
    make = ctypes.CDLL("librcutils.so").rcutils_get_default_allocator
    make.restype = Allocator
    allocator: Allocator = make()
    return allocator


def _check(code: int) -> None:
    if code:
        ctypes.CDLL("librcutils.so").rcutils_reset_error()
        raise RuntimeError(f"the middleware cannot list its graph: error {code}")
