"""Types of messages that are not installed, as far as a publisher of bytes needs them; by rcl.

ROS does not encode what is published, so of a type only its name has to be right. All else is
borrowed from std_msgs/String, which has no limit of its size.
"""

from __future__ import annotations

import ctypes
from functools import cache
from typing import Any

from rclpy.utilities import get_rmw_implementation_identifier
from std_msgs.msg import String

from virtual_robots.ros.contexts import RosError

_MIDDLEWARE, _SUPPORT = "rmw_fastrtps_cpp", b"rosidl_typesupport_fastrtps_c"
_CONVERTERS = (
    "_CREATE_ROS_MESSAGE",
    "_CONVERT_FROM_PY",
    "_CONVERT_TO_PY",
    "_DESTROY_ROS_MESSAGE",
)


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
def borrowed_type(name: str) -> Any:
    """A class of which bytes can be published as messages of the type.

    Raises RosError if the middleware is none of which this is known.
    """
    package, _, kind = name.split("/")
    if (middleware := get_rmw_implementation_identifier()) != _MIDDLEWARE:
        raise RosError(f"{name} is not installed, and {middleware} needs it: install {package}")
    known = _support_of_string("fastrtps_c")
    functions = known.callbacks.contents.functions
    callbacks = _Callbacks(f"{package}::msg".encode(), kind.encode(), functions)
    support = _Support(_SUPPORT, ctypes.pointer(callbacks), description=known.description)
    find = _finder(support)
    support.find = ctypes.cast(find, ctypes.c_void_p).value
    support.hash = ctypes.cast(_get_no_hash, ctypes.c_void_p).value
    type(String).__import_type_support__()
    # What rclpy asks whether it is there, and calls for messages that are no bytes.
    borrowed = {each: getattr(type(String), each) for each in _CONVERTERS}
    kept = {"_TYPE_SUPPORT": _capsule(support), "_kept": (support, callbacks, find)}
    return type(f"Type{kind}", (type,), {**borrowed, **kept})(kind, (), {})


def _finder(support: _Support) -> Any:
    """What gives the middleware the support, and all else that it asks for of String."""
    general = _support_of_string("c")
    find_general = _Find(general.find)

    def find(_support: int, wanted: bytes) -> int:
        if wanted == _SUPPORT:
            return ctypes.addressof(support)
        return int(find_general(ctypes.addressof(general), wanted) or 0)

    return _Find(find)


def _support_of_string(language: str) -> _Support:
    library = ctypes.CDLL(f"libstd_msgs__rosidl_typesupport_{language}.so")
    function = f"rosidl_typesupport_{language}__get_message_type_support_handle"
    get = getattr(library, f"{function}__std_msgs__msg__String")
    get.restype = ctypes.POINTER(_Support)
    found: _Support = get().contents
    return found


def _capsule(support: _Support) -> Any:
    new = ctypes.pythonapi.PyCapsule_New
    new.restype = ctypes.py_object
    new.argtypes = (ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p)
    return new(ctypes.addressof(support), b"rosidl_message_type_support", None)
