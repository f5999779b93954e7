# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Transform objects with the lookups of any buffer."""

from typing import TYPE_CHECKING, Any, Literal, TypeVar, Union, overload

import tf2_py as tf2
from tf2_py import TransformException
from tf2_py.typing import DurationLike, LookupPolicy, TimeLike, Unpack
from tf2_ros._frame_prefix import source_of
from tf2_ros._messages import Header, PoseStamped, TransformStamped, time_msg
from tf2_ros._registration import (
    ConvertRegistration,
    TransformRegistration,
    TypeException,
    convert,
)
from tf2_ros_cython._ros_presence import HAS_ROS

if TYPE_CHECKING:
    from sensor_msgs.msg import PointCloud2
    from typing_extensions import TypeVar as _TypeVarWithDefault
if TYPE_CHECKING or HAS_ROS:
    from geometry_msgs.msg import PointStamped, PoseWithCovarianceStamped, Vector3Stamped
    from rclpy.duration import Duration
    from rclpy.time import Time
else:
    from tf2_ros._without_ros import names_that_need_ros

    __getattr__ = names_that_need_ros(__name__)

__all__ = [
    "BufferInterface",
    "ConvertRegistration",
    "Duration",
    "Header",
    "MsgStamped",
    "NotImplementedException",
    "PointStamped",
    "PoseStamped",
    "PoseWithCovarianceStamped",
    "PyKDLType",
    "Stamped",
    "Time",
    "TransformRegistration",
    "TransformStamped",
    "TransformableObject",
    "TransformableObjectType",
    "TypeException",
    "Vector3Stamped",
    "convert",
    "tf2",
]

PyKDLType = TypeVar("PyKDLType")
TransformableObjectType = TypeVar("TransformableObjectType")
if TYPE_CHECKING or HAS_ROS:
    # Unions of typing, as in tf2: programs use them as values. PointCloud2 is quoted because it loads slowly.
    MsgStamped = Union[PointStamped, PoseStamped, PoseWithCovarianceStamped, Vector3Stamped, "PointCloud2"]
    TransformableObject = Union[MsgStamped, PyKDLType]  # noqa: UP007

_Object = TypeVar("_Object")
if TYPE_CHECKING:
    # What a method returns without a `new_type`.
    _New = _TypeVarWithDefault("_New", default=_Object)
else:
    _New = TypeVar("_New")

# The default of every `timeout`. It is one object, so that a check for it need not compare Durations.
NO_TIMEOUT: DurationLike = Duration() if TYPE_CHECKING or HAS_ROS else 0.0


class NotImplementedException(Exception):
    """
    A buffer lacks the method that was called; the attribute ``errstr`` has a text about it.

    >>> from rclpy.time import Time
    >>> from tf2_ros import BufferInterface, NotImplementedException
    >>> try:
    ...     BufferInterface().lookup_transform("map", "odom", Time())
    ... except NotImplementedException as error:
    ...     print(error.errstr)
    CanTransform or LookupTransform not implemented
    """

    def __init__(self) -> None:
        self.errstr = "CanTransform or LookupTransform not implemented"
        super().__init__(self.errstr)


