"""Owns the exceptions and their texts."""

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
    """Base of every error that a transform lookup raises."""


class LookupException(TransformException):
    """A frame is not known, or the tree contains a loop."""


class ConnectivityException(TransformException):
    """Both frames are known, and no path leads from one to the other."""


class ExtrapolationException(TransformException):
    """A frame on the path has no data for the time asked for."""


class InvalidArgumentException(TransformException):
    """A frame name is empty or begins with a '/'."""


class TimeoutException(TransformException):
    """An answer did not come in time."""


for _exception in (TransformException, *TransformException.__subclasses__()):
    _exception.__module__ = "tf2_py"


def seconds(ns: int) -> str:
    """Nanoseconds as decimal seconds, every digit kept."""
    sign = "-" if ns < 0 else ""
    whole, rest = divmod(abs(ns), NS_PER_S)
    return f"{sign}{whole}.{rest:09d}"


def bad_name(name: str, argument: str) -> TransformException:
    """What is wrong with the name of a frame that no lookup accepts."""
    if not name:
        return InvalidArgumentException(f"Invalid argument {argument}: in tf2 a frame name cannot be empty")
    if name.startswith("/"):
        return InvalidArgumentException(
            f"Invalid argument {argument} \"{name}\": in tf2 a frame name cannot start with a '/'"
        )
    return LookupException(f'{argument} "{name}" does not exist')


def loop(target: str, source: str) -> LookupException:
    """A walk that never came to a root."""
    return LookupException(
        f"The tf tree is invalid because it contains a loop, or more than 1000 hops in a row, "
        f"between frame [{source}] and frame [{target}]"
    )


def unconnected(target: str, source: str) -> ConnectivityException:
    """Two frames in different trees."""
    return ConnectivityException(
        f"Could not find a connection between '{target}' and '{source}' because they are "
        f"not part of the same tree. Tf has two or more unconnected trees."
    )


def extrapolation(
    gap: str, child: str, parent: str, requested_ns: int, edge_ns: int, target: str, source: str
) -> ExtrapolationException:
    """A history that does not reach the time asked for; ``gap`` is 'empty', 'single', 'future' or 'past'."""
    requested = seconds(requested_ns)
    edge = seconds(edge_ns)
    apart = seconds(abs(requested_ns - edge_ns))
    if gap == "future":
        fact = (
            f"Lookup would require extrapolation into the future. Requested time {requested} but the latest "
            f"data of frame [{child}] in frame [{parent}] is at time {edge}, {apart} s earlier"
        )
    elif gap == "past":
        fact = (
            f"Lookup would require extrapolation into the past. Requested time {requested} but the earliest "
            f"data of frame [{child}] in frame [{parent}] is at time {edge}, {apart} s later"
        )
    elif gap == "single":
        fact = (
            f"Lookup would require extrapolation at time {requested}, but only time {edge} of frame "
            f"[{child}] in frame [{parent}] is in the buffer, {apart} s away"
        )
    else:
        fact = f"Lookup would require extrapolation at time {requested}, but frame [{child}] holds no data"
    return ExtrapolationException(
        f"{fact}, when looking up transform from frame [{source}] to frame [{target}]"
    )
