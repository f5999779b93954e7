# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Look up and await transforms in a buffer with a clock and a service."""

import time
import weakref
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from os import PathLike
from threading import get_ident
from typing import TYPE_CHECKING, Any, TypeVar

import tf2_py as tf2
from tf2_py import BufferCore, TransformException
from tf2_py._internal import duration_ns, log, policy_of
from tf2_py.typing import DurationLike, DurationsLike, LookupPolicy, TimeLike, Unpack
from tf2_ros._arguments import kind_of, optional_timeout_ns, require_callable
from tf2_ros._buffer_clock import JUMP_BACK_NS, BufferClock
from tf2_ros._messages import TransformStamped
from tf2_ros._process.background import background, check_regularly
from tf2_ros._sources import BufferSource, Sources, add_node, add_source, silence_of
from tf2_ros._wait.changes_iterator import Changes
from tf2_ros._wait.futures import TransformFuture, WakingFuture, end_for
from tf2_ros._wait.lookup_or_wait import Lookup
from tf2_ros._wait.pending import ChangeSubscription
from tf2_ros.buffer_interface import NO_TIMEOUT, BufferInterface
from tf2_ros_cython._ros_presence import HAS_ROS, absence

if TYPE_CHECKING or HAS_ROS:
    from rclpy.clock import Clock, ClockChange, JumpHandle, JumpThreshold, TimeJump
    from rclpy.duration import Duration
    from rclpy.exceptions import InvalidHandle
    from rclpy.node import Node
    from rclpy.service import Service
    from rclpy.task import Future
    from rclpy.time import Time

    from tf2_msgs.srv import FrameGraph
    from tf2_ros._nodes.ended_nodes import require_node
    from tf2_ros._nodes.topic_publishers import clock_publishers
else:
    from tf2_ros._without_ros import Clock, InvalidHandle, names_that_need_ros

    __getattr__ = names_that_need_ros(__name__)

__all__ = [
    "Buffer",
    "Duration",
    "FrameGraphSrvRequest",
    "FrameGraphSrvResponse",
    "Future",
    "Node",
    "Time",
    "TransformStamped",
    "tf2",
]

FrameGraphSrvRequest = TypeVar("FrameGraphSrvRequest")
FrameGraphSrvResponse = TypeVar("FrameGraphSrvResponse")
_Opened = TypeVar("_Opened", bound="Buffer")

# The methods that insert transforms.
SETTERS = frozenset({"set_transform", "set_transform_static", "set_transforms", "set_transforms_cdr"})

# What the warning of a jump says of a switch between clocks, by rclpy's name for it.
SWITCHES = {
    "ROS_TIME_ACTIVATED": "Simulated time was switched on",
    "ROS_TIME_DEACTIVATED": "Simulated time was switched off",
}

# What belongs to one buffer; a copy has its own.
_OF_INIT = frozenset(
    "registration _tf2_kept _tf2_sources srv jump_handle _tf2_node _tf2_clock _tf2_cleared_for".split()
)


