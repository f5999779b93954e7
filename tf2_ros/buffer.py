"""Owns the buffer that a node uses: the engine, waiting for it, its service and its clock."""

import weakref
from functools import partial
from typing import Any

from geometry_msgs.msg import TransformStamped
from rclpy.clock import Clock, ClockChange, JumpHandle, JumpThreshold, TimeJump
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.service import Service
from rclpy.task import Future
from rclpy.time import Time
from rclpy.utilities import get_default_context

from tf2_msgs.srv import FrameGraph
from tf2_py import BufferCore, TransformException
from tf2_ros._receive.thread import attribute_changed, replay
from tf2_ros._replaced import (
    AskingFuture,
    lookup_transform_by_asking,
    lookup_transform_full_by_asking,
    wait_until,
)
from tf2_ros._tf2_names import (
    Callable,
    FrameGraphSrvRequest,
    FrameGraphSrvResponse,
    List,
    Optional,
    Tuple,
    TypeVar,
    rclpy,
    sleep,
    tf2,
    tf2_ros,
    threading,
)
from tf2_ros._wait.waiting import Lookup, TransformFuture, aliveness, block, duration_ns, timeout_ns
from tf2_ros.buffer_interface import NO_TIMEOUT, BufferInterface

# What `import *` gives from tf2's module.
__all__ = [
    "Any",
    "Buffer",
    "Callable",
    "Duration",
    "FrameGraph",
    "FrameGraphSrvRequest",
    "FrameGraphSrvResponse",
    "Future",
    "JumpThreshold",
    "List",
    "Node",
    "Optional",
    "Time",
    "TimeJump",
    "TransformStamped",
    "Tuple",
    "TypeVar",
    "rclpy",
    "sleep",
    "tf2",
    "tf2_ros",
    "threading",
]

DEFAULT_CACHE_TIME_NS = 10 * 1_000_000_000  # of a BufferCore
JUMP_BACK = Duration(seconds=-1)  # from here on a buffer forgets what it knew

# By which transforms get into a buffer.
SETTERS = frozenset({"set_transform", "set_transform_static", "set_transforms", "set_transforms_cdr"})


