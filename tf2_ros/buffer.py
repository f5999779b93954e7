"""Owns the buffer that a node uses: a BufferCore that can be waited for, with a service and a clock."""

import sys
from functools import partial
from typing import TYPE_CHECKING, Any, Literal, overload

from tf2_py import BufferCore, TransformException
from tf2_py._internal import log, timeout_ns
from tf2_py.typing import TimeLike, TimeoutLike
from tf2_ros._arguments import has, is_duration, refuse_swapped
from tf2_ros._messages import TransformStamped
from tf2_ros._replaced import lookup_transform_full_via_can, lookup_transform_via_can
from tf2_ros._tf2_names import (
    Callable,
    FrameGraphSrvRequest,
    FrameGraphSrvResponse,
    List,
    Optional,
    Tuple,
    TypeVar,
    sleep,
    tf2,
    tf2_ros,
    threading,
)
from tf2_ros._travel import without_node
from tf2_ros._wait.blocking import BlockingWait
from tf2_ros._wait.lookup import Lookup
from tf2_ros.buffer_interface import NO_TIMEOUT, BufferInterface
from tf2_ros_cython._presence import HAS_ROS, absence

if TYPE_CHECKING or HAS_ROS:
    from rclpy.clock import Clock, JumpHandle, JumpThreshold, TimeJump
    from rclpy.duration import Duration
    from rclpy.node import Node
    from rclpy.service import Service
    from rclpy.task import Future
    from rclpy.time import Time

    from tf2_msgs.srv import FrameGraph
    from tf2_ros._clock_jumps import clear_at_jumps, jump_text
    from tf2_ros._receive.receiver_thread import attribute_changed
    from tf2_ros._tf2_names import rclpy
    from tf2_ros._wait.contexts import WaitContexts, fills
    from tf2_ros._wait.rechecking_future import RecheckingFuture
    from tf2_ros._wait.transform_future import TransformFuture
    from tf2_ros._wait.waking_future import WakingFuture
else:
    from tf2_ros._without_ros import (
        RecheckingFuture,
        TransformFuture,
        attribute_changed,
        jump_text,
        leave_out_ros,
    )

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

# The methods that insert transforms.
SETTERS = frozenset({"set_transform", "set_transform_static", "set_transforms", "set_transforms_cdr"})

# Setting one of these may change who inserts what listeners receive.
_DECIDING = SETTERS | {"__class__"}


if TYPE_CHECKING or sys.platform == "linux":
    from tf2_ros._shared.sharing import Sharing, attached_buffer, shared_buffer
else:
    from tf2_ros._shared.absence import attached_buffer, shared_buffer


