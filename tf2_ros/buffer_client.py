"""Owns asking a buffer in another process, through its action."""

import threading
import weakref
from typing import Any

from action_msgs.msg import GoalStatus
from builtin_interfaces.msg import Time as TimeMsg
from geometry_msgs.msg import TransformStamped
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.time import Time

from tf2_msgs.action import LookupTransform
from tf2_msgs.msg import TF2Error
from tf2_py import (
    ConnectivityException,
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
    TimeoutException,
    TransformException,
)
from tf2_ros._asking import Asking, Question
from tf2_ros._waiting import duration_ns
from tf2_ros.buffer_interface import NO_TIMEOUT, BufferInterface

__all__ = ["BufferClient"]

ALIVE_CHECK_S = 0.1  # how often a blocked thread looks whether there is still somebody to answer it

EXCEPTIONS = {
    TF2Error.LOOKUP_ERROR: LookupException,
    TF2Error.CONNECTIVITY_ERROR: ConnectivityException,
    TF2Error.EXTRAPOLATION_ERROR: ExtrapolationException,
    TF2Error.INVALID_ARGUMENT_ERROR: InvalidArgumentException,
    TF2Error.TIMEOUT_ERROR: TimeoutException,
}


class BufferClient(BufferInterface):
    """
    Looks transforms up in the buffer of a buffer server.

    :param node: who asks. It need not be spun: a hidden node with a thread of its own sends the goals, so
        that blocking lookups work in callbacks of any executor, too.
    :param ns: the name of the server's action.
    :param check_frequency: how often to look for the server while there is none, in Hz.
    :param timeout_padding: how much longer than a lookup's own timeout to wait for the server's answer.
    """

    def __init__(
        self,
        node: Node,
        ns: str,
        check_frequency: float = 10.0,
        timeout_padding: Duration = Duration(seconds=2.0),  # noqa: B008  as upstream; a Duration cannot change
    ) -> None:
        if not check_frequency > 0.0:
            raise ValueError(f"check_frequency must be above 0 Hz, it is {check_frequency}")
        super().__init__()
        self.node = node
        self.check_frequency = check_frequency
        self.timeout_padding = timeout_padding
        self._asking = Asking(node, ns, 1.0 / check_frequency)
        self.action_client = self._asking.action_client
        # Whoever forgets destroy() leaves no thread; at exit it ends by itself.
        self._end = weakref.finalize(self, self._asking.close)
        self._end.atexit = False

    def destroy(self) -> None:
        """End the client; lookups that are going on end with a TimeoutException."""
        self._end()

    def lookup_transform(
        self, target_frame: str, source_frame: str, time: Time, timeout: Duration = NO_TIMEOUT
    ) -> TransformStamped:
        """
        Get the transform that carries data from ``source_frame`` into ``target_frame``.

        :param time: when; 0 is the latest time that all frames on the path know.
        :param timeout: how long to wait, for a server and then in it for the transform, in steady time.
        :raises TimeoutException: there is no server, it did not answer, or it waited in vain.
        :raises TransformException: what the lookup in the server raised.
        """
        return self._block(_simple_goal(target_frame, source_frame, time), timeout)

    def lookup_transform_full(
        self,
        target_frame: str,
        target_time: Time,
        source_frame: str,
        source_time: Time,
        fixed_frame: str,
        timeout: Duration = NO_TIMEOUT,
    ) -> TransformStamped:
        """
        Get the transform from ``source_frame`` at ``source_time`` into ``target_frame`` at ``target_time``.

        :param fixed_frame: the frame that is taken to stand still between the two times.

        Otherwise as :meth:`lookup_transform`.
        """
        goal = _full_goal(target_frame, target_time, source_frame, source_time, fixed_frame)
        return self._block(goal, timeout)

    def can_transform(
        self,
        target_frame: str,
        source_frame: str,
        time: Time,
        timeout: Duration = NO_TIMEOUT,
        return_debug_tuple: bool = False,
    ) -> bool | tuple[bool, str]:
        """
        Tell whether :meth:`lookup_transform` would answer.

        :param return_debug_tuple: return the answer and the reason of a "no", which is empty for a "yes".
        """
        try:
            self.lookup_transform(target_frame, source_frame, time, timeout)
        except TransformException as error:
            return (False, str(error)) if return_debug_tuple else False
        return (True, "") if return_debug_tuple else True

    def can_transform_full(
        self,
        target_frame: str,
        target_time: Time,
        source_frame: str,
        source_time: Time,
        fixed_frame: str,
        timeout: Duration = NO_TIMEOUT,
        return_debug_tuple: bool = False,
    ) -> bool | tuple[bool, str]:
        """Tell whether :meth:`lookup_transform_full` would answer; otherwise as :meth:`can_transform`."""
        try:
            self.lookup_transform_full(
                target_frame, target_time, source_frame, source_time, fixed_frame, timeout
            )
        except TransformException as error:
            return (False, str(error)) if return_debug_tuple else False
        return (True, "") if return_debug_tuple else True

    async def lookup_transform_async(
        self, target_frame: str, source_frame: str, time: Time, *, timeout: Duration | None = None
    ) -> TransformStamped:
        """
        Await what :meth:`lookup_transform` answers.

        :param timeout: how long. None: for ever, or until the server goes away.
        """
        return await self._await(_simple_goal(target_frame, source_frame, time), timeout)

    async def lookup_transform_full_async(
        self,
        target_frame: str,
        target_time: Time,
        source_frame: str,
        source_time: Time,
        fixed_frame: str,
        *,
        timeout: Duration | None = None,
    ) -> TransformStamped:
        """Await what :meth:`lookup_transform_full` answers; otherwise as :meth:`lookup_transform_async`."""
        goal = _full_goal(target_frame, target_time, source_frame, source_time, fixed_frame)
        return await self._await(goal, timeout)

    def _ask(self, goal: Any, timeout: Duration | None) -> Question:
        timeout_ns = None if timeout is None else duration_ns(timeout)
        return self._asking.ask(goal, timeout_ns, duration_ns(self.timeout_padding))

    def _block(self, goal: Any, timeout: Duration) -> TransformStamped:
        question = self._ask(goal, timeout)
        done = threading.Event()
        question.outcome.add_done_callback(lambda _: done.set())
        try:
            while not done.wait(ALIVE_CHECK_S):
                if not self._asking.alive():
                    raise TimeoutException(
                        "The context was shut down while the buffer server was being asked."
                    )
            return _transform_of(question.outcome.result(), goal)
        finally:
            question.abandon()

    async def _await(self, goal: Any, timeout: Duration | None) -> TransformStamped:
        question = self._ask(goal, timeout)
        try:
            return _transform_of(await question.outcome, goal)
        finally:
            question.abandon()