class Buffer(BufferCore, BufferInterface):
    """
    A buffer of transforms that can be waited for.

    :param cache_time: how far each frame's history reaches back. Default 10 s.
    :param node: offer the service ``tf2_frames`` and follow the clock of this node.
    :param limits: ``max_frames``, ``max_bytes``, ``max_waiters``: see :class:`tf2_py.BufferCore`.

    It is emptied when its clock jumps back by 1 s or more, and when simulated time is switched on or off.
    Every ``time`` is anything with ``nanoseconds``, or with ``sec`` and ``nanosec``; 0 is the latest time
    that all frames on the path know. Every ``timeout`` is steady time, under simulated time, too.
    """

    def __init__(
        self, cache_time: Duration | None = None, node: Node | None = None, **limits: int | None
    ) -> None:
        BufferCore.__init__(self, cache_time, **limits)
        BufferInterface.__init__(self)
        self._cache_time_ns = DEFAULT_CACHE_TIME_NS if cache_time is None else duration_ns(cache_time)
        self._node_context = None if node is None else node.context
        self.srv: Service | None = None
        self.clock: Clock = Clock() if node is None else node.get_clock()
        if node is not None:
            self.srv = node.create_service(FrameGraph, "tf2_frames", self.__get_frames)
        if "jump_handle" in self.__dict__:
            self.jump_handle.unregister()  # __init__ was called again
        self.jump_handle: JumpHandle = _forget_at_jumps(self)

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        # A lookup asks what a subclass put in the place of these. Here, and not at each lookup.
        if cls.__replaces(*_CAN) and cls.lookup_transform is Buffer.lookup_transform:
            cls.lookup_transform = lookup_transform_by_asking  # type: ignore[method-assign]
        if cls.__replaces(*_CAN_FULL) and cls.lookup_transform_full is Buffer.lookup_transform_full:
            cls.lookup_transform_full = lookup_transform_full_by_asking  # type: ignore[method-assign]

    def __setattr__(self, name: str, value: Any) -> None:
        super().__setattr__(name, value)
        if name in SETTERS:
            attribute_changed()

    def __delattr__(self, name: str) -> None:
        super().__delattr__(name)
        if name in SETTERS:
            attribute_changed()

    def __del__(self) -> None:
        """Follow the clock no more; may be called again."""
        handle = self.__dict__.get("jump_handle")
        if handle is not None:
            handle.unregister()

    def lookup_transform(
        self, target_frame: str, source_frame: str, time: Time, timeout: Duration = NO_TIMEOUT
    ) -> TransformStamped:
        """
        Get the transform that carries data from ``source_frame`` into ``target_frame``.

        :param time: when.
        :param timeout: how long to wait until there is an answer; less if the context ends, or on Ctrl-C.
        :raises LookupException: a frame is unknown, or the tree contains a loop.
        :raises ConnectivityException: the frames are in different trees.
        :raises ExtrapolationException: a frame on the path has no data for the time.
        :raises InvalidArgumentException: a name is empty or begins with ``/``; this is not waited for.
        """
        if timeout is NO_TIMEOUT:
            return self.lookup_transform_core(target_frame, source_frame, time)
        if self.__is_replaced(*_CAN, "lookup_transform_core"):
            return lookup_transform_by_asking(self, target_frame, source_frame, time, timeout)
        return self.__block((target_frame, source_frame, time, None, None), timeout)

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

        Stamped with the target's time; otherwise as :meth:`lookup_transform`.
        """
        if timeout is NO_TIMEOUT:
            return self.lookup_transform_full_core(
                target_frame, target_time, source_frame, source_time, fixed_frame
            )
        if self.__is_replaced(*_CAN_FULL, "lookup_transform_full_core"):
            return lookup_transform_full_by_asking(
                self, target_frame, target_time, source_frame, source_time, fixed_frame, timeout
            )
        return self.__block((target_frame, source_frame, source_time, fixed_frame, target_time), timeout)

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

        :param timeout: how long to wait until it would.
        :param return_debug_tuple: return the answer and the reason of a "no", which is empty for a "yes".
        """
        if timeout is not NO_TIMEOUT:
            if self.__is_replaced("can_transform_core"):
                ask = partial(self.can_transform_core, target_frame, source_frame, time)
                wait_until(lambda: ask()[0], duration_ns(timeout), aliveness(self.__context()))
            elif self.__becomes_available((target_frame, source_frame, time, None, None), timeout):
                return (True, "") if return_debug_tuple else True
        can, reason = self.can_transform_core(target_frame, source_frame, time)
        return (bool(can), reason) if return_debug_tuple else bool(can)

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
        if timeout is not NO_TIMEOUT:
            if self.__is_replaced("can_transform_full_core"):
                ask = partial(
                    self.can_transform_full_core,
                    target_frame,
                    target_time,
                    source_frame,
                    source_time,
                    fixed_frame,
                )
                wait_until(lambda: ask()[0], duration_ns(timeout), aliveness(self.__context()))
            elif self.__becomes_available(
                (target_frame, source_frame, source_time, fixed_frame, target_time), timeout
            ):
                return (True, "") if return_debug_tuple else True
        can, reason = self.can_transform_full_core(
            target_frame, target_time, source_frame, source_time, fixed_frame
        )
        return (bool(can), reason) if return_debug_tuple else bool(can)

    def wait_for_transform_async(
        self, target_frame: str, source_frame: str, time: Time, *, timeout: Duration | None = None
    ) -> Future:
        """
        Get a future of what :meth:`lookup_transform` will answer.

        :param timeout: when to end the future with a ``TimeoutException`` that tells the reason. None: never.

        The thread that inserts the missing transform completes the future. Its callbacks run in that thread,
        too, but those that a listener's thread would run, and those of a timeout, in the executor that spins
        the listener's node; where there is none, or it never had one, in a thread for callbacks. A name that
        can never be looked up ends it at once, with an ``InvalidArgumentException``.
        """
        if self.__is_replaced(*_CAN, *_LOOKUP):
            arguments = (target_frame, source_frame, time)
            return AskingFuture(
                self,
                partial(self.can_transform_core, *arguments),
                partial(self.lookup_transform, *arguments),
                timeout_ns(timeout),
            )
        return TransformFuture(self, (target_frame, source_frame, time, None, None), timeout)

    def wait_for_transform_full_async(
        self,
        target_frame: str,
        target_time: Time,
        source_frame: str,
        source_time: Time,
        fixed_frame: str,
        *,
        timeout: Duration | None = None,
    ) -> Future:
        """Get a future of what :meth:`lookup_transform_full` will answer; see the simple one."""
        if self.__is_replaced(*_CAN_FULL, *_LOOKUP_FULL):
            arguments = (target_frame, target_time, source_frame, source_time, fixed_frame)
            return AskingFuture(
                self,
                partial(self.can_transform_full_core, *arguments),
                partial(self.lookup_transform_full_core, *arguments),
                timeout_ns(timeout),
            )
        lookup = (target_frame, source_frame, source_time, fixed_frame, target_time)
        return TransformFuture(self, lookup, timeout)

    async def lookup_transform_async(
        self, target_frame: str, source_frame: str, time: Time, *, timeout: Duration | None = None
    ) -> TransformStamped:
        """
        Await the transform that carries data from ``source_frame`` into ``target_frame``.

        :param timeout: how long. None: for ever.
        :raises TimeoutException: it did not come in time; the text tells the reason.
        :raises InvalidArgumentException: a name is empty or begins with ``/``.
        """
        answer = await self.wait_for_transform_async(target_frame, source_frame, time, timeout=timeout)
        return self.__renewed(answer, self.lookup_transform_core, target_frame, source_frame, time)

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
        answer = await self.wait_for_transform_full_async(
            target_frame, target_time, source_frame, source_time, fixed_frame, timeout=timeout
        )
        return self.__renewed(
            answer,
            self.lookup_transform_full_core,
            target_frame,
            target_time,
            source_frame,
            source_time,
            fixed_frame,
        )

    def time_jump_callback(self, time_jump: TimeJump | None) -> None:
        """Forget what was known before the clock jumped, and warn of it."""
        if time_jump is None:
            happened = "Detected jump back in time"
        elif time_jump.clock_change == ClockChange.ROS_TIME_ACTIVATED:
            happened = "Simulated time was switched on"
        elif time_jump.clock_change == ClockChange.ROS_TIME_DEACTIVATED:
            happened = "Simulated time was switched off"
        else:
            happened = f"Detected jump back in time by {-time_jump.delta.nanoseconds / 1e9:.3f} s"
        get_logger("tf2_buffer").warning(f"{happened}. Clearing TF buffer.")
        self.clear()

    @classmethod
    def __replaces(cls, *names: str) -> bool:
        return any(getattr(cls, name) is not _ORIGINALS[name] for name in names)

    def __is_replaced(self, *names: str) -> bool:
        """Whether a subclass, or anybody since, put something else in the place of one of these methods."""
        own = self.__dict__
        return self.__replaces(*names) or any(name in own for name in names)

    def __context(self) -> Context:
        return self._node_context or get_default_context()

    def __block(self, lookup: Lookup, timeout: Duration) -> TransformStamped:
        return block(self, lookup, duration_ns(timeout), self.__context())

    def __becomes_available(self, lookup: Lookup, timeout: Duration) -> bool:
        try:
            self.__block(lookup, timeout)
        except TransformException:
            return False
        return True

    @staticmethod
    def __renewed(
        answer: TransformStamped, look_up: Callable[..., TransformStamped], *arguments: Any
    ) -> TransformStamped:
        """The answer as of now: "latest" may have moved on since the future was completed."""
        try:
            return look_up(*arguments)
        except TransformException:
            return answer  # forgotten meanwhile

    def __get_frames(self, req: Any, res: Any) -> Any:
        res.frame_yaml = self.all_frames_as_yaml()
        return res

    # A program's own set_transform calls these, as tf2's does.

    def _call_new_data_callbacks(self) -> None:
        for callback in list(self._new_data_callbacks):
            callback()

    def _remove_callback(self, callback: Callable[[], Any]) -> None:
        if callback in self._new_data_callbacks:
            self._new_data_callbacks.remove(callback)


