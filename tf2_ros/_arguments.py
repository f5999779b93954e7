"""Owns saying what is wrong with arguments that stand in the places of others."""

from collections.abc import Callable, Sequence
from itertools import permutations
from typing import Any

from tf2_py._internal import MalformedObjectError

__all__ = [
    "has",
    "is_a",
    "is_duration",
    "is_name",
    "is_names",
    "refuse_swapped",
    "require_node",
    "swapped",
]

Fits = Callable[[Any], bool]  # whether a value can stand in the place of an argument


def has(*attributes: str) -> Fits:
    """Whether a value has all of these."""
    return lambda value: all(hasattr(value, name) for name in attributes)


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
    What to say if all values fit other places than those that they were given in; None if they do not.

    :param call: the name of what was called.
    :param given: for each argument, in the order of the signature, what fits its place, and the value; None
        is no value.
    """
    values = {name: value for name, (_, value) in given.items() if value is not None}
    misplaced = [name for name, value in values.items() if not given[name][0](value)]
    if not misplaced:
        return None
    for places in permutations(given, len(values)):
        meant = dict(zip(places, values.values(), strict=True))
        if all(given[place][0](value) for place, value in meant.items()):
            wanted = ", ".join(f"{name}=<{_kind(meant[name])}>" for name in given if name in meant)
            wrong = misplaced[0]
            return f"{call} got {_kind(values[wrong])} as {wrong}; did you mean {call}({wanted})?"
    return None


def refuse_swapped(call: str, **given: tuple[Fits, Any]) -> None:
    """Raise a TypeError, which is also an AttributeError as in tf2, if there is something to say."""
    text = swapped(call, **given)
    if text is not None:
        raise MalformedObjectError(text)


def require_node(call: str, node: Any, method: str) -> None:
    """Raise a TypeError, which is also an AttributeError as in tf2, where a node lacks the method."""
    if not hasattr(node, method):
        raise MalformedObjectError(f"{call} needs a node, which has {method}; {_kind(node)} has not")


def _kind(value: Any) -> str:
    return type(value).__name__
