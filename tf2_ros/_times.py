"""Owns what timeouts and times of programs become: nanoseconds, and messages for a buffer server."""

from typing import Any

from builtin_interfaces.msg import Time as TimeMsg
from rclpy.duration import Duration

from tf2_py._internal import FOR_EVER_NS, duration_ns, stamp_parts

__all__ = [
    "FOR_EVER",
    "FOR_EVER_NS",
    "duration_msg",
    "duration_ns",
    "optional_timeout_ns",
    "time_msg",
    "timeout_ns",
]

FOR_EVER = Duration(seconds=2**31 - 1)  # the most that a duration message can say


def timeout_ns(timeout: Any) -> int:
    """The nanoseconds of a timeout, at most FOR_EVER_NS; see ``tf2_py._internal.duration_ns``."""
    return duration_ns(timeout, "a timeout")


def optional_timeout_ns(timeout: Any) -> int | None:
    """The same; None, for no end, where the timeout is None or at least FOR_EVER_NS."""
    nanoseconds = FOR_EVER_NS if timeout is None else timeout_ns(timeout)
    return None if nanoseconds == FOR_EVER_NS else nanoseconds


def duration_msg(timeout: Any) -> Any:
    """The duration message of a timeout; at most FOR_EVER, with either sign."""
    longest_ns: int = FOR_EVER.nanoseconds
    return Duration(nanoseconds=max(-longest_ns, min(timeout_ns(timeout), longest_ns))).to_msg()


def time_msg(time: Any) -> TimeMsg:
    """
    The time message of an rclpy ``Time``, or of a time message.

    :raises TypeError: it is something else.
    """
    if hasattr(time, "nanoseconds"):
        sec, nanosec = stamp_parts(time.nanoseconds)
        return TimeMsg(sec=sec, nanosec=nanosec)
    if hasattr(time, "sec") and hasattr(time, "nanosec"):
        return TimeMsg(sec=time.sec, nanosec=time.nanosec)
    raise TypeError(f"a time is an rclpy.time.Time, not {type(time).__name__}")
