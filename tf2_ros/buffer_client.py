"""Owns lookups in the buffer of another process, through its action."""

# Before the imports below fail without a word of advice.
from tf2_ros_cython import _requirement  # noqa: F401

# isort: split

import threading
import weakref
from typing import Any, Literal, overload

from action_msgs.msg import GoalStatus
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
from tf2_py._internal import class_name, frame_name, printable, wait_texts
from tf2_py.typing import TimeLike, TimeoutLike
from tf2_ros._arguments import has, is_name, refuse_swapped
from tf2_ros._goals import GoalSender, PendingGoal, send_directly
from tf2_ros._messages import time_msg
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
from tf2_ros._times import FOR_EVER, duration_msg, optional_timeout_ns, timeout_ns
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

    :param node: whose context and namespace are used. It need not be spun: a hidden node with a thread of its
        own sends the goals, so that blocking lookups work in callbacks of any executor, too.
    :param ns: the name of the server's action.
    :param check_frequency: how often to check for the server while there is none, in Hz.
    :param timeout_padding: how much longer than a lookup's own timeout to wait for the server's response.
    :raises ValueError: ``check_frequency`` is not above 0.

    Where a program replaced this module's ``ActionClient``, or the attribute ``action_client``, goals are
    sent with the replacement, by the thread that calls the lookup. Every ``time`` and ``timeout`` is as of
    :class:`tf2_ros.Buffer`.

    >>> from rclpy.time import Time
    >>> from tf2_ros import BufferClient
    >>> client = BufferClient(node, "tf2_buffer_server")  # of any node, such as rclpy.create_node("example")
    >>> client.can_transform("map", "base_link", Time())  # no server runs
    False
    >>> client.destroy()
    """

    def __init__(
        self,
        node: Node,
        ns: str,
        check_frequency: float = 10.0,
        timeout_padding: TimeoutLike = Duration(seconds=2.0),  # noqa: B008  as in tf2; a Duration cannot change
    ) -> None:
        refuse_swapped("BufferClient", node=(has("create_client"), node), ns=(is_name, ns))
        if not check_frequency > 0.0:
            raise ValueError(f"check_frequency must be above 0 Hz, it is {check_frequency}")
        super().__init__()
        self.node = node
        self.check_frequency = check_frequency
        self.timeout_padding = timeout_padding
        self._goal_sender: GoalSender | None = None
        if ActionClient is not GoalSender.client_class:
            self.action_client = ActionClient(node, LookupTransform, action_name=ns)
            return
        self._goal_sender = GoalSender(node, ns, 1.0 / check_frequency)
        self.action_client = self._goal_sender.action_client
        # Without destroy(), too, no thread remains; at exit it ends by itself.
        weakref.finalize(self, self._goal_sender.close, wait=False).atexit = False

    def __repr__(self) -> str:
        attributes, state = self.__dict__, "not initialised"
        if "action_client" in attributes:
            sender = attributes.get("_goal_sender")
            state = "a program's own action client" if sender is None else sender.state()
        return f"<{class_name(type(self))}: {state}>"

    def destroy(self) -> None:
        """End the client; pending lookups raise a TimeoutException."""
        if self._goal_sender is None or self.action_client is not self._goal_sender.action_client:
            self.action_client.destroy()
        if self._goal_sender is not None:
            self._goal_sender.close()

    def lookup_transform(
        self, target_frame: str, source_frame: str, time: TimeLike, timeout: TimeoutLike = NO_TIMEOUT
    ) -> TransformStamped:
        """
        Get the pose of ``source_frame`` in ``target_frame``: it carries data from the source to the target.

        A point at p in ``source_frame`` is at R p + t in ``target_frame``: R and t are the rotation and the
        translation returned. ``Time()``, which is 0, asks for the latest time for which all frames on the
        path have data. The default ``timeout`` does not wait.

        :param target_frame: the frame that the data is wanted in.
        :param source_frame: the frame that the data is in.
        :param time: of the transform; 0 is the latest time for which all frames on the path have data.
        :param timeout: how long to wait, for a server and then in it for the transform, in steady time.
        :return: a ``TransformStamped``, as of :meth:`tf2_ros.Buffer.lookup_transform`.
        :raises TimeoutException: there is no server, it did not answer, the transform was not available in
            time, or the context was shut down before. The text says which, and how long was waited.
        :raises TransformException: what the lookup in the server raised.
        :raises TypeError: a frame name is no ``str``, ``time`` no time, or ``timeout`` no timeout.
        """
        goal = _simple_goal(target_frame, source_frame, time)
        goal.timeout = duration_msg(timeout)
        return self.__process_goal(goal)

    def lookup_transform_full(
        self,
        target_frame: str,
        target_time: TimeLike,
        source_frame: str,
        source_time: TimeLike,
        fixed_frame: str,
        timeout: TimeoutLike = NO_TIMEOUT,
    ) -> TransformStamped:
        """
        Get the pose of ``source_frame`` at ``source_time`` in ``target_frame`` at ``target_time``.

        It carries data from the source to the target: a point at p in ``source_frame`` at the one time is at
        R p + t in ``target_frame`` at the other, if ``fixed_frame`` does not move meanwhile. ``Time()``,
        which is 0, asks for the latest time. The default ``timeout`` does not wait.

        :param target_frame: the frame that the data is wanted in.
        :param target_time: the time in ``target_frame``; 0 is the latest one.
        :param source_frame: the frame that the data is in.
        :param source_time: the time of the data; 0 is the latest one.
        :param fixed_frame: a frame that does not move between the two times.
        :param timeout: as of :meth:`lookup_transform`, which raises the same.
        """
        goal = _full_goal(target_frame, target_time, source_frame, source_time, fixed_frame)
        goal.timeout = duration_msg(timeout)
        return self.__process_goal(goal)

    @overload
    def can_transform(
        self,
        target_frame: str,
        source_frame: str,
        time: TimeLike,
        timeout: TimeoutLike = ...,
        return_debug_tuple: Literal[False] = ...,
    ) -> bool: ...

    @overload
    def can_transform(
        self,
        target_frame: str,
        source_frame: str,
        time: TimeLike,
        timeout: TimeoutLike = ...,
        *,
        return_debug_tuple: Literal[True],
    ) -> tuple[bool, str]: ...

    @overload
    def can_transform(
        self,
        target_frame: str,
        source_frame: str,
        time: TimeLike,
        timeout: TimeoutLike,
        return_debug_tuple: Literal[True],
    ) -> tuple[bool, str]: ...

    @overload
    def can_transform(
        self,
        target_frame: str,
        source_frame: str,
        time: TimeLike,
        timeout: TimeoutLike = ...,
        return_debug_tuple: bool = ...,
    ) -> bool | tuple[bool, str]: ...

    def can_transform(
        self,
        target_frame: str,
        source_frame: str,
        time: TimeLike,
        timeout: TimeoutLike = NO_TIMEOUT,
        return_debug_tuple: bool = False,
    ) -> bool | tuple[bool, str]:
        """
        Tell whether :meth:`lookup_transform` would answer: with the pose of ``source_frame`` in
        ``target_frame``. With ``Time()``: the latest one. The default ``timeout`` does not wait.

        :param target_frame: as of that method, like all but the last.
        :param return_debug_tuple: return a tuple of the answer and the reason why not, which is empty where
            it would.
        :raises TypeError: as that method; it raises nothing else.
        """
        try:
            self.lookup_transform(target_frame, source_frame, time, timeout)
        except TransformException as error:
            return (False, str(error)) if return_debug_tuple else False
        return (True, "") if return_debug_tuple else True

    @overload
    def can_transform_full(
        self,
        target_frame: str,
        target_time: TimeLike,
        source_frame: str,
        source_time: TimeLike,
        fixed_frame: str,
        timeout: TimeoutLike = ...,
        return_debug_tuple: Literal[False] = ...,
    ) -> bool: ...

    @overload
    def can_transform_full(
        self,
        target_frame: str,
        target_time: TimeLike,
        source_frame: str,
        source_time: TimeLike,
        fixed_frame: str,
        timeout: TimeoutLike = ...,
        *,
        return_debug_tuple: Literal[True],
    ) -> tuple[bool, str]: ...

    @overload
    def can_transform_full(
        self,
        target_frame: str,
        target_time: TimeLike,
        source_frame: str,
        source_time: TimeLike,
        fixed_frame: str,
        timeout: TimeoutLike,
        return_debug_tuple: Literal[True],
    ) -> tuple[bool, str]: ...

    @overload
    def can_transform_full(
        self,
        target_frame: str,
        target_time: TimeLike,
        source_frame: str,
        source_time: TimeLike,
        fixed_frame: str,
        timeout: TimeoutLike = ...,
        return_debug_tuple: bool = ...,
    ) -> bool | tuple[bool, str]: ...

    def can_transform_full(
        self,
        target_frame: str,
        target_time: TimeLike,
        source_frame: str,
        source_time: TimeLike,
        fixed_frame: str,
        timeout: TimeoutLike = NO_TIMEOUT,
        return_debug_tuple: bool = False,
    ) -> bool | tuple[bool, str]:
        """
        Tell whether :meth:`lookup_transform_full` would answer. The default ``timeout`` does not wait.

        :param target_frame: as of that method, like all but the last, which is that of :meth:`can_transform`.
        """
        try:
            self.lookup_transform_full(
                target_frame, target_time, source_frame, source_time, fixed_frame, timeout
            )
        except TransformException as error:
            return (False, str(error)) if return_debug_tuple else False
        return (True, "") if return_debug_tuple else True

    async def lookup_transform_async(
        self, target_frame: str, source_frame: str, time: TimeLike, *, timeout: TimeoutLike | None = None
    ) -> TransformStamped:
        """
        Await what :meth:`lookup_transform` returns: the pose of ``source_frame`` in ``target_frame``, which
        carries data from the source to the target. Without ``timeout`` it waits for ever.

        :param target_frame: as of that method, which raises the same.
        :param timeout: how long. None: until the server is destroyed, or the context is shut down.
        """
        return await self._await(_simple_goal(target_frame, source_frame, time), timeout)

    async def lookup_transform_full_async(
        self,
        target_frame: str,
        target_time: TimeLike,
        source_frame: str,
        source_time: TimeLike,
        fixed_frame: str,
        *,
        timeout: TimeoutLike | None = None,
    ) -> TransformStamped:
        """
        Await what :meth:`lookup_transform_full` returns. Without ``timeout`` it waits for ever.

        :param target_frame: as of that method, like all but ``timeout``.
        :param timeout: as of :meth:`lookup_transform_async`.
        """
        goal = _full_goal(target_frame, target_time, source_frame, source_time, fixed_frame)
        return await self._await(goal, timeout)

    # The two that follow have the names that programs patch in tf2's class.

    def __process_goal(self, goal: Any) -> TransformStamped:
        sender = self._goal_sender
        if sender is None or self.action_client is not sender.action_client:
            padding_ns = timeout_ns(self.timeout_padding, "timeout_padding")
            return self.__process_result(send_directly(self.action_client, goal, padding_ns))
        pending = self._send(sender, goal, timeout_ns(Duration.from_msg(goal.timeout)))
        done = threading.Event()
        pending.outcome.add_done_callback(lambda _: done.set())
        try:
            # The sender's thread gives every goal an outcome, also at its own end.
            done.wait()
            return self.__process_result(_result_of(pending, pending.outcome.result()))
        finally:
            pending.abandon()

    def __process_result(self, result: Any) -> TransformStamped:
        if result.error.error != TF2Error.NO_ERROR:
            raise EXCEPTIONS.get(result.error.error, TransformException)(printable(result.error.error_string))
        return result.transform

    async def _await(self, goal: Any, timeout: TimeoutLike | None) -> TransformStamped:
        sender = self._goal_sender
        if sender is None or self.action_client is not sender.action_client:
            goal.timeout = duration_msg(FOR_EVER if timeout is None else timeout)
            return self.__process_goal(goal)
        pending = self._send(sender, goal, optional_timeout_ns(timeout))
        try:
            return self.__process_result(_result_of(pending, await pending.outcome))
        finally:
            pending.abandon()

    def _send(self, sender: GoalSender, goal: Any, lookup_ns: int | None) -> PendingGoal:
        return sender.send(goal, lookup_ns, timeout_ns(self.timeout_padding, "timeout_padding"))


# A message takes any object as a name, until the thread of the sender serialises it.


def _simple_goal(target_frame: str, source_frame: str, time: Any) -> Any:
    return LookupTransform.Goal(
        target_frame=frame_name(target_frame, "target_frame"),
        source_frame=frame_name(source_frame, "source_frame"),
        source_time=time_msg(time, "time"),
    )


def _full_goal(
    target_frame: str, target_time: Any, source_frame: str, source_time: Any, fixed_frame: str
) -> Any:
    return LookupTransform.Goal(
        target_frame=frame_name(target_frame, "target_frame"),
        target_time=time_msg(target_time, "target_time"),
        source_frame=frame_name(source_frame, "source_frame"),
        source_time=time_msg(source_time, "source_time"),
        fixed_frame=frame_name(fixed_frame, "fixed_frame"),
        advanced=True,
    )


def _result_of(pending: PendingGoal, response: Any) -> Any:
    goal, result = pending.goal, response.result
    # A server whose wait timed out or was cancelled may send an empty result without an error.
    if result.error.error == TF2Error.NO_ERROR and (
        response.status != GoalStatus.STATUS_SUCCEEDED or not result.transform.header.frame_id
    ):
        text = (
            f"The buffer server did not get the transform from [{printable(goal.source_frame)}] to "
            f"[{printable(goal.target_frame)}] in time."
        )
        raise TimeoutException(wait_texts.waited(text, pending.waited_ns()))
    return result
