"""Types of messages that are not installed, as far as a subscription of bytes needs them; by rcl.

What comes is not decoded by ROS, so of a type only its name has to be right. All else is borrowed
from a type that is installed and has no limit of its size.
"""

from __future__ import annotations

import ctypes
from functools import cache
from typing import Any

from rclpy.utilities import get_rmw_implementation_identifier
from std_msgs.msg import String

_MIDDLEWARE, _SUPPORT = "rmw_fastrtps_cpp", b"rosidl_typesupport_fastrtps_c"
_CONVERTERS = (
    "_CREATE_ROS_MESSAGE",
    "_CONVERT_FROM_PY",
    "_CONVERT_TO_PY",
    "_DESTROY_ROS_MESSAGE",
)
_CAPSULE = b"rosidl_message_type_support"


class UnsupportedError(Exception):
    """The middleware needs the package of a type; the text says what to do."""


class _Callbacks(ctypes.Structure):  # message_type_support_callbacks_t
    _fields_ = (
        ("message_namespace", ctypes.c_char_p),
        ("message_name", ctypes.c_char_p),
        ("functions", ctypes.c_void_p * 5),  # to serialize, and the like
    )


class _Hash(ctypes.Structure):  # rosidl_type_hash_t, of which version 0 is none
    _fields_ = (("version", ctypes.c_uint8), ("value", ctypes.c_uint8 * 32))


class _Support(ctypes.Structure):  # rosidl_message_type_support_t
    _fields_ = (
        ("identifier", ctypes.c_char_p),
        ("callbacks", ctypes.POINTER(_Callbacks)),
        ("find", ctypes.c_void_p),
        ("hash", ctypes.c_void_p),
        ("description", ctypes.c_void_p * 2),
    )


_Find = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_void_p, ctypes.c_char_p)
_NO_HASH = _Hash()
_get_no_hash = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_void_p)(
    lambda _support: ctypes.addressof(_NO_HASH)
)


@cache  # what the middleware was given has to stay
def borrowed_type(kind: str) -> Any:
    """A class of which a topic of this type can be subscribed as bytes.

    Raises:
        UnsupportedError: the middleware is none of which this is known.
    """
    if (middleware := get_rmw_implementation_identifier()) != _MIDDLEWARE:
        package = kind.partition("/")[0]
        raise UnsupportedError(f"{middleware} needs the package of {kind}: install {package}")
    package, _, name = kind.split("/")
    known = _support_of(String)
    functions = known.callbacks.contents.functions
    callbacks = _Callbacks(f"{package}::msg".encode(), name.encode(), functions)
    support = _Support(_SUPPORT, ctypes.pointer(callbacks))
    find = _finder(support, _dispatcher(String))
    support.find = ctypes.cast(find, ctypes.c_void_p).value
    support.hash = ctypes.cast(_get_no_hash, ctypes.c_void_p).value
    support.description = known.description
    kept = {"_TYPE_SUPPORT": _capsule(support), "_kept": (support, callbacks, find)}
    # What rclpy asks whether it is there, and calls for messages that are no bytes.
    borrowed = {each: getattr(type(String), each) for each in _CONVERTERS}
    return type(f"Type{name}", (type,), {**borrowed, **kept})(name, (), {})


def _finder(support: _Support, other: int) -> Any:
    """What gives the middleware the support, and all else that it asks for of another type's."""
    find_other = _Find(_Support.from_address(other).find)

    def find(_support: int, name: bytes) -> int:
        if name == _SUPPORT:
            return ctypes.addressof(support)
        return int(find_other(other, name) or 0)

    return _Find(find)


def _support_of(python_type: Any) -> Any:
    """What the middleware is given of a type that is installed."""
    address = _dispatcher(python_type)
    found = _Find(_Support.from_address(address).find)(address, _SUPPORT)
    return _Support.from_address(found)


def _dispatcher(python_type: Any) -> int:
    """The address of what finds the support of a type for each middleware."""
    meta = type(python_type)
    if meta._TYPE_SUPPORT is None:  # noqa: SLF001 - of rosidl's generated classes
        meta.__import_type_support__()
    get = ctypes.pythonapi.PyCapsule_GetPointer
    get.restype, get.argtypes = ctypes.c_void_p, (ctypes.py_object, ctypes.c_char_p)
    name = ctypes.pythonapi.PyCapsule_GetName
    name.restype, name.argtypes = ctypes.c_char_p, (ctypes.py_object,)
    capsule = meta._TYPE_SUPPORT  # noqa: SLF001
    return int(get(capsule, name(capsule)))


def _capsule(support: _Support) -> Any:
    new = ctypes.pythonapi.PyCapsule_New
    new.restype = ctypes.py_object
    new.argtypes = (ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p)
    return new(ctypes.addressof(support), _CAPSULE, None)
