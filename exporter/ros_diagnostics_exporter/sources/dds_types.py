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


_Find = ctypes.CFUNCTYPE(ctypes.POINTER(_Support), ctypes.c_void_p, ctypes.c_char_p)
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
    support = _Support(_SUPPORT, ctypes.pointer(callbacks), known.find)
    support.hash = ctypes.cast(_get_no_hash, ctypes.c_void_p).value
    kept = {"_TYPE_SUPPORT": _capsule(support), "_kept": (support, callbacks)}
    return type(f"Type{name}", (type,), kept)(name, (), {})


def _support_of(python_type: Any) -> Any:
    """What the middleware is given of a type that is installed."""
    meta = type(python_type)
    if meta._TYPE_SUPPORT is None:  # noqa: SLF001 - of rosidl's generated classes
        meta.__import_type_support__()
    get = ctypes.pythonapi.PyCapsule_GetPointer
    get.restype, get.argtypes = ctypes.c_void_p, (ctypes.py_object, ctypes.c_char_p)
    name = ctypes.pythonapi.PyCapsule_GetName
    name.restype, name.argtypes = ctypes.c_char_p, (ctypes.py_object,)
    capsule = meta._TYPE_SUPPORT  # noqa: SLF001
    address = get(capsule, name(capsule))
    find = _Find(_Support.from_address(address).find)
    return find(address, _SUPPORT).contents


def _capsule(support: _Support) -> Any:
    new = ctypes.pythonapi.PyCapsule_New
    new.restype = ctypes.py_object
    new.argtypes = (ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p)
    return new(ctypes.addressof(support), _CAPSULE, None)