# What the waits ask, in tf2's own order.
_CAN = ("can_transform", "can_transform_core")
_LOOKUP = ("lookup_transform", "lookup_transform_core")
_CAN_FULL = ("can_transform_full", "can_transform_full_core")
_LOOKUP_FULL = ("lookup_transform_full", "lookup_transform_full_core")
_ORIGINALS = {name: getattr(Buffer, name) for name in (*_CAN, *_LOOKUP, *_CAN_FULL, *_LOOKUP_FULL)}


def _forget_at_jumps(buffer: Buffer) -> JumpHandle:
    # The clock keeps a bare pointer to the handle and must be told when it goes, and the handle must not keep
    # the buffer from going.
    reference = weakref.ref(buffer)

    def on_jump(time_jump: TimeJump) -> None:
        jumping = reference()
        if jumping is None:
            return
        jumping.time_jump_callback(time_jump)
        if time_jump.clock_change == ClockChange.ROS_TIME_NO_CHANGE:
            # Transforms may have arrived before the executor had seen /clock.
            replay(jumping, jumping.clock.now().nanoseconds)

    threshold = JumpThreshold(min_forward=None, min_backward=JUMP_BACK, on_clock_change=True)
    handle = buffer.clock.create_jump_callback(threshold, post_callback=on_jump)
    weakref.finalize(buffer, handle.unregister).atexit = False
    return handle