class Buffer(BufferCore, BufferInterface):
    """
    A history of recent transforms that answers where one frame is relative to another.

    A :class:`TransformListener` fills it; lookups can wait for what has not arrived yet.

    :param cache_time: how far each frame's history reaches back from its newest sample. None: 10 s.
    :param node: offer the service ``tf2_frames`` and follow the clock of this node. None: the buffer has its
        own clock, and no service. :meth:`open` accepts a node, too.
    :param max_frames: the maximum number of frames. None: a million.
    :param max_bytes: the maximum memory for names and histories. None: 1 GiB.
    :raises TypeError: ``cache_time`` is not a duration or a number, or a limit is not an int.
    :raises ValueError: ``cache_time`` is negative, or a limit is not above 0.

    The buffer is cleared when simulated time jumps back by 1 s or more, or is switched on or off. It is also
    cleared if a listener or a source fills it, and a lookup with ``max_age``,
    :meth:`~tf2_py.BufferCore.ages` or :meth:`~tf2_py.BufferCore.explain` finds that another clock was set
    back by 1 s or more. Translations are in meters, rotations are unit quaternions.

    Every ``time`` is a :data:`~tf2_py.typing.TimeLike`: an rclpy ``Time``, a time message, an int in
    nanoseconds, or a ``numpy.datetime64``. 0 is the latest time for which all frames on the path have data.
    Every ``timeout``, ``cache_time`` or other duration is a :data:`~tf2_py.typing.DurationLike`: an rclpy
    ``Duration``, a duration message, a ``timedelta``, or a number of seconds. Timeouts count steady time,
    also while time is simulated. NaT and NaN raise a ``ValueError``.

    Every ``policy`` stands for these options, which are keyword arguments of lookups;
    :class:`tf2_py.typing.LookupPolicy` describes them:

    - ``tolerance``: frames may be this far behind the time, and then stay at their newest sample. A duration,
      or a mapping of frames to durations.
    - ``extrapolate``: such frames continue at the velocity of their last two samples instead. A bool.
    - ``max_gap``: samples that are further apart have no answer between them. A duration.
    - ``max_age``: the latest transform may be this old on the clock of the buffer. As ``tolerance``.

    A pickle or copy has its own clock, unless the buffer has none, and no service.

    Ctrl-C ends a blocking lookup, and so does shutting down the contexts of the buffer's node and listeners,
    or, without these, the default context.

    >>> from rclpy.time import Time
    >>> from tf2_ros import Buffer
    >>> from geometry_msgs.msg import TransformStamped
    >>> mount = TransformStamped(child_frame_id="camera")
    >>> mount.header.frame_id = "base_link"
    >>> mount.transform.translation.x = 0.3
    >>> buffer = Buffer()  # a TransformListener fills it; here, this program does
    >>> buffer.set_transform_static(mount, "example")
    >>> buffer.lookup_transform("base_link", "camera", Time()).transform.translation.x
    0.3
    """

    _tf2_node: "weakref.ref[Node] | None" = None  # whose clock it follows
    _tf2_clock: BufferClock | None = None
    _tf2_cleared_for = 0  # in which thread time_jump_callback need not clear

    def __init__(
        self,
        cache_time: DurationLike | None = None,
        node: "Node | None" = None,
        *,
        max_frames: int | None = None,
        max_bytes: int | None = None,
    ) -> None:
        if hasattr(cache_time, "create_service"):
            raise TypeError("Buffer: cache_time comes first: pass the node as Buffer(node=node)")
        if node is not None:
            _check_node(node)
        BufferCore.__init__(self, cache_time, max_frames=max_frames, max_bytes=max_bytes)
        self.__connect(node)

    @classmethod
    def open(cls: type[_Opened], path: str | PathLike[str], *, node: "Node | None" = None) -> _Opened:
        """
        Open a buffer that :meth:`~tf2_py.BufferCore.freeze` wrote; its answers are identical to the last bit.

        The samples stay in the file, which is mapped into memory, so that all processes that open it share
        them. It behaves like any other buffer: the first insert into a frame copies the samples of this
        frame into memory of the process, and ``max_bytes`` limits only such memory. A pickle or copy of an
        unchanged buffer opens the same file. ``__init__`` is not called.

        The whole file is checked first, with its checksums: 10 million samples in 0.3 to 0.5 s. Unpickling
        does not check the samples again unless the file has changed since.

        :param path: the file. It must not be written to while it is mapped: if it shrinks, the process is
            killed by SIGBUS. Replacing and deleting it are safe, except over a network.
        :raises TypeError: ``path`` is not a path.
        :raises FileNotFoundError, OSError: the file cannot be opened.
        :raises ValueError: the file is not a frozen buffer, has another version of the format, or is damaged;
            the text contains the file and, if possible, the frame and sample.
        """
        if node is not None:
            _check_node(node)
        opened = super().open(path)
        if node is not None:
            opened.jump_handle.unregister()
            opened.__connect(node)
        return opened

    @property
    def _tf2_kept(self) -> dict[Any, None]:
        """The waits that are awaited or have callbacks; this may be the only reference to them."""
        # Made at its first use, because a subclass need not call __init__.
        kept: dict[Any, None] = self.__dict__.setdefault("_tf2_kept", {})
        return kept

    def __connect(self, node: "Node | None") -> None:
        BufferInterface.__init__(self)
        self._tf2_sources = Sources()
        BufferCore._describe_silence_with(self, silence_of)  # that nothing fills it
        self.__follow(Clock() if node is None else node.get_clock(), reports_jumps=True)
        if not HAS_ROS:
            return
        add_node(node, self)
        self.srv: Service | None = None
        self._tf2_node = None if node is None else weakref.ref(node)
        if node is not None:
            self.srv = node.create_service(FrameGraph, "tf2_frames", self.__get_frames)
        self.jump_handle: JumpHandle = _clear_at_jumps(self)

    @property
    def clock(self) -> "Clock":
        """
        The clock by which ages are counted; None: ages are not known.

        Another object may be assigned whose ``now()`` returns a time. What it raises replaces the error of a
        lookup, or becomes the result of a wait with ``max_age`` that is being answered.
        """
        found: Any = None if self._tf2_clock is None else self._tf2_clock.clock
        return found  # a program may have assigned None, or a clock of its own

    @clock.setter
    def clock(self, clock: Any) -> None:
        self.__follow(clock, reports_jumps=False)

    def __follow(self, clock: Any, *, reports_jumps: bool) -> None:
        self._tf2_clock = None if clock is None else BufferClock(clock, reports_jumps)
        self._tf2_follow_clock(self._tf2_clock)

    def _tf2_attributes(self) -> dict[str, Any]:
        attributes = {name: value for name, value in self.__dict__.items() if name not in _OF_INIT}
        if "_tf2_clock" in self.__dict__ and self.clock is None:
            attributes["_tf2_clock"] = None
        return attributes

    def _tf2_restored(self) -> None:
        if "registration" not in self.__dict__:  # else this buffer keeps its node
            has_clock = "_tf2_clock" not in self.__dict__
            self.__connect(None)
            if not has_clock:
                self.clock = None

    def lookup_transform(
        self,
        target_frame: str,
        source_frame: str,
        time: TimeLike,
        timeout: DurationLike = NO_TIMEOUT,
        **policy: "Unpack[LookupPolicy]",
    ) -> TransformStamped:
        """
        Get the pose of ``source_frame`` in ``target_frame``, which converts data from source to target.

        A point at p in ``source_frame`` is at R p + t in ``target_frame``: R and t are the rotation and the
        translation returned. ``Time()``, which is 0, asks for the latest time for which all frames on the
        path have data. The default ``timeout`` does not wait.

        :param target_frame: the frame into which the data is to be transformed.
        :param source_frame: the frame that the data is in.
        :param time: the time; 0 is the latest time for which all frames on the path have data. An int
            is nanoseconds.
        :param timeout: how long to wait for an answer, in steady time. A number is seconds. Zero or negative:
            do not wait.
        :param policy: options such as ``tolerance``, see :class:`tf2_ros.Buffer`. A
            :class:`tf2_ros.BufferClient` accepts ``max_age``, as one duration.
        :return: a ``TransformStamped`` from ``target_frame`` (its ``header.frame_id``) to ``source_frame``
            (its ``child_frame_id``), stamped with ``time``, or with the latest time if that is 0. With a
            ``tolerance``, the stamp is the oldest at which a frame stays, unless ``extrapolate`` is set.
        :raises LookupException: a frame is unknown, or the tree contains a loop.
        :raises ConnectivityException: the frames are in different trees.
        :raises ExtrapolationException: a frame on the path has no data for the time, only data that is older
            than ``max_age``, or a gap that is longer than ``max_gap``.
        :raises InvalidArgumentException: a name is empty or begins with ``/``; raised without waiting.
        :raises TypeError: a name is not a str, ``time`` is not a time, or ``timeout`` is not a duration.
        :raises ValueError: a limit is negative, or of a frame that is unknown or not a child, or ``max_age``
            is given for a time that is not 0, or to a buffer without a clock.

        After a wait, the text of an error also says how long it took, or that a shutdown ended it.

        >>> buffer.lookup_transform("base_link", "camera", 1_000_000_000, timeout=0.5).header.stamp.sec
        1
        """
        # Keyword-only parameters would make this, the usual call, slower than `**policy` does.
        if timeout is NO_TIMEOUT and not policy:
            return self.lookup_transform_core(target_frame, source_frame, time)
        accepted = policy_of("lookup_transform", True, **policy) if policy else None
        timeout_ns = duration_ns(timeout, "timeout")
        # First this: mostly there is an answer, and preparing to wait takes eight times as long.
        found = self._tf2_look_up(target_frame, source_frame, time, None, None, accepted, timeout_ns > 0)
        if found is not None:
            return found
        return Lookup(target_frame, source_frame, time, policy=accepted).block(self, timeout_ns)

    def lookup_transform_full(
        self,
        target_frame: str,
        target_time: TimeLike,
        source_frame: str,
        source_time: TimeLike,
        fixed_frame: str,
        timeout: DurationLike = NO_TIMEOUT,
        **policy: "Unpack[LookupPolicy]",
    ) -> TransformStamped:
        """
        Get the pose of ``source_frame`` at ``source_time`` in ``target_frame`` at ``target_time``.

        It converts data from the source to the target: a point at p in ``source_frame`` at ``source_time`` is
        at R p + t in ``target_frame`` at ``target_time``, if ``fixed_frame`` does not move in between.
        ``Time()``, which is 0, means the latest time. The default ``timeout`` does not wait.

        The other arguments are those of :meth:`lookup_transform`, which raises the same.

        :param target_time: the time in ``target_frame``; 0 is the latest time for which all frames on the
            path between it and ``fixed_frame`` have data.
        :param source_time: the time of the data; 0 as above, for the path between it and ``fixed_frame``.
        :param fixed_frame: a frame that does not move between the two times.
        :return: a ``TransformStamped``, stamped with the target's time.
        """
        if timeout is NO_TIMEOUT and not policy:
            return self.lookup_transform_full_core(
                target_frame, target_time, source_frame, source_time, fixed_frame
            )
        accepted = policy_of("lookup_transform_full", True, **policy) if policy else None
        timeout_ns = duration_ns(timeout, "timeout")
        found = self._tf2_look_up(
            target_frame, source_frame, source_time, fixed_frame, target_time, accepted, timeout_ns > 0
        )
        if found is not None:
            return found
        lookup = Lookup(target_frame, source_frame, source_time, fixed_frame, target_time, accepted)
        return lookup.block(self, timeout_ns)

    if not TYPE_CHECKING:  # a checker knows the overloads of the base

        def can_transform(
            self,
            target_frame: str,
            source_frame: str,
            time: TimeLike,
            timeout: DurationLike = NO_TIMEOUT,
            return_debug_tuple: bool = False,
            **policy: "Unpack[LookupPolicy]",
        ) -> bool | tuple[bool, str]:
            """
            Return whether :meth:`lookup_transform` would return a pose, and not raise.

            ``Time()`` asks for the latest one. The default ``timeout`` does not wait.

            :param return_debug_tuple: return ``(True, "")`` or ``(False, reason)`` instead of a bool. The
                other arguments are those of :meth:`lookup_transform`.
            :raises TypeError: an argument has the wrong type.
            :raises ValueError: a name contains a NUL character, a time is NaT, or a limit in ``policy`` is
                invalid.
            :raises OverflowError: a time does not fit into a message.

            A frame that is unknown or has no data, or an invalid name, is not an error: the answer is False.

            >>> from tf2_ros import Buffer, Time
            >>> Buffer().can_transform("base_link", "camera", Time())
            False
            """
            if timeout is NO_TIMEOUT and not policy:
                if not return_debug_tuple:
                    return self._tf2_can_core(target_frame, source_frame, time)
                can, reason = self.can_transform_core(target_frame, source_frame, time)
                return bool(can), reason
            accepted = policy_of("can_transform", True, **policy) if policy else None
            timeout_ns = duration_ns(timeout, "timeout")
            can = self._tf2_can_look_up(target_frame, source_frame, time, None, None, accepted)
            if can or not (timeout_ns > 0 or return_debug_tuple):
                return (can, "") if return_debug_tuple else can
            lookup = Lookup(target_frame, source_frame, time, policy=accepted)
            return lookup.can(self, timeout_ns, return_debug_tuple)

        def can_transform_full(
            self,
            target_frame: str,
            target_time: TimeLike,
            source_frame: str,
            source_time: TimeLike,
            fixed_frame: str,
            timeout: DurationLike = NO_TIMEOUT,
            return_debug_tuple: bool = False,
            **policy: "Unpack[LookupPolicy]",
        ) -> bool | tuple[bool, str]:
            """
            Return whether :meth:`lookup_transform_full` would answer. The default ``timeout`` does not wait.

            :param return_debug_tuple: also return the reason, as :meth:`can_transform` does. The other
                arguments are those of :meth:`lookup_transform_full`.
            """
            arguments = target_frame, target_time, source_frame, source_time, fixed_frame
            if timeout is NO_TIMEOUT and not policy:
                if not return_debug_tuple:
                    return self._tf2_can_full_core(*arguments)
                can, reason = self.can_transform_full_core(*arguments)
                return bool(can), reason
            accepted = policy_of("can_transform_full", True, **policy) if policy else None
            timeout_ns = duration_ns(timeout, "timeout")
            lookup = Lookup(target_frame, source_frame, source_time, fixed_frame, target_time, accepted)
            can = self._tf2_can_look_up(*lookup)
            if can or not (timeout_ns > 0 or return_debug_tuple):
                return (can, "") if return_debug_tuple else can
            return lookup.can(self, timeout_ns, return_debug_tuple)

    def wait_for_transform_async(
        self,
        target_frame: str,
        source_frame: str,
        time: TimeLike,
        *,
        timeout: DurationLike | None = None,
        **policy: "Unpack[LookupPolicy]",
    ) -> "WakingFuture[TransformStamped]":
        """
        Get a future of what :meth:`lookup_transform` will return: the pose of ``source_frame`` in
        ``target_frame``. Without ``timeout`` it waits forever.

        :param target_frame: the frame into which the data is to be transformed.
        :param source_frame: the frame that the data is in.
        :param time: the time; 0 is the latest time for which all frames on the path have data.
        :param timeout: how long to wait; then the future holds a ``TimeoutException``. None: forever.
        :param policy: options such as ``tolerance``, see :class:`Buffer`.
        :return: a future that can also be awaited. Its result is a ``TransformStamped``, or the error of the
            lookup.
        :raises TypeError: a name is not a str, ``time`` is not a time, or ``timeout`` is not a duration.

        If a listener receives the transform, done callbacks run in the executor that spins the listener's
        node. **Until that node is spun, such a future stays queued, even past its timeout;** one without done
        callbacks is done at once. If this program inserts the transform, they run in the inserting thread.
        The page "Callbacks, threads and executors" of the documentation has all cases.

        With an invalid name, the future holds an ``InvalidArgumentException`` at once. With ``max_age``, the
        transform is fresh when it arrives; what :meth:`lookup_transform_async` returns is also fresh when the
        coroutine continues.
        """
        accepted = policy_of("wait_for_transform_async", True, **policy)
        return TransformFuture(self, Lookup(target_frame, source_frame, time, policy=accepted).wait, timeout)

    def wait_for_transform_full_async(
        self,
        target_frame: str,
        target_time: TimeLike,
        source_frame: str,
        source_time: TimeLike,
        fixed_frame: str,
        *,
        timeout: DurationLike | None = None,
        **policy: "Unpack[LookupPolicy]",
    ) -> "WakingFuture[TransformStamped]":
        """
        Get a future of what :meth:`lookup_transform_full` will return. Without ``timeout`` it waits forever.

        :param target_frame: the frame into which the data is to be transformed.
        :param target_time: the time in ``target_frame``; 0 is the latest time.
        :param source_frame: the frame that the data is in.
        :param source_time: the time of the data; 0 is the latest time.
        :param fixed_frame: a frame that does not move between the two times.
        :param timeout: how long to wait; then the future holds a ``TimeoutException``. None: forever.
        :param policy: options such as ``tolerance``, see :class:`Buffer`.
        :return: a future that can also be awaited. Its result is a ``TransformStamped``.

        :meth:`wait_for_transform_async` describes where callbacks run, and the errors.
        """
        accepted = policy_of("wait_for_transform_full_async", True, **policy)
        lookup = Lookup(target_frame, source_frame, source_time, fixed_frame, target_time, accepted)
        return TransformFuture(self, lookup.wait, timeout)

    async def lookup_transform_async(
        self,
        target_frame: str,
        source_frame: str,
        time: TimeLike,
        *,
        timeout: DurationLike | None = None,
        **policy: "Unpack[LookupPolicy]",
    ) -> TransformStamped:
        """
        Await what :meth:`lookup_transform` returns: the pose of ``source_frame`` in ``target_frame``, which
        converts data from the source to the target. Without ``timeout`` it waits forever.

        :param timeout: how long to wait, in steady time. None: until the context is shut down. The other
            arguments are those of :meth:`lookup_transform`.
        :raises TimeoutException: it was not available in time, or not before the shutdown of the context; the
            text says which, and the reason.
        :raises InvalidArgumentException: a name is empty or begins with ``/``.
        :raises TypeError: a name is not a str, ``time`` is not a time, or ``timeout`` is not a duration.

        This is a coroutine for asyncio and for rclpy's executors. Give a callback of rclpy that awaits it a
        ``ReentrantCallbackGroup``: in the node's default group, no other callback runs meanwhile.
        """
        accepted = policy_of("lookup_transform_async", True, **policy) if policy else None
        return await self.__answer(Lookup(target_frame, source_frame, time, policy=accepted), timeout)

    async def lookup_transform_full_async(
        self,
        target_frame: str,
        target_time: TimeLike,
        source_frame: str,
        source_time: TimeLike,
        fixed_frame: str,
        *,
        timeout: DurationLike | None = None,
        **policy: "Unpack[LookupPolicy]",
    ) -> TransformStamped:
        """
        Await what :meth:`lookup_transform_full` returns, with its arguments. Without ``timeout`` it waits
        forever. :meth:`lookup_transform_async` describes the rest, such as what it raises.
        """
        accepted = policy_of("lookup_transform_full_async", True, **policy) if policy else None
        lookup = Lookup(target_frame, source_frame, source_time, fixed_frame, target_time, accepted)
        return await self.__answer(lookup, timeout)

    def changes(
        self,
        target_frame: str,
        source_frame: str,
        *,
        max_age: DurationsLike | None = None,
        max_gap: DurationLike | None = None,
    ) -> "Changes":
        """
        Iterate over the latest transforms of ``source_frame`` in ``target_frame``, with ``async for``.

        :param target_frame: the frame in which the pose is wanted.
        :param source_frame: the frame whose pose is wanted.
        :param max_age: a duration, or a mapping of frames to durations. A transform is skipped if the newest
            sample of a moving frame on the path is older than this when the loop body would get it.
        :param max_gap: a duration; transforms between samples that are further apart are skipped.
        :return: an asynchronous iterator for asyncio and for rclpy's executors. It yields the present
            transform, if there is one, and then each new one: at another common time, or with another pose.
            So changes arrive at the rate of the moving frame on the path with the oldest data, one or two for
            each of its transforms. A slower loop body gets only the latest change. A transform that becomes
            too old does not count as a change. In asyncio, the iteration ends with the shutdown of the
            context.
        :raises TypeError: a limit is not a duration.
        :raises ValueError: a limit is negative. The iteration raises it for a limit of a frame that is
            unknown or not a child, or without a clock, as :meth:`lookup_transform` does.

        >>> async def follow(buffer):
        ...     async for transform in buffer.changes("map", "base_link"):
        ...         print(transform.header.stamp)
        """
        accepted = policy_of("changes", True, max_age=max_age, max_gap=max_gap)
        return Changes(self, target_frame, source_frame, accepted)

    def on_change(
        self,
        target_frame: str,
        source_frame: str,
        callback: "Callable[[TransformStamped], object]",
        *,
        max_age: DurationsLike | None = None,
        max_gap: DurationLike | None = None,
    ) -> "ChangeSubscription":
        """
        Call a function with each transform that :meth:`changes` yields.

        :param target_frame: the frame in which the pose is wanted.
        :param source_frame: the frame whose pose is wanted.
        :param callback: called with the transform, in the thread in which done callbacks of
            :meth:`wait_for_transform_async` run; never by two threads at once. If a transform is already
            available, ``callback`` runs before ``on_change`` returns. Exceptions that it raises are logged,
            and the calls continue.
        :param max_age: as in :meth:`changes`; judged when ``callback`` would be called.
        :param max_gap: as in :meth:`changes`.
        :return: a subscription, whose ``cancel()`` ends the calls. They also end with the buffer.
        :raises TypeError: ``callback`` cannot be called, or a limit is not a duration.
        :raises ValueError: as in :meth:`changes` and its iteration. After the return, such an error is
            logged, and ends the calls.
        """
        require_callable("on_change", callback)
        accepted = policy_of("on_change", True, max_age=max_age, max_gap=max_gap)
        if max_age is not None:
            check_regularly(self)
        begin = partial(BufferCore._wait, self, target_frame, source_frame, 0, policy=accepted)
        return ChangeSubscription(begin, callback, self._tf2_kept)

    def add_source(self, name: str, silence: "Callable[[bool], str] | None" = None) -> "BufferSource":
        """
        Register a source that fills this buffer instead of a listener, such as a connection of the program.

        :param name: the name of the source in error texts.
        :param silence: a function that an error calls to explain why data is missing. Its argument is True if
            a static transform may be missing, too. It returns a clause such as ``nothing has been received on
            /tf for 3 s``, which the error text then contains; or ``""``. None: errors explain nothing.
        :return: a source. If the buffer has no node, and nothing else fills it, its ``end(reason)`` ends
            blocking lookups, and in asyncio awaits and the iteration of :meth:`changes`.
        :raises TypeError: ``name`` is not a str, or ``silence`` cannot be called.

        >>> from tf2_ros import Buffer, TransformException
        >>> buffer = Buffer()
        >>> buffer.add_source("the simulator").end("it was closed")
        >>> try:
        ...     buffer.lookup_transform("map", "base_link", 0, timeout=10.0)
        ... except TransformException as error:
        ...     print(str(error).partition(",")[0])  # and how long the wait was
        the simulator has ended (it was closed)
        """
        if type(name) is not str:
            raise TypeError(f"name: expected a str, got {kind_of(name)}")
        if silence is not None:
            require_callable("add_source", silence)
        return add_source(self, name, silence)

    def _tf2_jumped_back(self) -> None:
        """React to a clock that was set back, which a reading of it has noticed in any thread."""
        if background.is_here():
            # Such code runs later, and until then, no old data may look fresh.
            hand_over = partial(end_for, self)
            BufferCore._tf2_clear(self, hand_over)
            hand_over(self.__call_after_clear)
        else:
            self.time_jump_callback(None)

    def __call_after_clear(self) -> None:
        """Call what a program may have overridden, in one of its threads; it clears nothing once more."""
        self._tf2_cleared_for = get_ident()
        try:
            self.time_jump_callback(None)
        finally:
            self._tf2_cleared_for = 0

    def time_jump_callback(self, time_jump: "TimeJump | None") -> None:
        """
        Clear the buffer, and log a warning.

        :param time_jump: how the clock jumped. None: back.
        """
        if self._tf2_cleared_for != get_ident() or type(self).clear is not BufferCore.clear:
            self.clear()  # first, because a log line takes time, in which old data would be used
        change = getattr(getattr(time_jump, "clock_change", None), "name", "")
        what = SWITCHES.get(change, "Detected jump back in time")
        log.logger("tf2_buffer").warning(f"{what}. Clearing TF buffer.")
        node = None if self._tf2_node is None else self._tf2_node()
        names = [] if node is None else clock_publishers(node)
        if len(names) > 1:
            text = f"/clock has {len(names)} publishers, {' and '.join(names)}"
            log.logger("tf2_buffer").warning(
                f"{text}: the clock jumps between their times, and each jump back clears the buffer"
            )

    async def __answer(self, lookup: Lookup, timeout: DurationLike | None) -> TransformStamped:
        """Await a lookup."""
        begin_ns = time.monotonic_ns()
        optional_timeout_ns(timeout)  # a wrong one is an error, even if nothing has to be awaited
        if (found := lookup.now(self, or_none=True)) is not None:
            return found
        while True:
            answer: TransformStamped = await TransformFuture(self, lookup.wait, timeout, begin_ns)
            if not lookup.is_latest():
                return answer
            try:
                return lookup.now(self)  # what is the latest when the coroutine goes on, as in tf2
            except TransformException:
                if not lookup.judges_age:
                    return answer  # the buffer has lost it meanwhile
                # It has become too old before this ran.

    def _tf2_check(self) -> None:
        """Judge the ages of waits by what the clock shows now, because not every clock reports jumps."""
        if self._tf2_clock is not None:
            BufferCore._tf2_clock_jumped(self, partial(end_for, self))

    def __get_frames(self, req: Any, res: Any) -> Any:
        res.frame_yaml = self.all_frames_as_yaml()
        return res

    # A program's own set_transform may call _call_new_data_callbacks, as tf2's does. Inserts need neither.

    def _call_new_data_callbacks(self) -> None:
        pass

    def _remove_callback(self, callback: Callable[[], Any]) -> None:
        pass


