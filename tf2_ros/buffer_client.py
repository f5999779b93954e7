"""Owns asking a buffer in another process, through its action."""

import threading
import weakref
from typing import Any

from action_msgs.msg import GoalStatus
from builtin_interfaces.msg import Time as TimeMsg
from geometry_msgs.msg import TransformStamped
from rclpy.action.client import ActionClient
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
from tf2_py._objects.printable import printable
from tf2_ros._goals import FOR_EVER, Asking, Question, ask_directly
from tf2_ros._tf2_names import (
    Clock,
    LookupTransformGoal,
    LookupTransformResult,
    TypeVar,
    builtin_interfaces,
    sleep,
    tf2,
    tf2_ros,
    warnings,
)
from tf2_ros._wait.waiting import duration_ns, timeout_ns
from tf2_ros.buffer_interface import NO_TIMEOUT, BufferInterface

# What `import *` gives from tf2's module.
__all__ = [
    "ActionClient",
    "BufferClient",
    "Clock",
    "Duration",
    "LookupTransform",
    "LookupTransformGoal",
    "LookupTransformResult",
    "Node",
    "Time",
    "TransformStamped",
    "TypeVar",
    "builtin_interfaces",
    "sleep",
    "tf2",
    "tf2_ros",
    "threading",
    "warnings",
]

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

    Where a program put another class in the place of this module's ``ActionClient``, or another object into
    the attribute ``action_client``, goals are sent with that, by the thread that asks.
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
        self._asking: Asking | None = None
        if ActionClient is not Asking.client_class:
            self.action_client = ActionClient(node, LookupTransform, action_name=ns)
            return
        self._asking = Asking(node, ns, 1.0 / check_frequency)
        self.action_client = self._asking.action_client
        # Whoever forgets destroy() leaves no thread; at exit it ends by itself.
        weakref.finalize(self, self._asking.close, wait=False).atexit = False

    def destroy(self) -> None:
        """End the client; lookups that are going on end with a TimeoutException."""
        if self._asking is None or self.action_client is not self._asking.action_client:
            self.action_client.destroy()
        if self._asking is not None:
            self._asking.close()

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
        goal = _simple_goal(target_frame, source_frame, time)
        goal.timeout = _duration_msg(timeout)
        return self.__process_goal(goal)

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
        goal.timeout = _duration_msg(timeout)
        return self.__process_goal(goal)

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

    # The two that follow have the names that programs patch in tf2's class.

    def __process_goal(self, goal: Any) -> TransformStamped:
        asking = self._asking
        if asking is None or self.action_client is not asking.action_client:
            padding_ns = duration_ns(self.timeout_padding)
            return self.__process_result(ask_directly(self.action_client, goal, padding_ns))
        question = self._ask(asking, goal, duration_ns(Duration.from_msg(goal.timeout)))
        done = threading.Event()
        question.outcome.add_done_callback(lambda _: done.set())
        try:
            while not done.wait(ALIVE_CHECK_S):
                if not asking.alive():
                    raise TimeoutException(
                        "The context was shut down while the buffer server was being asked."
                    )
            return self.__process_result(_result_of(question.outcome.result(), goal))
        finally:
            question.abandon()

    def __process_result(self, result: Any) -> TransformStamped:
        if result.error.error != TF2Error.NO_ERROR:
            raise EXCEPTIONS.get(result.error.error, TransformException)(printable(result.error.error_string))
        return result.transform

    async def _await(self, goal: Any, timeout: Duration | None) -> TransformStamped:
        asking = self._asking
        if asking is None or self.action_client is not asking.action_client:
            goal.timeout = _duration_msg(FOR_EVER if timeout is None else timeout)
            return self.__process_goal(goal)
        question = self._ask(asking, goal, timeout_ns(timeout))
        try:
            return self.__process_result(_result_of(await question.outcome, goal))
        finally:
            question.abandon()

    def _ask(self, asking: Asking, goal: Any, timeout_ns: int | None) -> Question:
        return asking.ask(goal, timeout_ns, duration_ns(self.timeout_padding))


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


def _result_of(response: Any, goal: Any) -> Any:
    result = response.result
    # A server that waited in vain, or was told to stop, may send an empty result without an error.
    if result.error.error == TF2Error.NO_ERROR and (
        response.status != GoalStatus.STATUS_SUCCEEDED or not result.transform.header.frame_id
    ):
        raise TimeoutException(
            f"The buffer server did not get the transform from [{printable(goal.source_frame)}] to "
            f"[{printable(goal.target_frame)}] in time."
        )
    return result


def _duration_msg(timeout: Any) -> Any:
    longest_ns: int = FOR_EVER.nanoseconds
    return Duration(nanoseconds=max(-longest_ns, min(duration_ns(timeout), longest_ns))).to_msg()


def _time_msg(time: Any) -> TimeMsg:
    if hasattr(time, "nanoseconds"):
        sec, nanosec = divmod(time.nanoseconds, 1_000_000_000)
        return TimeMsg(sec=sec, nanosec=nanosec)
    if hasattr(time, "sec") and hasattr(time, "nanosec"):
        return TimeMsg(sec=time.sec, nanosec=time.nanosec)
    raise TypeError(f"a time is an rclpy.time.Time, not {type(time).__name__}")
