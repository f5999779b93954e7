"""Register the functions that transform and convert each type."""

import importlib
import importlib.util
from collections.abc import Callable, Mapping
from copy import deepcopy
from typing import Any, TypeVar

from tf2_ros._arguments import is_a, refuse_swapped
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

# Types that users try to transform and that no transform applies to, and what to do instead.
_INSTEAD = {
    "sensor_msgs.msg.LaserScan": "a scan has ranges, which are distances from the origin of its own frame:"
    " convert it to points, and transform these (docs/point-clouds.md has the function)",
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
    Type builtins.str is not loaded or supported
    """

    def __init__(self, errstr: str) -> None:
        super().__init__(errstr)
        self.errstr = errstr


class NotImplementedException(Exception):
    """
    A buffer lacks the method that was called; the attribute ``errstr`` says so in words.

    >>> from rclpy.time import Time
    >>> from tf2_ros import BufferInterface, NotImplementedException
    >>> try:
    ...     BufferInterface().lookup_transform("map", "odom", Time())
    ... except NotImplementedException as error:
    ...     print(error.errstr)
    CanTransform or LookupTransform not implemented
    """

    def __init__(self) -> None:
        self.errstr = "CanTransform or LookupTransform not implemented"
        super().__init__(self.errstr)


def _name(key: Any) -> str:
    # rosidl keeps each class in a private module and exports it from the one above.
    if not isinstance(key, type):
        return str(key)
    modules = [part for part in key.__module__.split(".") if not part.startswith("_")]
    return ".".join([*modules, key.__qualname__])


def _package(key: Any) -> str:
    return getattr(key, "__module__", "").partition(".")[0]


class _Functions(dict[Any, Callable[..., Any]]):
    """Functions by key. A default, one of this project's, never replaces what a program registered."""

    def __init__(self, what: str) -> None:
        self._what = what
        self._defaults: dict[Any, Callable[..., Any]] = {}

    def add(self, key: Any, function: Callable[..., Any], default: bool) -> None:
        if not callable(function):
            raise TypeError(f"{self._what} needs a function for {_name(key)}, not {function!r}")
        if default:
            is_own = key in self and not self.is_default(key)
            self._defaults[key] = function
            if is_own:
                return
        self[key] = function

    def is_default(self, key: Any) -> bool:
        """Whether the function for ``key`` is one of this project."""
        return key in self._defaults and self.get(key) is self._defaults[key]

    def find(self, key: Any) -> Callable[..., Any] | None:
        """The function for ``key``, or None; imports what registers the types in it, if that is known."""
        if key in self:
            return self[key]
        for package in self._providers(key):
            if importlib.util.find_spec(package) is not None:
                importlib.import_module(package)
        return self.get(key)

    def demand(self, key: Any) -> Callable[..., Any]:
        """The function for ``key``; TypeException says what would make it known."""
        function = self.find(key)
        if function is None:
            raise TypeException(self._missing(key))
        return function

    @staticmethod
    def _providers(key: Any) -> list[str]:
        types = key if isinstance(key, tuple) else (key,)
        providers = (_REGISTERED_BY.get(_package(one)) for one in types)
        return list(dict.fromkeys(provider for provider in providers if provider is not None))

    def _missing(self, key: Any) -> str:
        names = " to ".join(map(_name, key)) if isinstance(key, tuple) else _name(key)
        if names in _INSTEAD:
            return f"Type {names} is not loaded or supported: {_INSTEAD[names]}"
        absent = [package for package in self._providers(key) if importlib.util.find_spec(package) is None]
        if absent:
            cure = f"install {' and '.join(absent)}, which knows the messages of its package"
        else:
            cure = f"import the package that registers it, or register a function with {self._what}"
            cure += f" (help({self._what.partition('()')[0]}) has an example). {self._known(key)}"
        return f"Type {names} is not loaded or supported: {cure}"

    def _known(self, key: Any) -> str:
        """List the known types of the message packages of ``key``; if there are none, the known packages."""
        types = key if isinstance(key, tuple) else (key,)
        known: dict[str, list[str]] = {}
        for one in self._defaults:
            if isinstance(one, type) and _package(one) in map(_package, types):
                known.setdefault(_package(one), []).append(one.__name__)
        if known:
            facts = [f"{_REGISTERED_BY[name]} knows {', '.join(known[name])} of {name}" for name in known]
            return "; ".join(facts)
        facts = [f"of {name} are known to {provider}" for name, provider in _REGISTERED_BY.items()]
        return f"The types {'; those '.join(facts)}"


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

    # Programs reach into the tables of these classes, too, by the names that tf2's have.
    __type_map = _Functions("tf2_ros.TransformRegistration().add()")

    def add(
        self,
        key: type[_Object],
        callback: Callable[[_Object, TransformStamped], _Object],
        *,
        default: bool = False,
    ) -> None:
        """
        Register the function that transforms objects of one type.

        :param key: the type.
        :param callback: takes the object and a ``TransformStamped``, returns the transformed object.
        :param default: use it only if the program registers no other function for the type, before or after.
        :raises TypeError: ``key`` is not a type, or ``callback`` cannot be called.
        """
        call = "TransformRegistration.add"
        refuse_swapped(call, key=(is_a(type), key), callback=(callable, callback))
        if not isinstance(key, type):
            raise TypeError(f"{call} needs a type as key, not a {type(key).__name__}: {key!r}")
        self.__type_map.add(key, callback, default)

    def get(self, key: type[_Object]) -> Callable[[_Object, TransformStamped], _Object]:
        """
        Find the function that transforms objects of one type.

        :raises TypeException: none is registered.
        """
        return self.__type_map.demand(key)

    def is_default(self, key: type[Any]) -> bool:
        """Whether the function for a type is one of this project's."""
        return self.__type_map.is_default(key)

    def print_me(self) -> None:
        """Print the table."""
        print(dict(self.__type_map))


class ConvertRegistration:
    """
    The functions that turn objects of one type into another, by type; one table for the whole process.

    >>> from geometry_msgs.msg import Point
    >>> from tf2_ros import ConvertRegistration, convert
    >>> ConvertRegistration().add_convert((Point, tuple), lambda point: (point.x, point.y, point.z))
    >>> convert(Point(x=1.0), tuple)
    (1.0, 0.0, 0.0)
    """

    __to_msg_map = _Functions("tf2_ros.ConvertRegistration().add_to_msg()")
    __from_msg_map = _Functions("tf2_ros.ConvertRegistration().add_from_msg()")
    __convert_map = _Functions("tf2_ros.ConvertRegistration().add_convert()")

    def add_from_msg(
        self, key: type[_New], callback: Callable[[Any], _New], *, default: bool = False
    ) -> None:
        """
        Register the function that makes objects of one type from messages.

        :param key: the type.
        :param callback: takes a message, returns an object of the type.
        :param default: use it only if the program registers no other function for the type, before or after.
        """
        self.__from_msg_map.add(key, callback, default)

    def add_to_msg(
        self, key: type[_Object], callback: Callable[[_Object], Any], *, default: bool = False
    ) -> None:
        """
        Register the function that makes messages from objects of one type.

        :param key: the type.
        :param callback: takes an object of the type, returns a message.
        :param default: use it only if the program registers no other function for the type, before or after.
        """
        self.__to_msg_map.add(key, callback, default)

    def add_convert(
        self,
        key: tuple[type[_Object], type[_New]],
        callback: Callable[[_Object], _New],
        *,
        default: bool = False,
    ) -> None:
        """
        Register the function that converts one type to another directly, without a message in between.

        :param key: the type converted from, and the type converted to.
        :param callback: takes an object of the first type, returns one of the second.
        :param default: use it only if the program registers no other function for the pair, before or after.
        """
        self.__convert_map.add(key, callback, default)

    def get_from_msg(self, key: type[_New]) -> Callable[[Any], _New]:
        """
        Find the function that makes objects of a type from messages.

        :raises TypeException: none is registered.
        """
        return self.__from_msg_map.demand(key)

    def get_to_msg(self, key: type[_Object]) -> Callable[[_Object], Any]:
        """
        Find the function that makes messages from objects of a type.

        :raises TypeException: none is registered.
        """
        return self.__to_msg_map.demand(key)

    def get_convert(self, key: tuple[type[_Object], type[_New]]) -> Callable[[_Object], _New]:
        """
        Find the function that converts the first type of ``key`` to the second directly.

        :raises TypeException: none is registered.
        """
        return self.__convert_map.demand(key)

    def find_convert(self, key: tuple[type[_Object], type[_New]]) -> Callable[[_Object], _New] | None:
        """As :meth:`get_convert`, but return None if none is registered."""
        return self.__convert_map.find(key)


def to_msg_msg(msg: _Object) -> _Object:
    """Return ``msg``, which already is a message."""
    return msg


def from_msg_msg(msg: _Object) -> _Object:
    """Return ``msg``, which already is a message."""
    return msg


def register_messages(functions: TransformFunctions) -> None:
    """Register this project's functions for message classes, and that each class converts to itself."""
    for cls, function in functions.items():
        TransformRegistration().add(cls, function, default=True)
        ConvertRegistration().add_to_msg(cls, to_msg_msg, default=True)
        ConvertRegistration().add_from_msg(cls, from_msg_msg, default=True)


def names_of(functions: TransformFunctions) -> Mapping[str, Any]:
    """The message classes and the functions, each by its own name."""
    return {entry.__name__: entry for row in functions.items() for entry in row}


def convert(a: Any, b_type: type[_New]) -> _New:
    """
    Convert an object to another type: directly, as a deep copy if it has that type, or through a message.

    :param a: the object; it is not changed.
    :param b_type: the type to convert to.
    :return: an object of that type; where a program's own function makes it, of whatever type that returns.
    :raises TypeException: no conversion is registered, or it returns a message of another type.
    """
    registration = ConvertRegistration()
    direct = registration.find_convert((type(a), b_type))
    message = a
    if direct is not None:
        converted = direct(a)
    elif type(a) is b_type:
        converted = deepcopy(a)
    else:
        to_msg = registration.get_to_msg(type(a))
        from_msg = registration.get_from_msg(b_type)
        message = to_msg(a)
        converted = from_msg(message)
    # A program's own function may return any type; a message that was only passed on must be of `b_type`.
    if converted is message or hasattr(converted, "get_fields_and_field_types"):
        _check_type(converted, b_type, a)
    return converted


def _check_type(converted: Any, b_type: Any, a: Any) -> None:
    if isinstance(b_type, type) and not isinstance(converted, b_type):
        raise TypeException(
            f"Type {_name(type(a))} cannot be converted to {_name(b_type)}: the functions registered for "
            f"them make {_name(type(converted))} of it"
        )
