"""Owns the buffer that a node uses: the engine, waiting for it, its service and its clock."""

import weakref
from typing import Any

from geometry_msgs.msg import TransformStamped
from rclpy.clock import Clock, ClockChange, JumpHandle, JumpThreshold, TimeJump
from rclpy.duration import Duration
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.service import Service
from rclpy.task import Future
from rclpy.time import Time
from rclpy.utilities import get_default_context

from tf2_msgs.srv import FrameGraph
from tf2_py import BufferCore, TransformException
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
from tf2_ros._waiting import Lookup, TransformFuture, block, duration_ns
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


class Buffer(BufferCore, BufferInterface):
    """
    A buffer of transforms that can be waited for.

    :param cache_time: how far each frame's history reaches back. Default 10 s.
    :param node: offer the service ``tf2_frames`` and follow the clock of this node.

    It is emptied when its clock jumps back by 1 s or more, and when simulated time is switched on or off.
    Every ``time`` is anything with ``nanoseconds``, or with ``sec`` and ``nanosec``; 0 is the latest time
    that all frames on the path know. Every ``timeout`` is steady time, under simulated time, too.
    """

    def __init__(self, cache_time: Duration | None = None, node: Node | None = None) -> None:
        BufferCore.__init__(self, cache_time)
        BufferInterface.__init__(self)
        self._cache_time_ns = DEFAULT_CACHE_TIME_NS if cache_time is None else duration_ns(cache_time)
        self._node_context = None if node is None else node.context
        self.srv: Service | None = None
        self.clock: Clock = Clock() if node is None else node.get_clock()
        if node is not None:
            self.srv = node.create_service(FrameGraph, "tf2_frames", self._answer_frames)
        self.jump_handle = _forget_at_jumps(self)

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
        return self._block((target_frame, source_frame, time, None, None), timeout)

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
        return self._block((target_frame, source_frame, source_time, fixed_frame, target_time), timeout)

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
        if timeout is not NO_TIMEOUT and self._comes((target_frame, source_frame, time, None, None), timeout):
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
        if timeout is not NO_TIMEOUT and self._comes(
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

        The thread that inserts the missing transform completes the future and runs its callbacks, unless it
        belongs to an executor. A name that can never be looked up ends it at once, with an
        ``InvalidArgumentException``.
        """
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
        return await self.wait_for_transform_async(target_frame, source_frame, time, timeout=timeout)

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
        return await self.wait_for_transform_full_async(
            target_frame, target_time, source_frame, source_time, fixed_frame, timeout=timeout
        )

    def time_jump_callback(self, time_jump: TimeJump) -> None:
        """Forget what was known before the clock jumped, and warn of it."""
        if time_jump.clock_change == ClockChange.ROS_TIME_ACTIVATED:
            happened = "Simulated time was switched on"
        elif time_jump.clock_change == ClockChange.ROS_TIME_DEACTIVATED:
            happened = "Simulated time was switched off"
        else:
            happened = f"Detected jump back in time by {-time_jump.delta.nanoseconds / 1e9:.3f} s"
        get_logger("tf2_buffer").warning(f"{happened}. Clearing TF buffer.")
        self.clear()

    def _block(self, lookup: Lookup, timeout: Duration) -> TransformStamped:
        return block(self, lookup, duration_ns(timeout), self._node_context or get_default_context())

    def _comes(self, lookup: Lookup, timeout: Duration) -> bool:
        try:
            self._block(lookup, timeout)
        except TransformException:
            return False
        return True

    def _answer_frames(self, request: Any, response: Any) -> Any:
        response.frame_yaml = self.all_frames_as_yaml()
        return response


def _forget_at_jumps(buffer: Buffer) -> JumpHandle:
    # The clock keeps a bare pointer to the handle and must be told when it goes, and the handle must not keep
    # the buffer from going.
    reference = weakref.ref(buffer)

    def on_jump(time_jump: TimeJump) -> None:
        jumping = reference()
        if jumping is not None:
            jumping.time_jump_callback(time_jump)

    threshold = JumpThreshold(min_forward=None, min_backward=JUMP_BACK, on_clock_change=True)
    handle = buffer.clock.create_jump_callback(threshold, post_callback=on_jump)
    weakref.finalize(buffer, handle.unregister).atexit = False
    return handle
