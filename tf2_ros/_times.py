"""Owns what timeouts of programs become: nanoseconds, and messages for a buffer server."""

from typing import Any

from rclpy.duration import Duration

from tf2_py._internal import FOR_EVER_NS, duration_ns, timeout_ns

__all__ = [
    "FOR_EVER",
    "FOR_EVER_NS",
    "duration_msg",
    "duration_ns",
    "optional_timeout_ns",
    "timeout_ns",
]

FOR_EVER = Duration(seconds=2**31 - 1)  # the most that a duration message can say


def optional_timeout_ns(timeout: Any, argument: str = "timeout") -> int | None:
    """The nanoseconds of a timeout; None, for no end, where it is None or at least FOR_EVER_NS."""
    nanoseconds = FOR_EVER_NS if timeout is None else timeout_ns(timeout, argument)
    return None if nanoseconds == FOR_EVER_NS else nanoseconds


def duration_msg(timeout: Any) -> Any:
    """The duration message of a timeout; at most FOR_EVER, with either sign."""
    longest_ns: int = FOR_EVER.nanoseconds
    return Duration(nanoseconds=max(-longest_ns, min(timeout_ns(timeout), longest_ns))).to_msg()
