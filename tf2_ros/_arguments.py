"""Detect swapped arguments, and read timeouts."""

from collections.abc import Callable, Sequence
from itertools import permutations
from typing import Any

from tf2_py._internal import FOR_EVER_NS, MalformedObjectError, timeout_ns

Fits = Callable[[Any], bool]  # whether a value can stand in the place of an argument


def has(*attributes: str) -> Fits:
    """Whether a value has all of these. A class, which may have been passed for an object, has not."""
    return lambda value: not isinstance(value, type) and all(hasattr(value, name) for name in attributes)


def is_a(kind: type) -> Fits:
    """Whether a value is an instance of this."""
    return lambda value: isinstance(value, kind)


is_name = is_a(str)


def is_names(value: Any) -> bool:
    """Whether it is a frame name, or several."""
    return is_name(value) or (isinstance(value, Sequence) and all(map(is_name, value)))


def is_duration(value: Any) -> bool:
    """Whether it has the fields of a duration."""
    return hasattr(value, "nanoseconds") or has("sec", "nanosec")(value)


def swapped(call: str, **given: tuple[Fits, Any]) -> str | None:
    """
    Get the text of an error if all values fit, but in other places than they were given in, or if one of them
    is a class instead of an object; otherwise None.

    :param call: the name of what was called.
    :param given: for each argument, in the order of the signature, what fits its place, and the value. None
        stands for a missing value.
    """
    values = {name: value for name, (_, value) in given.items() if value is not None}
    misplaced = [name for name, value in values.items() if not given[name][0](value)]
    if not misplaced:
        return None
    for places in permutations(given, len(values)):
        meant = dict(zip(places, values.values(), strict=True))
        if all(given[place][0](value) for place, value in meant.items()):
            wanted = ", ".join(f"{name}=<{type(meant[name]).__name__}>" for name in given if name in meant)
            wrong = misplaced[0]
            return f"{call} got {type(values[wrong]).__name__} as {wrong}; did you mean {call}({wanted})?"
    for name in misplaced:
        if isinstance(values[name], type):
            return f"{call} got {kind_of(values[name])} as {name}; did you mean {values[name].__name__}()?"
    return None


def refuse_swapped(call: str, **given: tuple[Fits, Any]) -> None:
    """Raise a TypeError, which is also an AttributeError as in tf2, if arguments were swapped."""
    text = swapped(call, **given)
    if text is not None:
        raise MalformedObjectError(text)


def require_node(call: str, node: Any, method: str) -> None:
    """Raise a TypeError, which is also an AttributeError as in tf2, if a node lacks the method."""
    if not hasattr(node, method):
        raise MalformedObjectError(f"{call} needs a node, which has {method}; {kind_of(node)} has not")


def optional_timeout_ns(timeout: Any, argument: str = "timeout") -> int | None:
    """The nanoseconds of a timeout; None, for no end, if it is None or at least FOR_EVER_NS."""
    nanoseconds = FOR_EVER_NS if timeout is None else timeout_ns(timeout, argument)
    return None if nanoseconds == FOR_EVER_NS else nanoseconds


def kind_of(value: Any) -> str:
    """The name of a value's class; for a class, which may have been passed for an object, its own name."""
    return f"the class {value.__name__}" if isinstance(value, type) else type(value).__name__


def require_callable(method: str, callback: object) -> None:
    """Raise a TypeError if what a method is to call cannot be called."""
    if not callable(callback):
        raise TypeError(f"{method} needs a function to call, not {kind_of(callback)}")
