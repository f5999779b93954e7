# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Register the functions that transform and convert each type."""

import importlib
import importlib.util
import sys
from collections.abc import Callable
from copy import deepcopy
from typing import Any, TypeVar, cast

from tf2_py._internal import MalformedObjectError
from tf2_ros._messages import TransformStamped

_Object = TypeVar("_Object")
_New = TypeVar("_New")

# The function that transforms each message class: it takes a message and a TransformStamped and returns a new
# message of the same class.
TransformFunctions = dict[Any, Callable[[Any, Any], Any]]

# Which package registers the types of a message package. It is imported when the first such type is looked
# up, so that a program need not know which package transforms its messages.
_REGISTERED_BY = {
    "geometry_msgs": "tf2_geometry_msgs",
    "nav_msgs": "tf2_geometry_msgs",
    "sensor_msgs": "tf2_sensor_msgs",
}


class TypeException(Exception):
    """
    No function is registered for a type.

    :param str errstr: what is missing; also the attribute ``errstr``.

    >>> from tf2_ros import Buffer, TypeException
    >>> try:
    ...     Buffer().transform("a str", "base_link")
    ... except TypeException as error:
    ...     print(error.errstr.partition(":")[0])
    Type <class 'str'> is not loaded or supported
    """

    def __init__(self, errstr: str) -> None:
        super().__init__(errstr)
        self.errstr = errstr


class UnstampedError(TypeException, MalformedObjectError):
    """An object of a registered type has no header; tf2 registers fewer types, and raises TypeException."""


# The functions by type, and for conversions between two types by the pair of them.
_TRANSFORMS: dict[Any, Callable[..., Any]] = {}
_TO_MSG: dict[Any, Callable[..., Any]] = {}
_FROM_MSG: dict[Any, Callable[..., Any]] = {}
_CONVERSIONS: dict[Any, Callable[..., Any]] = {}


def _package_of(key: Any) -> str:
    """The package of a type; imports the package that registers its messages."""
    package: str = getattr(key, "__module__", "").partition(".")[0]
    if package in _REGISTERED_BY:
        importlib.import_module(_REGISTERED_BY[package])
    return package


def stamped_class(key: Any) -> str:
    """The name of the message class with a header for one without, if it can be transformed; else ``""``."""
    messages = sys.modules.get(f"{_package_of(key)}.msg")
    name = f"{getattr(key, '__name__', '')}Stamped"
    return name if getattr(messages, name, None) in _TRANSFORMS else ""


def how_without_header(key: Any) -> str:
    """What to do with an object of a registered type that has no header, as the end of an error."""
    package, stamped = _package_of(key), stamped_class(key)
    if package not in _REGISTERED_BY or key not in _TRANSFORMS:
        return ""
    put = f"put it into a {stamped}, or " if stamped else ""
    return f": {put}call {_REGISTERED_BY[package]}.{_TRANSFORMS[key].__name__} with a transform"


def _find(table: dict[Any, Callable[..., Any]], key: Any, method: str) -> Callable[..., Any]:
    """Find the function for ``key``; a TypeException says how ``method`` would make it known."""
    if key not in table:
        _package_of(key)
    if key in table:
        return table[key]
    package = getattr(key, "__module__", "").partition(".")[0]
    raise TypeException(
        f"Type {key} is not loaded or supported: {_advice(key, package)}register a function with "
        f"tf2_ros.{method}"
    )


def _advice(key: Any, package: str) -> str:
    """What else would help, as the begin of a list; ``""``: nothing is known."""
    if package in _REGISTERED_BY:
        stamped = stamped_class(key)
        put = f"put it into {stamped}, " if stamped else ""
        where = 'the page "Message types"'
        if getattr(key, "__name__", "") == "LaserScan":
            where = '"Laser scans" on the page "Point clouds and scans"'
        return f"{put}see {where} of the documentation, or "
    if key is str:
        return "pass the message first, then the frame, or "
    if package == "tf2_py":  # a class that stands in for a message of ROS 2
        return "without ROS 2, use to_matrix of tf2_ros.numpy, or buffer.transform_points, or "
    if hasattr(key, "get_fields_and_field_types"):  # a message class
        # The packages that register types for tf2 have such names.
        registering = f"tf2_{package}"
        is_installed = importlib.util.find_spec(registering) is not None
        return f"import {registering}, which may register it, or " if is_installed else ""
    return "" if package == "builtins" else "import the package that registers it, or "


def _name(cls: Any) -> str:
    # rosidl keeps each class in a private module and exports it from the one above.
    if not isinstance(cls, type):
        return str(cls)
    modules = [part for part in cls.__module__.split(".") if not part.startswith("_")]
    return ".".join([*modules, cls.__qualname__])