def _check_node(node: "Node") -> None:
    if not HAS_ROS:
        raise absence("a buffer with a node")
    require_node("Buffer", node, "create_service")


# A clock has only the addresses of its jump handles, and calls them. So each is kept until it is
# unregistered, even if a signal handler raises in the finalizer of its buffer.
_registered: "set[JumpHandle]" = set()


def _clear_at_jumps(buffer: Any) -> "JumpHandle":
    """
    Call a buffer's ``time_jump_callback`` when its clock jumps back, or when simulated time is switched.

    :return: a handle that ends this; the end of the buffer does so, too.
    """
    # The handle must not keep the buffer alive.
    reference = weakref.ref(buffer)

    def on_jump(time_jump: "TimeJump") -> None:
        jumping = reference()
        if jumping is None:
            return
        is_switched = time_jump.clock_change in (
            ClockChange.ROS_TIME_ACTIVATED,
            ClockChange.ROS_TIME_DEACTIVATED,
        )
        if is_switched or time_jump.delta <= back:
            jumping.time_jump_callback(time_jump)
        BufferCore._tf2_clock_jumped(jumping)

    # Waits that judge ages need to know of every step back.
    back = Duration(nanoseconds=-JUMP_BACK_NS)
    threshold = JumpThreshold(min_forward=None, min_backward=Duration(nanoseconds=-1), on_clock_change=True)
    handle = buffer.clock.create_jump_callback(threshold, post_callback=on_jump)
    _registered.add(handle)
    weakref.finalize(buffer, _unregister, handle).atexit = False
    return handle


def _unregister(handle: "JumpHandle") -> None:
    with suppress(InvalidHandle):  # an AsyncNode destroys its clock
        handle.unregister()
    _registered.discard(handle)
