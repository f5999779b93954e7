"""Owns waiting on a buffer whose methods a program has replaced: the waits call these, as in tf2."""

from collections.abc import Callable
from functools import partial
from typing import Any

from tf2_py import TransformException
from tf2_py._internal import timeout_ns
from tf2_py.typing import TimeLike, TimeoutLike
from tf2_ros._messages import TransformStamped
from tf2_ros._wait.blocking import BlockingWait
from tf2_ros.buffer_interface import NO_TIMEOUT

__all__ = ["lookup_transform_full_via_can", "lookup_transform_via_can"]


def lookup_transform_via_can(
    self: Any, target_frame: str, source_frame: str, time: TimeLike, timeout: TimeoutLike = NO_TIMEOUT
) -> TransformStamped:
    """The ``lookup_transform`` of a buffer that has a ``can_transform*`` of its own."""
    wait = _wait(self, timeout)
    self.can_transform(target_frame, source_frame, time, timeout)
    return _answer(wait, partial(self.lookup_transform_core, target_frame, source_frame, time))


def lookup_transform_full_via_can(
    self: Any,
    target_frame: str,
    target_time: TimeLike,
    source_frame: str,
    source_time: TimeLike,
    fixed_frame: str,
    timeout: TimeoutLike = NO_TIMEOUT,
) -> TransformStamped:
    """The same for ``lookup_transform_full``."""
    wait = _wait(self, timeout)
    self.can_transform_full(target_frame, target_time, source_frame, source_time, fixed_frame, timeout)
    arguments = (target_frame, target_time, source_frame, source_time, fixed_frame)
    return _answer(wait, partial(self.lookup_transform_full_core, *arguments))


def _wait(buffer: Any, timeout: Any) -> BlockingWait:
    try:
        nanoseconds = timeout_ns(timeout)
    except (TypeError, ValueError):
        nanoseconds = 0  # a program's own `can_transform` may accept what is no timeout elsewhere
    return BlockingWait(buffer, nanoseconds)


def _answer(wait: BlockingWait, look_up: Callable[[], TransformStamped]) -> TransformStamped:
    try:
        return look_up()
    except TransformException as error:
        told = wait.error(error)
        if told is error:
            raise
        raise told from None