class TransformRegistration:
    """
    The functions that transform objects, by type; one table for the whole process.

    >>> from std_msgs.msg import Header
    >>> from tf2_ros import Buffer, TransformRegistration
    >>> class Height:
    ...     def __init__(self, z, frame):
    ...         self.z, self.header = z, Header(frame_id=frame)
    >>> def transform_height(height, transform):
    ...     return Height(height.z + transform.transform.translation.z, transform.header.frame_id)
    >>> TransformRegistration().add(Height, transform_height)
    >>> Buffer().transform(Height(1.0, "map"), "map").z
    1.0
    """

    __type_map = _TRANSFORMS  # under tf2's name, by which programs reach it

    def add(self, key: type[_Object], callback: Callable[[_Object, TransformStamped], _Object]) -> None:
        """
        Register the function that transforms objects of one type.

        :param key: the type.
        :param callback: takes the object and a ``TransformStamped``, returns the transformed object.
        """
        self.__type_map[key] = callback

    def get(self, key: type[_Object]) -> Callable[[_Object, TransformStamped], _Object]:
        """
        Find the function that transforms objects of one type.

        :param key: the type.
        :return: the function; it takes an object and a ``TransformStamped``.
        :raises TypeException: none is registered.
        """
        return _find(self.__type_map, key, "TransformRegistration().add()")

    def print_me(self) -> None:
        """Print the table."""
        print(self.__type_map)


class ConvertRegistration:
    """
    The functions that turn objects of one type into another, by type; one table for the whole process.

    >>> from geometry_msgs.msg import Point
    >>> from tf2_ros import ConvertRegistration, convert
    >>> ConvertRegistration().add_convert((Point, tuple), lambda point: (point.x, point.y, point.z))
    >>> convert(Point(x=1.0), tuple)
    (1.0, 0.0, 0.0)
    """

    __to_msg_map = _TO_MSG
    __from_msg_map = _FROM_MSG
    __convert_map = _CONVERSIONS

    def add_from_msg(self, key: type[_New], callback: Callable[[Any], _New]) -> None:
        """
        Register the function that makes objects of one type from messages.

        :param key: the type.
        :param callback: takes a message, returns an object of the type.
        """
        self.__from_msg_map[key] = callback

    def add_to_msg(self, key: type[_Object], callback: Callable[[_Object], Any]) -> None:
        """
        Register the function that makes messages from objects of one type.

        :param key: the type.
        :param callback: takes an object of the type, returns a message.
        """
        self.__to_msg_map[key] = callback

    def add_convert(self, key: tuple[type[_Object], type[_New]], callback: Callable[[_Object], _New]) -> None:
        """
        Register the function that converts one type to another directly, without a message in between.

        :param key: the type converted from, and the type converted to.
        :param callback: takes an object of the first type, returns one of the second.
        """
        self.__convert_map[key] = callback

    def get_from_msg(self, key: type[_New]) -> Callable[[Any], _New]:
        """
        Find the function that makes objects of a type from messages.

        :param key: the type of the objects.
        :return: the function; it takes a message.
        :raises TypeException: none is registered.
        """
        return _find(self.__from_msg_map, key, "ConvertRegistration().add_from_msg()")

    def get_to_msg(self, key: type[_Object]) -> Callable[[_Object], Any]:
        """
        Find the function that makes messages from objects of a type.

        :param key: the type of the objects.
        :return: the function; it takes an object and returns a message.
        :raises TypeException: none is registered.
        """
        return _find(self.__to_msg_map, key, "ConvertRegistration().add_to_msg()")

    def get_convert(self, key: tuple[type[_Object], type[_New]]) -> Callable[[_Object], _New]:
        """
        Find the function that converts the first type of ``key`` to the second directly.

        :param key: the type converted from, and the type converted to.
        :return: the function; it takes an object of the first type and returns one of the second.
        :raises TypeException: none is registered.
        """
        return _find(self.__convert_map, key, "ConvertRegistration().add_convert()")


def to_msg_msg(msg: _Object) -> _Object:
    """Return ``msg``, which already is a message."""
    return msg


def from_msg_msg(msg: _Object) -> _Object:
    """Return ``msg``, which already is a message."""
    return msg


def register_messages(functions: TransformFunctions) -> None:
    """
    Register this project's functions for message classes, and that each class converts to itself.

    What a program has registered for a class stays.
    """
    for cls, function in functions.items():
        _TRANSFORMS.setdefault(cls, function)
        _TO_MSG.setdefault(cls, to_msg_msg)
        _FROM_MSG.setdefault(cls, from_msg_msg)


def convert(a: Any, b_type: type[_New]) -> _New:
    """
    Convert an object to another type: directly, as a deep copy if it has that type, or through a message.

    :param a: the object; it is not changed.
    :param b_type: the type to convert to.
    :return: an object of that type; where a program's own function makes it, of whatever type that returns.
    :raises TypeException: no conversion is registered, or ``b_type`` is a message class and the message is
        of another one.
    """
    direct = _CONVERSIONS.get((type(a), b_type))
    if direct is not None:
        return cast(_New, direct(a))
    if type(a) is b_type:
        return deepcopy(a)
    registration = ConvertRegistration()
    message = registration.get_to_msg(type(a))(a)
    from_msg = registration.get_from_msg(b_type)
    if from_msg is from_msg_msg and not isinstance(message, b_type):
        raise TypeException(
            f"Type {_name(type(a))} cannot be converted to {_name(b_type)}: the functions registered for "
            f"them make {_name(type(message))} of it"
        )
    return from_msg(message)