class BufferInterface:
    """
    What :class:`tf2_ros.Buffer` and :class:`tf2_ros.BufferClient` share.

    A subclass implements the lookups; a lookup that it does not implement raises a
    ``NotImplementedException``. All other methods use the lookups. The attribute ``registration`` is the
    table of functions that transform objects. For every ``time`` and ``timeout``, see
    :class:`tf2_ros.Buffer`.

    >>> from geometry_msgs.msg import PointStamped, TransformStamped
    >>> from tf2_ros import BufferInterface
    >>> class OneMeterAhead(BufferInterface):
    ...     def lookup_transform(self, target_frame, source_frame, time, timeout=None):
    ...         transform = TransformStamped(child_frame_id=source_frame)
    ...         transform.header.frame_id = target_frame
    ...         transform.transform.translation.x = 1.0
    ...         return transform
    >>> OneMeterAhead().transform(PointStamped(), "base_link").point.x
    1.0
    """

    def __init__(self) -> None:
        self.registration = TransformRegistration()

    def __del__(self) -> None:
        """Do nothing. Subclasses call this, as in tf2."""

    def transform(
        self,
        object_stamped: _Object,
        target_frame: str,
        timeout: DurationLike = NO_TIMEOUT,
        new_type: type[_New] | None = None,
        *,
        prefix: str = "",
        **policy: "Unpack[LookupPolicy]",
    ) -> _New:
        """
        Transform an object into another frame, at the object's own time. The result describes the same place,
        as seen from that frame. The default ``timeout`` does not wait.

        :param object_stamped: an object with a ``header``, of a registered type. If its stamp is 0, the
            latest transform is used.
        :param target_frame: the frame into which the object is to be transformed.
        :param timeout: how long to wait for the transform, in steady time. Zero: do not wait.
        :param new_type: convert the result to this type. None: no conversion.
        :param prefix: put before the frame of the object, for example ``"robot1/"``: the prefix of the
            :class:`TransformListener` that receives the transforms of the same robot. No prefix is
            put before ``target_frame``. The object is not changed.
        :param policy: further arguments of the lookup, such as ``tolerance``, see :class:`tf2_ros.Buffer`.
            The lookups of a :class:`tf2_ros.BufferClient` accept ``max_age``, as one duration.
        :return: a new object, with the stamp of the object given, even if a ``tolerance`` accepted an older
            transform. If the stamp of the object is 0, the new object has the stamp of the transform, except
            for a point cloud.
        :raises TypeException: the type, or a conversion to ``new_type``, is not registered.
        :raises TransformException: what the lookup raises.
        :raises TypeError: ``target_frame`` or ``prefix`` is not a str, or ``timeout`` is not a duration.
        :raises ValueError: ``prefix`` contains a NUL character.
        :raises AttributeError: the object has no header, or its header no ``frame_id`` or ``stamp``.

        >>> from geometry_msgs.msg import PointStamped, TransformStamped
        >>> from tf2_ros import Buffer
        >>> mount = TransformStamped(child_frame_id="camera")
        >>> mount.header.frame_id = "base_link"
        >>> mount.transform.translation.x = 0.3
        >>> buffer = Buffer()
        >>> buffer.set_transform_static(mount, "example")
        >>> point = PointStamped()
        >>> point.header.frame_id = "camera"
        >>> point.point.x = 1.0
        >>> buffer.transform(point, "base_link").point.x
        1.3
        """
        stamped: Any = object_stamped
        do_transform: Any = self.registration.get(type(stamped))
        source_frame, stamp = source_of(stamped, prefix)
        look_up: Any = self.lookup_transform
        transform = look_up(target_frame, source_frame, stamp, timeout, **policy)
        return _applied(do_transform, stamped, transform, stamp, policy, new_type)

    def transform_full(
        self,
        object_stamped: _Object,
        target_frame: str,
        target_time: TimeLike,
        fixed_frame: str,
        timeout: DurationLike = NO_TIMEOUT,
        new_type: type[_New] | None = None,
        *,
        prefix: str = "",
        **policy: "Unpack[LookupPolicy]",
    ) -> _New:
        """
        Transform an object from its own time into another frame at another time. ``Time()`` as target time
        asks for the latest. The default ``timeout`` does not wait.

        The other arguments are those of :meth:`transform`, which raises the same.

        :param target_time: the time of the result; 0 is the latest time for which the frames between
            ``target_frame`` and ``fixed_frame`` have data.
        :param fixed_frame: a frame that does not move between the two times.
        :return: a new object, stamped with the target time, or with the time of the transform if the target
            time is 0; a point cloud keeps its own stamp.
        """
        stamped: Any = object_stamped
        do_transform: Any = self.registration.get(type(stamped))
        source_frame, stamp = source_of(stamped, prefix)
        look_up: Any = self.lookup_transform_full
        transform = look_up(
            target_frame,
            target_time,
            source_frame,
            stamp,
            fixed_frame,
            timeout,
            **policy,
        )
        return _applied(do_transform, stamped, transform, target_time, policy, new_type)

    async def transform_async(
        self,
        object_stamped: _Object,
        target_frame: str,
        timeout: DurationLike | None = None,
        new_type: type[_New] | None = None,
        *,
        prefix: str = "",
        **policy: "Unpack[LookupPolicy]",
    ) -> _New:
        """
        Transform an object into another frame as soon as the transform is available. Without ``timeout`` it
        waits forever.

        The other arguments are those of :meth:`transform`, which raises the same.

        :param timeout: how long to wait for the transform, in steady time. None: forever.
        :return: a new object, with the stamp that :meth:`transform` gives it.
        :raises TimeoutException: the transform was not available in time.
        """
        stamped: Any = object_stamped
        do_transform: Any = self.registration.get(type(stamped))
        source_frame, stamp = source_of(stamped, prefix)
        look_up: Any = self.lookup_transform_async
        transform = await look_up(target_frame, source_frame, stamp, timeout=timeout, **policy)
        return _applied(do_transform, stamped, transform, stamp, policy, new_type)

    def lookup_transform(
        self, target_frame: str, source_frame: str, time: TimeLike, timeout: DurationLike = NO_TIMEOUT
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
        raise NotImplementedException()

    def lookup_transform_full(
        self,
        target_frame: str,
        target_time: TimeLike,
        source_frame: str,
        source_time: TimeLike,
        fixed_frame: str,
        timeout: DurationLike = NO_TIMEOUT,
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
        raise NotImplementedException()

    async def lookup_transform_async(
        self, target_frame: str, source_frame: str, time: TimeLike, *, timeout: DurationLike | None = None
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
        raise NotImplementedException()

    @overload
    def can_transform(  # pyright: ignore[reportOverlappingOverload]  # the flag differs
        self,
        target_frame: str,
        source_frame: str,
        time: TimeLike,
        timeout: DurationLike = ...,
        return_debug_tuple: Literal[False] = ...,
        **policy: "Unpack[LookupPolicy]",
    ) -> bool: ...

    @overload
    def can_transform(
        self,
        target_frame: str,
        source_frame: str,
        time: TimeLike,
        timeout: DurationLike = ...,
        return_debug_tuple: Literal[True] = ...,
        **policy: "Unpack[LookupPolicy]",
    ) -> tuple[bool, str]: ...

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
        can, reason = self._tf2_can(timeout, policy, target_frame, source_frame, time)
        return (can, reason) if return_debug_tuple else can

    @overload
    def can_transform_full(  # pyright: ignore[reportOverlappingOverload]  # the flag differs
        self,
        target_frame: str,
        target_time: TimeLike,
        source_frame: str,
        source_time: TimeLike,
        fixed_frame: str,
        timeout: DurationLike = ...,
        return_debug_tuple: Literal[False] = ...,
        **policy: "Unpack[LookupPolicy]",
    ) -> bool: ...

    @overload
    def can_transform_full(
        self,
        target_frame: str,
        target_time: TimeLike,
        source_frame: str,
        source_time: TimeLike,
        fixed_frame: str,
        timeout: DurationLike = ...,
        return_debug_tuple: Literal[True] = ...,
        **policy: "Unpack[LookupPolicy]",
    ) -> tuple[bool, str]: ...

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
        can, reason = self._tf2_can(
            timeout, policy, target_frame, target_time, source_frame, source_time, fixed_frame
        )
        return (can, reason) if return_debug_tuple else can

    def _tf2_can(self, timeout: DurationLike, policy: "LookupPolicy", *arguments: Any) -> tuple[bool, str]:
        """Whether a lookup would answer, and why not; it is a full one if there are five arguments."""
        look_up: Any = self.lookup_transform if len(arguments) == 3 else self.lookup_transform_full
        try:
            look_up(*arguments, timeout, **policy)
        except TransformException as error:
            return False, str(error)
        return True, ""


def _applied(
    do_transform: Any,
    stamped: _Object,
    transform: TransformStamped,
    time: TimeLike,
    policy: "LookupPolicy",
    new_type: type[_New] | None,
) -> _New:
    """The object, transformed by what a lookup at ``time`` under a policy returned."""
    if policy and ((stamp := time_msg(time, "time")).sec or stamp.nanosec):
        # With a tolerance, the stamp is that of an older sample; data does not become older by being
        # transformed.
        header = Header(stamp=stamp, frame_id=transform.header.frame_id)
        transform = TransformStamped(
            header=header, child_frame_id=transform.child_frame_id, transform=transform.transform
        )
    result: _New = do_transform(stamped, transform)
    return result if new_type is None else convert(result, new_type)


def Stamped(obj: _Object, stamp: TimeLike, frame_id: str) -> _Object:
    """
    Give an object a header.

    :param obj: the object; it gets the attribute ``header``.
    :param stamp: a time, see :class:`tf2_ros.Buffer`; 0 stands for the latest transform.
    :param frame_id: the frame of the object.
    :return: the same object.
    :raises AttributeError: the object can have no attribute ``header``.
    :raises TypeError: ``stamp`` is not a time.
    """
    stamped: Any = obj
    stamped.header = Header(frame_id=frame_id, stamp=time_msg(stamp, "stamp"))
    return obj
