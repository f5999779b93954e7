"""Owns the wait of a thread for a transform, without the GIL, and what ends it early."""

from collections.abc import Callable
from typing import Any

from tf2_py import BufferCore
from tf2_ros._rclpy import context_check
from tf2_ros._wait.long_waits import report_if_long
from tf2_ros._wait.lookup import Lookup

__all__ = ["aliveness", "wait_for_transform"]


def aliveness(context: Any) -> Callable[[], bool]:
    """
    What tells whether a context that is alive still is; where it is not, or never was, always true.

    A buffer can be used where ROS was never started; then there is nothing whose end to watch for.
    """
    return context_check(context) or _always


def _always() -> bool:
    return True


def wait_for_transform(core: BufferCore, lookup: Lookup, timeout_ns: int, context: Any) -> Any:
    """
    Wait, without the GIL, until there is an answer, and return it.

    :param timeout_ns: nanoseconds of steady time, at most FOR_EVER_NS; after that, what the lookup raises is
        raised.
    :param context: the rclpy context whose end ends the wait, unless it was not alive to begin with.

    An invalid name is raised at once.
    """
    alive = aliveness(context)
    while True:
        wait = lookup.wait(core)
        answer = wait.answer
        if answer is not None:
            return answer
        report = report_if_long([wait])
        if wait.wait_for(timeout_ns, alive):
            return wait.answer
        del report
        reason = wait.reason()
        if reason is not None:
            raise reason
        # It has arrived between the two: the next lookup finds it.
