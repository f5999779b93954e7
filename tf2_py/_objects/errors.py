"""Owns the exceptions and their texts."""

from tf2_py._objects.frame_names import is_invalid_name
from tf2_py._objects.printable import printable

__all__ = [
    "ConnectivityException",
    "ExtrapolationException",
    "InvalidArgumentException",
    "LookupException",
    "TimeoutException",
    "TransformException",
]

NS_PER_S = 1_000_000_000


class TransformException(Exception):
    """
    Base of every error that a transform lookup raises.

    >>> from rclpy.time import Time
    >>> from tf2_py import BufferCore, TransformException
    >>> try:
    ...     BufferCore().lookup_transform_core("map", "odom", Time())
    ... except TransformException as error:
    ...     print(f"{type(error).__name__}: {error}")
    LookupException: "map" passed to lookupTransform argument target_frame does not exist. The buffer is empty
    """


class LookupException(TransformException):
    """A frame is not known, or the tree contains a loop."""


class ConnectivityException(TransformException):
    """Both frames are known, and no path leads from one to the other."""


class ExtrapolationException(TransformException):
    """A frame on the path has no data for the time asked for."""


class InvalidArgumentException(TransformException):
    """A frame name is empty or begins with a '/'."""


class TimeoutException(TransformException):
    """An answer was not available in time."""


class MalformedObjectError(AttributeError, TypeError):
    """An object lacks what its role needs: tf2 raises the AttributeError; it is of a wrong type as well."""


for _exception in (TransformException, *TransformException.__subclasses__()):
    _exception.__module__ = "tf2_py"


def seconds(ns: int) -> str:
    """Nanoseconds as decimal seconds, every digit kept."""
    sign = "-" if ns < 0 else ""
    whole, rest = divmod(abs(ns), NS_PER_S)
    return f"{sign}{whole}.{rest:09d}"


# Programs take these texts apart with regular expressions that were written for tf2's; see
# tests/test_error_texts.py. What tf2 does not say stands at the end, in words that they do not search for.


def bad_name(name: str, argument: str, call: str = "lookupTransform") -> TransformException:
    """What is wrong with the name of a frame that no lookup accepts; ``call`` is who was given it."""
    is_question = call == "canTransform"
    given = f'"{printable(name)}" passed to {call} argument {argument}'
    if not is_invalid_name(name):
        return LookupException(
            f"Invalid frame ID {given} - frame does not exist" if is_question else f"{given} does not exist"
        )
    wrong = "cannot start with a '/'" if name else "cannot be empty"
    subject = "frame ID" if is_question else "argument"
    return InvalidArgumentException(f"Invalid {subject} {given} - in tf2 frame_ids {wrong}")


def too_many_waiters(most: int) -> TransformException:
    """The buffer's limit of waits is reached."""
    return TransformException(f"{most} lookups wait in this buffer already: its max_waiters")


def loop(target: str, source: str) -> LookupException:
    """A walk that never reached a root."""
    target, source = printable(target), printable(source)
    return LookupException(
        f"The tf tree is invalid because it contains a loop, or more than 1000 hops in a row, "
        f"between frame [{source}] and frame [{target}]"
    )


def unconnected(target: str, source: str) -> ConnectivityException:
    """Two frames in different trees."""
    target, source = printable(target), printable(source)
    return ConnectivityException(
        f"Could not find a connection between '{target}' and '{source}' because they are "
        f"not part of the same tree. Tf has two or more unconnected trees."
    )


def extrapolation(
    gap: str, child: str, parent: str, requested_ns: int, edge_ns: int, target: str, source: str
) -> ExtrapolationException:
    """A history that does not reach the time asked for; ``gap`` is 'empty', 'single', 'future' or 'past'."""
    child, parent, target, source = map(printable, (child, parent, target, source))
    requested = seconds(requested_ns)
    edge = seconds(edge_ns)
    apart = seconds(abs(requested_ns - edge_ns))
    if gap == "future":
        fact = f"into the future.  Requested time {requested} but the latest data is at time {edge}"
        lack = f"{apart} s are missing after the newest sample of {child} in {parent}"
    elif gap == "past":
        fact = f"into the past.  Requested time {requested} but the earliest data is at time {edge}"
        lack = f"{apart} s are missing before the oldest sample of {child} in {parent}"
    elif gap == "single":
        fact = f"at time {requested}, but only time {edge} is in the buffer"
        lack = f"{apart} s are missing beside the one sample of {child} in {parent}"
    else:
        fact = f"at time {requested}"
        lack = f"no sample of {child} is held"
    return ExtrapolationException(
        f"Lookup would require extrapolation {fact}, when looking up transform from frame [{source}] to "
        f"frame [{target}]; {lack}"
    )