class Buffer(BufferCore, BufferInterface):
    """
    A buffer of transforms that can be waited for.

    :param cache_time: how far each frame's history reaches back from its latest sample: a duration, or a
        number, which is seconds. None: 10 s.
    :param node: offer the service ``tf2_frames`` and follow the clock of this node. None: the buffer has a
        clock of its own, and no service.
    :param max_frames: see :class:`tf2_py.BufferCore`, also for ``max_bytes`` and ``max_waiters``.
    :param share: a name by which other processes of this user on this machine may attach to the buffer, until
        it or this process ends; ``auto`` is the name that belongs to the ROS domain.
    :param attach: the name of a buffer that another process shares: this one holds what that one holds, and
        as much history. The first insert, ``clear()`` or loaded state makes it an ordinary buffer, with a
        copy; so does the end of the other process, once something waits or a listener exists.
    :raises TypeError: ``cache_time`` is neither, a limit no int, or a name no str.
    :raises ValueError: ``cache_time`` is negative, a limit not above 0, a name invalid, or both ``share`` and
        ``attach`` are given.
    :raises SharedBufferError: another process shares a buffer of this name, or none does that could be
        attached to. It is a ``RuntimeError``.
    :raises NotImplementedError: buffers are shared on Linux alone.

    It is cleared when its clock jumps back by 1 s or more, and when simulated time is switched on or off.
    Every ``time`` is an rclpy ``Time``, a time message, an object with their attributes, an integer, which is
    nanoseconds, or a ``numpy.datetime64``; 0 is the latest time for which all frames on the path have data.
    Every ``timeout`` is an rclpy ``Duration``, a duration message, or a number, which is seconds; it counts
    steady time, also while time is simulated. NaT and NaN are a ``ValueError``. Translations are in metres,
    rotations are unit quaternions.

    With ``TF2_DEBUG=1`` in the environment when this module is imported, a wait for a transform logs
    after one second, and after ten, what it lacks; not those by methods that a program has replaced.

    >>> from rclpy.time import Time
    >>> from tf2_ros import Buffer
    >>> from geometry_msgs.msg import TransformStamped
    >>> mount = TransformStamped(child_frame_id="camera")
    >>> mount.header.frame_id, mount.transform.translation.x = "base_link", 0.3
    >>> buffer = Buffer()  # a TransformListener fills it; here, this program does
    >>> buffer.set_transform_static(mount, "example")
    >>> buffer.lookup_transform("base_link", "camera", Time()).transform.translation.x
    0.3
    """

    _sharing: "Sharing | None" = None  # what shares it, or has it attached

    def __init__(
        self,
        cache_time: TimeoutLike | None = None,
        node: "Node | None" = None,
        *,
        max_frames: int | None = None,
        max_bytes: int | None = None,
        max_waiters: int | None = None,
        share: str | None = None,
        attach: str | None = None,
    ) -> None:
        refuse_swapped("Buffer", cache_time=(is_duration, cache_time), node=(has("create_service"), node))
        BufferCore.__init__(
            self, cache_time, max_frames=max_frames, max_bytes=max_bytes, max_waiters=max_waiters
        )
        self._sharing = None
        if share is not None and attach is not None:
            raise ValueError("a buffer either shares what it holds, or is attached to one that does")
        if share is not None:
            self._sharing = shared_buffer(self, share, node)
        if attach is not None:
            self._sharing = attached_buffer(self, attach, node)
        self.__connect(node)

    def __connect(self, node: "Node | None") -> None:
        BufferInterface.__init__(self)
        if HAS_ROS:
            self.__begin_in_ros(node)
        elif node is not None:
            raise absence("a buffer with a node")

    def __begin_in_ros(self, node: "Node | None") -> None:
        self._wait_contexts = WaitContexts()
        fills(node, self)
        self.srv: Service | None = None
        self.clock: Clock = Clock() if node is None else node.get_clock()
        if node is not None:
            self.srv = node.create_service(FrameGraph, "tf2_frames", self.__get_frames)
        if "jump_handle" in self.__dict__:
            self.jump_handle.unregister()  # __init__ was called again
        self.jump_handle: JumpHandle = clear_at_jumps(self)

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        # A lookup calls what a subclass replaced. Decided here, and not at each lookup.
        if cls.__replaces(*_CAN) and cls.lookup_transform is Buffer.lookup_transform:
            cls.lookup_transform = lookup_transform_via_can  # type: ignore[method-assign]
        if cls.__replaces(*_CAN_FULL) and cls.lookup_transform_full is Buffer.lookup_transform_full:
            cls.lookup_transform_full = lookup_transform_full_via_can  # type: ignore[method-assign]

    def __setattr__(self, name: str, value: Any) -> None:
        super().__setattr__(name, value)
        if name in _DECIDING:
            attribute_changed()

    def __delattr__(self, name: str) -> None:
        super().__delattr__(name)
        if name in _DECIDING:
            attribute_changed()

    def __getstate__(self) -> dict[str, Any]:
        """
        What a pickle or copy of this buffer is made of: as of ``BufferCore``, without what belongs to a node.

        The copy has a clock of its own, and no service. Attributes that are nodes or listeners do not travel.
        Where there are any, or a service, a ``UserWarning`` says so.
        """
        state = super().__getstate__()
        state["attributes"] = without_node(state["attributes"], type(self).__name__)
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Become the buffer that such a state says, as of ``BufferCore``; a node of this one stays."""
        super().__setstate__(state)
        if "registration" not in self.__dict__:
            self.__connect(None)

    def __del__(self) -> None:
        """Stop following the clock; may be called again."""
        handle = self.__dict__.get("jump_handle")
        if handle is not None:
            handle.unregister()

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
        :param time: of the transform; 0 is the latest time for which all frames on the path have data. An int
            is nanoseconds.
        :param timeout: how long to wait until there is an answer. A number is seconds. Ctrl-C ends the wait,
            and so does the shutdown of the contexts of the buffer's node and listeners, also one before the
            wait; without either, that of the default context during the wait. Zero or negative: do not wait.
        :return: a ``TransformStamped`` from ``target_frame`` (its ``header.frame_id``) to ``source_frame``
            (its ``child_frame_id``), stamped with ``time``, or with the latest time if that is 0.
        :raises LookupException: a frame is unknown, or the tree contains a loop.
        :raises ConnectivityException: the frames are in different trees.
        :raises ExtrapolationException: a frame on the path has no data for the time.
        :raises InvalidArgumentException: a name is empty or begins with ``/``; this is not waited for.
        :raises TypeError: a name is no str, ``time`` is no time, or ``timeout`` no timeout.

        After a wait, the text of an error also says how long was waited, or that the shutdown ended the wait.

        >>> buffer.lookup_transform("base_link", "camera", 1_000_000_000, timeout=0.5).header.stamp.sec
        1
        """
        if timeout is NO_TIMEOUT:
            return self.lookup_transform_core(target_frame, source_frame, time)
        if self.__is_replaced(*_CAN, "lookup_transform_core"):
            return lookup_transform_via_can(self, target_frame, source_frame, time, timeout)
        return self.__begin_wait(timeout).for_answer(Lookup.simple(target_frame, source_frame, time))

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
        :param target_time: the time in ``target_frame``; 0 is the latest time for which all frames on the
            path between it and ``fixed_frame`` have data.
        :param source_frame: the frame that the data is in.
        :param source_time: the time of the data; 0 likewise, for the path between it and ``fixed_frame``.
        :param fixed_frame: a frame that does not move between the two times.
        :param timeout: as of :meth:`lookup_transform`.

        It is stamped with the target's time, and raises what :meth:`lookup_transform` raises.
        """
        if timeout is NO_TIMEOUT:
            return self.lookup_transform_full_core(
                target_frame, target_time, source_frame, source_time, fixed_frame
            )
        if self.__is_replaced(*_CAN_FULL, "lookup_transform_full_core"):
            return lookup_transform_full_via_can(
                self, target_frame, target_time, source_frame, source_time, fixed_frame, timeout
            )
        lookup = Lookup(target_frame, target_time, source_frame, source_time, fixed_frame)
        return self.__begin_wait(timeout).for_answer(lookup)

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

        :param target_frame: as of that method, like ``source_frame`` and ``time``.
        :param timeout: how long to wait until it would.
        :param return_debug_tuple: return a tuple of the answer and the reason why not, which is empty where
            it would.
        :raises TypeError: as that method; it raises nothing else.
        """
        wait = None
        if timeout is not NO_TIMEOUT:
            wait = self.__begin_wait(timeout)
            if self.__is_replaced("can_transform_core"):
                can_now = partial(self.can_transform_core, target_frame, source_frame, time)
                wait.poll(lambda: can_now()[0])
            elif self.__becomes_available(wait, Lookup.simple(target_frame, source_frame, time)):
                return (True, "") if return_debug_tuple else True
        can, reason = self.can_transform_core(target_frame, source_frame, time)
        return _answer(can, reason, wait) if return_debug_tuple else bool(can)

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

        :param target_frame: as of that method, like all but the last two, which are those of
            :meth:`can_transform`.
        """
        wait = None
        if timeout is not NO_TIMEOUT:
            wait = self.__begin_wait(timeout)
            if self.__is_replaced("can_transform_full_core"):
                can_now = partial(
                    self.can_transform_full_core,
                    target_frame,
                    target_time,
                    source_frame,
                    source_time,
                    fixed_frame,
                )
                wait.poll(lambda: can_now()[0])
            elif self.__becomes_available(
                wait, Lookup(target_frame, target_time, source_frame, source_time, fixed_frame)
            ):
                return (True, "") if return_debug_tuple else True
        can, reason = self.can_transform_full_core(
            target_frame, target_time, source_frame, source_time, fixed_frame
        )
        return _answer(can, reason, wait) if return_debug_tuple else bool(can)

    def wait_for_transform_async(
        self, target_frame: str, source_frame: str, time: TimeLike, *, timeout: TimeoutLike | None = None
    ) -> "WakingFuture[TransformStamped]":
        """
        Get a future of what :meth:`lookup_transform` will return: the pose of ``source_frame`` in
        ``target_frame``. Without ``timeout`` it waits for ever.

        :param target_frame: as of that method, like ``source_frame`` and ``time``.
        :param timeout: after which the future holds a ``TimeoutException`` with the reason. None: never.
        :raises TypeError: as that method.

        The thread that inserts the missing transform completes the future, and runs its callbacks. Callbacks
        that a listener's thread would run, and those of a timeout, run in the executor that spins the
        listener's node; where there is none, or it never had one, in a thread for callbacks. With an invalid
        name the future holds an ``InvalidArgumentException`` at once.
        """
        if self.__is_replaced(*_CAN, *_LOOKUP):
            arguments = (target_frame, source_frame, time)
            return RecheckingFuture(
                self,
                partial(self.can_transform_core, *arguments),
                partial(self.lookup_transform, *arguments),
                timeout,
            )
        return TransformFuture(self, Lookup.simple(target_frame, source_frame, time), timeout)

    def wait_for_transform_full_async(
        self,
        target_frame: str,
        target_time: TimeLike,
        source_frame: str,
        source_time: TimeLike,
        fixed_frame: str,
        *,
        timeout: TimeoutLike | None = None,
    ) -> "WakingFuture[TransformStamped]":
        """
        Get a future of what :meth:`lookup_transform_full` will return. Without ``timeout`` it waits for ever.

        :param target_frame: as of that method, like all but ``timeout``.
        :param timeout: as of :meth:`wait_for_transform_async`, which is the same for a simple lookup.
        """
        if self.__is_replaced(*_CAN_FULL, *_LOOKUP_FULL):
            arguments = (target_frame, target_time, source_frame, source_time, fixed_frame)
            return RecheckingFuture(
                self,
                partial(self.can_transform_full_core, *arguments),
                partial(self.lookup_transform_full_core, *arguments),
                timeout,
            )
        lookup = Lookup(target_frame, target_time, source_frame, source_time, fixed_frame)
        return TransformFuture(self, lookup, timeout)

    async def lookup_transform_async(
        self, target_frame: str, source_frame: str, time: TimeLike, *, timeout: TimeoutLike | None = None
    ) -> TransformStamped:
        """
        Await what :meth:`lookup_transform` returns: the pose of ``source_frame`` in ``target_frame``, which
        carries data from the source to the target. Without ``timeout`` it waits for ever.

        :param target_frame: as of :meth:`lookup_transform`, like ``source_frame`` and ``time``.
        :param timeout: how long. None: until the context is shut down.
        :raises TimeoutException: it was not available in time, or not before the shutdown of the context; the
            text says which, and the reason.
        :raises InvalidArgumentException: a name is empty or begins with ``/``.
        :raises TypeError: as :meth:`lookup_transform`.

        A coroutine for asyncio and for rclpy's executors.
        """
        answer = await self.wait_for_transform_async(target_frame, source_frame, time, timeout=timeout)
        return self.__renewed(answer, self.lookup_transform_core, target_frame, source_frame, time)

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
        :param timeout: as of :meth:`lookup_transform_async`, which raises the same.
        """
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

    def time_jump_callback(self, time_jump: "TimeJump | None") -> None:
        """
        Clear the buffer, and log a warning.

        :param time_jump: of the clock. None: a jump back, for programs that call this themselves.
        """
        happened = "Detected jump back in time" if time_jump is None else jump_text(time_jump)
        if self._sharing is not None and self._sharing.clears_at_jumps(self.clock):
            return
        log.logger("tf2_buffer").warning(f"{happened}. Clearing TF buffer.")
        self.clear()

    @classmethod
    def __replaces(cls, *names: str) -> bool:
        return any(getattr(cls, name) is not _ORIGINALS[name] for name in names)

    def __is_replaced(self, *names: str) -> bool:
        """Whether a subclass, or a program later, replaced one of these methods."""
        own = self.__dict__
        return self.__replaces(*names) or any(name in own for name in names)

    def __begin_wait(self, timeout: TimeoutLike) -> BlockingWait:
        return BlockingWait(self, timeout_ns(timeout))

    def __becomes_available(self, wait: BlockingWait, lookup: Lookup) -> bool:
        try:
            wait.for_answer(lookup)
        except TransformException:
            return False
        return True

    @staticmethod
    def __renewed(
        answer: TransformStamped, look_up: Callable[..., TransformStamped], *arguments: Any
    ) -> TransformStamped:
        """The answer as of now: the latest time may have changed since the future was completed."""
        try:
            return look_up(*arguments)
        except TransformException:
            return answer  # the buffer has lost it meanwhile

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


def _answer(can: Any, reason: str, wait: BlockingWait | None) -> tuple[bool, str]:
    return bool(can), reason if can or wait is None else wait.told(reason)


# What the waits call, in tf2's own order.
_CAN = ("can_transform", "can_transform_core")
_LOOKUP = ("lookup_transform", "lookup_transform_core")
_CAN_FULL = ("can_transform_full", "can_transform_full_core")
_LOOKUP_FULL = ("lookup_transform_full", "lookup_transform_full_core")
_ORIGINALS = {name: getattr(Buffer, name) for name in (*_CAN, *_LOOKUP, *_CAN_FULL, *_LOOKUP_FULL)}


if not (TYPE_CHECKING or HAS_ROS):
    leave_out_ros(globals())