def _simple_goal(target_frame: str, source_frame: str, time: Any) -> Any:
    return LookupTransform.Goal(
        target_frame=target_frame, source_frame=source_frame, source_time=_time_msg(time)
    )


def _full_goal(
    target_frame: str, target_time: Any, source_frame: str, source_time: Any, fixed_frame: str
) -> Any:
    return LookupTransform.Goal(
        target_frame=target_frame,
        target_time=_time_msg(target_time),
        source_frame=source_frame,
        source_time=_time_msg(source_time),
        fixed_frame=fixed_frame,
        advanced=True,
    )


def _transform_of(response: Any, goal: Any) -> TransformStamped:
    result = response.result
    if result.error.error != TF2Error.NO_ERROR:
        raise EXCEPTIONS.get(result.error.error, TransformException)(result.error.error_string)
    # A server that waited in vain, or was told to stop, may send an empty result without an error.
    if response.status != GoalStatus.STATUS_SUCCEEDED or not result.transform.header.frame_id:
        raise TimeoutException(
            f"The buffer server did not get the transform from [{goal.source_frame}] to "
            f"[{goal.target_frame}] in time."
        )
    return result.transform


def _time_msg(time: Any) -> TimeMsg:
    if hasattr(time, "nanoseconds"):
        sec, nanosec = divmod(time.nanoseconds, 1_000_000_000)
        return TimeMsg(sec=sec, nanosec=nanosec)
    if hasattr(time, "sec") and hasattr(time, "nanosec"):
        return TimeMsg(sec=time.sec, nanosec=time.nanosec)
    raise TypeError(f"a time is an rclpy.time.Time, not {type(time).__name__}")
