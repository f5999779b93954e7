"""Owns turning the durations and times that programs give into nanoseconds and messages."""

from typing import Any

from builtin_interfaces.msg import Time as TimeMsg
from rclpy.duration import Duration

__all__ = ["FOR_EVER", "FOR_EVER_NS", "NS_PER_S", "duration_msg", "duration_ns", "time_msg", "timeout_ns"]

NS_PER_S = 1_000_000_000
FOR_EVER_NS = 2**62  # 146 years; added to a steady time, it still fits into 64 bits
FOR_EVER = Duration(seconds=2**31 - 1)  # the most that a duration message can say


def duration_ns(duration: Any, name: str = "timeout") -> int:
    """
    The nanoseconds of an rclpy ``Duration``, or of a duration message.

    :param name: what the error calls it.
    :raises TypeError: it is something else.

    What is longer than FOR_EVER_NS becomes that, with either sign.
    """
    if hasattr(duration, "nanoseconds"):
        nanoseconds = duration.nanoseconds
    elif hasattr(duration, "sec") and hasattr(duration, "nanosec"):
        nanoseconds = duration.sec * NS_PER_S + duration.nanosec
    else:
        raise TypeError(f"a {name} is an rclpy.duration.Duration, not {type(duration).__name__}")
    # Before it becomes an int: it may be an infinite float.
    return int(max(-FOR_EVER_NS, min(nanoseconds, FOR_EVER_NS)))


def timeout_ns(timeout: Any) -> int | None:
    """The nanoseconds of a timeout; None, for no end, where that is None or at least FOR_EVER_NS."""
    nanoseconds = FOR_EVER_NS if timeout is None else duration_ns(timeout)
    return None if nanoseconds == FOR_EVER_NS else nanoseconds


def duration_msg(duration: Any) -> Any:
    """The duration message of what :func:`duration_ns` takes; at most FOR_EVER, with either sign."""
    longest_ns: int = FOR_EVER.nanoseconds
    return Duration(nanoseconds=max(-longest_ns, min(duration_ns(duration), longest_ns))).to_msg()


def time_msg(time: Any) -> TimeMsg:
    """
    The time message of an rclpy ``Time``, or of a time message.

    :raises TypeError: it is something else.
    """
    if hasattr(time, "nanoseconds"):
        sec, nanosec = divmod(time.nanoseconds, NS_PER_S)
        return TimeMsg(sec=sec, nanosec=nanosec)
    if hasattr(time, "sec") and hasattr(time, "nanosec"):
        return TimeMsg(sec=time.sec, nanosec=time.nanosec)
    raise TypeError(f"a time is an rclpy.time.Time, not {type(time).__name__}")
