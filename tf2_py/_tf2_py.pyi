# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause

"""BufferCore reads arguments, calls the engine, and raises its errors."""

from collections.abc import Callable, Iterable, Sequence
from os import PathLike
from typing import Any, Literal, TypedDict, TypeVar, overload

import numpy as np
from geometry_msgs.msg import TransformStamped
from numpy.typing import NDArray
from rclpy.time import Time
from typing_extensions import Unpack

from tf2_py._objects.errors import (
    ConnectivityException,
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
    TimeoutException,
    TransformException,
)
from tf2_py._objects.explanations import Explanation
from tf2_py._objects.listings import FrameInfo, History
from tf2_py.typing import DurationLike, LookupPolicy, TimeLike, TimesLike

__all__ = [
    "BufferCore",
    "ConnectivityException",
    "ExtrapolationException",
    "InvalidArgumentException",
    "LookupException",
    "TimeoutException",
    "TransformException",
]

_Buffer = TypeVar("_Buffer", bound="BufferCore")
_Float = TypeVar("_Float", np.float32, np.float64)
_Matrix = TypeVar("_Matrix", bound=NDArray[np.floating[Any]])
_Vector = tuple[float, float, float]  # x y z

# What BufferCore.statistics returns; all are counts except `bytes`.
class _Statistics(TypedDict):
    taken: int
    refused: dict[str, int]
    frames: int
    samples: int
    displaced: int
    bytes: int
    waiters: int
    malformed_messages: int

class _Wait:  # Wait of tf2_py/engine/wait.pxi
    def outcome(self, again: bool = False) -> TransformStamped | BaseException | None: ...
    def take(self, again: bool = False) -> TransformStamped | None: ...
    @property
    def must_be_tried(self) -> bool: ...
    def cancel(self) -> bool: ...
    def reason(self) -> BaseException | None: ...
    def is_of_clock(self, error: BaseException) -> bool: ...
    def wait_for(self, timeout_ns: int, is_in_vain: Callable[[], bool]) -> TransformStamped | None: ...

class BufferCore:
    """
    A tree of coordinate frames that changes with time, and the history of each frame.

    :param cache_time: how far the history of each frame reaches back from its newest sample.
        Default: 10 s.
    :param int max_frames: the maximum number of frame names. Default: a million.
    :param int max_bytes: the maximum memory for names and histories. Default: 1 GiB.
    :raises TypeError: ``cache_time`` is not a duration or a number, or a limit is not an int.
    :raises ValueError: ``cache_time`` is negative, or a limit is not above 0.
    :raises OverflowError: ``cache_time`` does not fit into 64-bit nanoseconds.

    Transforms that would exceed a limit are refused, counted and logged; the others stay available. But where
    a frame has samples, its oldest makes room for a later one, which is counted and logged, too. The
    environment variables ``TF2_ROS_CYTHON_MAX_FRAMES`` and ``TF2_ROS_CYTHON_MAX_BYTES`` set
    other defaults.

    For all methods: a frame name is a ``str``. A time is an rclpy ``Time``, a time message, any object with
    the attributes of one, an int in nanoseconds, or a ``numpy.datetime64``; the time 0 means the latest time
    for which every frame on the path has data. A duration is an rclpy ``Duration``, a duration message, any
    object with the attributes of one, a ``timedelta``, or a number of seconds. Anything else raises a
    ``TypeError``. A name that contains a NUL character, or the time NaT, raises a ``ValueError``; a name with
    a lone surrogate, a ``UnicodeEncodeError``. A time whose seconds do not fit into the 32 bits of a message
    raises an ``OverflowError``.

    Every method may be called from any thread. Calling ``__init__`` again empties the buffer; pending waits
    continue.

    >>> from tf2_py import BufferCore
    >>> from geometry_msgs.msg import TransformStamped
    >>> mount = TransformStamped(child_frame_id="camera")
    >>> mount.header.frame_id = "base_link"
    >>> mount.transform.translation.x = 0.3
    >>> buffer = BufferCore()
    >>> buffer.set_transform_static(mount, "example")
    >>> "camera" in buffer
    True
    >>> print(buffer.tree())
    base_link
      camera (static)

    A buffer can be pickled and copied; the copy gives the same answers. A copy made by ``copy.copy`` is as
    independent as a deep one, except that it shares the attributes of a subclass.

    >>> import copy, pickle
    >>> pickle.loads(pickle.dumps(buffer)).tree() == copy.deepcopy(buffer).tree() == buffer.tree()
    True
    """
    @property
    def cache_time_ns(self) -> int:
        """How far each frame's history reaches back, in nanoseconds."""
    def _tf2_names(self) -> list[str]:
        """Every frame name, in the order of first appearance."""
    def _tf2_replace(self, data: bytes, authority: str, logs_refused: bool) -> int:
        """As :meth:`set_transforms` with ``replace``, for the transforms of one serialized TFMessage."""
    def __init__(
        self,
        cache_time: DurationLike | None = None,
        *,
        max_frames: int | None = None,
        max_bytes: int | None = None,
    ) -> None: ...
    def set_transform(self, transform: TransformStamped, authority: str, *, replace: bool = False) -> None:
        """
        Add one dynamic transform.

        :param transform: a ``geometry_msgs/TransformStamped`` or an object with its fields.
            The translation is in meters, the rotation a quaternion x y z w. The stamp 0 has no special
            meaning. A frame name ends at a NUL character, as it does when ROS sends the message.
        :param str authority: the publisher; listings and log lines show it.
        :param bool replace: whether to remove what the frame already has at this stamp, whatever its parent,
            as in :meth:`set_transforms`.
        :raises TypeError: an object lacks a field, or a value has the wrong type.
        :raises ValueError: a name contains a lone surrogate, or the authority a NUL character.
        :raises OverflowError: the stamp does not fit into 64-bit nanoseconds.

        Invalid transforms, such as those with NaN, without names, or older than the history, are dropped
        without an exception: they are logged, and counted in ``statistics()["refused"]``.
        """
    def set_transform_static(self, transform: TransformStamped, authority: str) -> None:
        """
        Add one transform that is valid at all times.

        :param transform: a ``geometry_msgs/TransformStamped`` or an object with its fields.
        :param str authority: the publisher; listings and log lines show it.

        Invalid transforms are dropped, and the same exceptions are raised, as in :meth:`set_transform`.
        """
    def set_transforms(
        self,
        transforms: Iterable[TransformStamped],
        authority: str,
        static: bool = False,
        *,
        replace: bool = False,
    ) -> int:
        """
        Add many transforms. Other threads may see the first ones before the last ones are added.

        :param transforms: an iterable of objects that :meth:`set_transform` accepts.
        :param str authority: the publisher; listings and log lines show it.
        :param bool static: whether they are valid at all times.
        :param bool replace: whether to rewrite the past. Of each frame in ``transforms``, everything from its
            first to its last stamp in there is removed, both included, whatever its parent, and these
            transforms take its place; of those with equal stamps, the last one counts. Other threads see all
            of the call or nothing, and waits are judged after it. A frame of which one transform is refused
            remains as it is. ``cache_time`` counts from the newest stamp that the frame then has. A frame
            does not change from dynamic to static, or back.
        :return: how many were added; the others are logged and counted.
        :raises TypeError, ValueError, OverflowError: an object is invalid, as in :meth:`set_transform`; no
            transform has been added.
        :raises MemoryError: there is no memory. With ``replace``, nothing has changed.

        With ``replace``, lookups of other threads wait meanwhile, for about 10 ms if there are 100,000
        transforms; the history of each frame is copied once.
        """
    def set_transforms_cdr(
        self, data: bytes | bytearray | memoryview, authority: str, static: bool = False
    ) -> int:
        """
        Add the transforms of one serialized ``tf2_msgs/TFMessage``.

        :param data: bytes-like: plain CDR of either byte order, with its encapsulation header.
        :param str authority: the publisher; listings and log lines show it.
        :param bool static: whether they are valid at all times.
        :return: how many were added; the others are logged and counted.
        :raises TypeError: ``data`` is not bytes-like.
        :raises BufferError: the bytes of ``data`` are not contiguous.
        :raises ValueError: ``data`` is malformed; nothing is added.
        """
    def clear(self) -> None:
        """Remove every dynamic transform; names, authorities and static transforms remain."""
    def forget(self, frame: str) -> bool:
        """
        Remove every transform of a frame, also static ones, as if it had never been a child.

        :param frame: the child frame of these transforms.
        :return: whether it had any. A frame that is unknown has none.

        Frames that no remaining transform refers to become unknown, until a new transform refers to them.
        Their names still count for ``max_frames`` and ``max_bytes``.
        """
    def __reduce__(self) -> tuple[Any, ...]: ...
    def __getstate__(self) -> dict[str, Any]:
        """
        Get the contents of this buffer at one moment, for pickles and copies. Other threads may continue to
        insert.

        :return: a dict with the bytes of a file of :meth:`freeze` under ``"image"``: the samples, who sent
            them, the cache time and the limits; and with the attributes of a subclass, except for those
            in slots, under ``"attributes"``. Pending waits, names without samples and the counters of
            :meth:`statistics` are not included. If the buffer was opened from a frozen file and is unchanged,
            and the file is still there, ``"frozen"`` with the path of the file stands for the image.
        """
    def _tf2_attributes(self) -> dict[str, Any]:
        """Get the attributes that a pickle or copy has, too."""
    def __setstate__(self, state: dict[str, Any]) -> None:
        """
        Replace the contents of this buffer by a state; pending waits continue.

        :param state: a dict that :meth:`__getstate__` returned.
        :raises ValueError: ``state`` is not the state of a buffer, is damaged, or names a frozen file that is
            damaged or was replaced by another. The buffer is unchanged.
        :raises OSError: this frozen file cannot be opened.
        """
    def _tf2_restored(self) -> None:
        """Set the attributes that a state does not have; called after it has replaced the contents."""
    def freeze(self, path: str | PathLike[str]) -> None:
        """
        Write the present contents of this buffer to a file that :meth:`open` maps into memory.

        The file has 72 bytes for each sample. An existing file is replaced when the new one is complete;
        processes that have opened it keep the old one. The new file is read-only, because writing into it
        would change what others have mapped. Attributes of a subclass are not written. Other threads may
        continue to insert; the file has what the buffer holds at one moment.

        :param path: the file.
        :raises OSError: the file cannot be written; an existing file remains unchanged.
        """
    @classmethod
    def open(cls: type[_Buffer], path: str | PathLike[str]) -> _Buffer:
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
    def lookup_transform_core(self, target_frame: str, source_frame: str, time: TimeLike) -> TransformStamped:
        """
        Get the pose of ``source_frame`` in ``target_frame``, which transforms data from source to target.

        A point at p in ``source_frame`` is at R p + t in ``target_frame``, where R and t are the
        rotation and the translation returned. ``Time()``, which is 0, means the latest time
        for which all frames on the path have data.

        :param str target_frame: the frame to transform data into.
        :param str source_frame: the frame of the data.
        :param time: the time of the transform; 0: the latest common time.
        :return: a ``geometry_msgs/TransformStamped`` with the stamp looked up, ``frame_id`` the target and
            ``child_frame_id`` the source; meters, unit quaternion.
        :raises LookupException: a frame is unknown, or the tree contains a loop.
        :raises ConnectivityException: the frames are in different trees.
        :raises ExtrapolationException: a frame on the path has no data for the time.
        :raises InvalidArgumentException: a name is empty or begins with ``/``.
        :raises TypeError, ValueError, OverflowError: an argument has a wrong type, or is not a valid name
            or time; see the class.
        """
    def lookup_transform_full_core(
        self,
        target_frame: str,
        target_time: TimeLike,
        source_frame: str,
        source_time: TimeLike,
        fixed_frame: str,
    ) -> TransformStamped:
        """
        Get the pose of ``source_frame`` at ``source_time`` in ``target_frame`` at ``target_time``.

        It transforms data from source to target: a point at p in ``source_frame`` at ``source_time`` is at
        R p + t in ``target_frame`` at ``target_time``, if ``fixed_frame`` does not move in between.
        ``Time()``, which is 0, means the latest time.

        :param target_time: the time of the target frame; 0: the latest common time of it and the fixed frame.
        :param source_time: the time of the source frame; 0: the latest common time of it and the fixed frame.
        :param str fixed_frame: the frame that is assumed not to move between the two times.
        :return: a ``geometry_msgs/TransformStamped`` with the stamp of the target.

        It raises what :meth:`lookup_transform_core` raises.
        """
    def lookup_transforms(
        self,
        target_frame: str,
        source_frame: str | Sequence[str],
        times: TimesLike,
        *,
        fixed_frame: str | None = None,
        target_time: TimeLike | None = None,
        on_missing: Literal["raise", "nan"] = "raise",
        **policy: Unpack[LookupPolicy],
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """
        Look up one transform at many times, with the results of single lookups up to rounding.

        :param target_frame: the frame to transform data into.
        :param source_frame: the frame of the data, or a sequence of F frames.
        :param times: N times: integer nanoseconds or datetime64 (array-like of shape (N,), also a column of a
            data frame), or a sequence of time objects; 0 is the latest common time. NaT, the smallest int64,
            and a time that does not fit into the stamp of a message have no answer.
        :param fixed_frame: with ``target_time``, look up the source at each of ``times``, and the target at
            ``target_time``.
        :param on_missing: ``'raise'`` raises the error of the first time without an answer, with its index;
            ``'nan'`` fills in NaN there. With several frames, the error of the first frame that fails is
            raised. Unknown and invalid names always raise, before anything else.
        :param policy: options such as ``tolerance``, see :class:`tf2_py.typing.LookupPolicy`. With an option,
            each lookup takes as long as a single one.
        :return: ``(translations, rotations)``: float64 arrays of shape (N, 3), meters, and (N, 4), x y z w;
            of a sequence of frames, (F, N, 3) and (F, N, 4). All results of one frame come from one state
            of the buffer; transforms that are inserted during the call are ignored.
        :raises TransformException: see :meth:`lookup_transform_core`.
        :raises TypeError: ``times`` are not times, or only one of ``fixed_frame`` and ``target_time`` is
            given.
        :raises ValueError: ``times`` do not have one dimension, one is NaT and ``on_missing`` is ``'raise'``,
            or ``on_missing`` is neither of the two.
        :raises OverflowError: a time does not fit into the stamp of a message and ``on_missing`` is
            ``'raise'``, or does not fit into 64 bits.

        The GIL is released, so other threads run during the call.
        """
    @overload
    def lookup_matrix(
        self,
        target_frame: str,
        source_frame: str,
        time: TimeLike,
        out: None = None,
        *,
        fixed_frame: str | None = None,
        target_time: TimeLike | None = None,
        **policy: Unpack[LookupPolicy],
    ) -> NDArray[np.float64]:
        """
        Get the pose of ``source_frame`` in ``target_frame`` as a homogeneous matrix, without a message.

        It does not wait. ``buffer.lookup_matrix(target, source, time) @ [x, y, z, 1]`` is the point (x, y, z)
        of ``source_frame``, in meters, in ``target_frame``.

        :param time: the time of the transform; 0: the latest common time.
        :param out: an array of shape (4, 4) that receives the matrix: of any float type, which the numbers
            are rounded to, in any layout, such as a part of a larger array. None: a new float64 array.
        :param fixed_frame: with ``target_time``, look up the source at ``time``, and the target at
            ``target_time``; the fixed frame is assumed not to move in between.
        :param target_time: the time of the target frame.
        :param policy: options such as ``tolerance``, and their errors: see
            :class:`tf2_py.typing.LookupPolicy`.
        :return: ``out``, or the new array, of shape (4, 4).
        :raises TransformException: see :meth:`lookup_transform_core`; ``out`` is unchanged.
        :raises TypeError: ``out`` is not a NumPy array of floats, only one of ``fixed_frame`` and
            ``target_time`` is given, or an argument has a wrong type.
        :raises ValueError: ``out`` has another shape, or is read-only.

        >>> from tf2_py import BufferCore
        >>> from geometry_msgs.msg import TransformStamped
        >>> mount = TransformStamped(child_frame_id="camera")
        >>> mount.header.frame_id, mount.transform.translation.x = "base_link", 0.3
        >>> buffer = BufferCore()
        >>> buffer.set_transform_static(mount, "example")
        >>> buffer.lookup_matrix("base_link", "camera", 0)[:3, 3]
        array([0.3, 0. , 0. ])
        """
    @overload
    def lookup_matrix(
        self,
        target_frame: str,
        source_frame: str,
        time: TimeLike,
        out: _Matrix,
        *,
        fixed_frame: str | None = None,
        target_time: TimeLike | None = None,
        **policy: Unpack[LookupPolicy],
    ) -> _Matrix:
        """
        Get the pose of ``source_frame`` in ``target_frame`` as a homogeneous matrix, without a message.

        It does not wait. ``buffer.lookup_matrix(target, source, time) @ [x, y, z, 1]`` is the point (x, y, z)
        of ``source_frame``, in meters, in ``target_frame``.

        :param time: the time of the transform; 0: the latest common time.
        :param out: an array of shape (4, 4) that receives the matrix: of any float type, which the numbers
            are rounded to, in any layout, such as a part of a larger array. None: a new float64 array.
        :param fixed_frame: with ``target_time``, look up the source at ``time``, and the target at
            ``target_time``; the fixed frame is assumed not to move in between.
        :param target_time: the time of the target frame.
        :param policy: options such as ``tolerance``, and their errors: see
            :class:`tf2_py.typing.LookupPolicy`.
        :return: ``out``, or the new array, of shape (4, 4).
        :raises TransformException: see :meth:`lookup_transform_core`; ``out`` is unchanged.
        :raises TypeError: ``out`` is not a NumPy array of floats, only one of ``fixed_frame`` and
            ``target_time`` is given, or an argument has a wrong type.
        :raises ValueError: ``out`` has another shape, or is read-only.

        >>> from tf2_py import BufferCore
        >>> from geometry_msgs.msg import TransformStamped
        >>> mount = TransformStamped(child_frame_id="camera")
        >>> mount.header.frame_id, mount.transform.translation.x = "base_link", 0.3
        >>> buffer = BufferCore()
        >>> buffer.set_transform_static(mount, "example")
        >>> buffer.lookup_matrix("base_link", "camera", 0)[:3, 3]
        array([0.3, 0. , 0. ])
        """
    def lookup_matrices(
        self,
        target_frame: str,
        source_frame: str | Sequence[str],
        times: TimesLike,
        *,
        fixed_frame: str | None = None,
        target_time: TimeLike | None = None,
        on_missing: Literal["raise", "nan"] = "raise",
        **policy: Unpack[LookupPolicy],
    ) -> NDArray[np.float64]:
        """
        Look up one transform at many times, as homogeneous matrices.

        The parameters and errors are the same as for :meth:`lookup_transforms`.

        :return: a float64 array of shape (N, 4, 4); of a sequence of F frames, (F, N, 4, 4). Each matrix
            equals :meth:`lookup_matrix`; with ``on_missing='nan'``, times without an answer are NaN.
        """
    @overload
    def transform_points(
        self,
        points: Sequence[Sequence[float]],
        times: TimesLike,
        target_frame: str,
        source_frame: str,
        *,
        fixed_frame: str | None = None,
        target_time: TimeLike | None = None,
        **policy: Unpack[LookupPolicy],
    ) -> NDArray[np.float64]:
        """
        Transform each point at its own time.

        :param points: array-like of shape (N, 3), meters, each in ``source_frame`` at its time; float32,
            float64 or integers.
        :param times: N times, one for each point: integer nanoseconds, datetime64, or time objects.
        :param target_frame: the frame to transform the points into.
        :param source_frame: the frame of the points.
        :param fixed_frame: with ``target_time``, transform the points into the target at that time; the fixed
            frame is assumed not to move between the times of the points and that time.
        :param target_time: the time of the target frame.
        :param policy: options such as ``tolerance``, see :class:`tf2_py.typing.LookupPolicy`.
        :return: an array of shape (N, 3) of the points' dtype, or float64 of integers, in ``target_frame``.
        :raises TransformException: a lookup failed; the text contains the index of the time.
        :raises TypeError: the points have another dtype, ``times`` are not times, or only one of
            ``fixed_frame`` and ``target_time`` is given.
        :raises ValueError: ``points`` does not have the shape (N, 3), or ``times`` do not have one dimension
            or are NaT.
        :raises OverflowError: a time does not fit into the stamp of a message.
        """
    @overload
    def transform_points(
        self,
        points: NDArray[_Float],
        times: TimesLike,
        target_frame: str,
        source_frame: str,
        *,
        fixed_frame: str | None = None,
        target_time: TimeLike | None = None,
        **policy: Unpack[LookupPolicy],
    ) -> NDArray[_Float]:
        """
        Transform each point at its own time.

        :param points: array-like of shape (N, 3), meters, each in ``source_frame`` at its time; float32,
            float64 or integers.
        :param times: N times, one for each point: integer nanoseconds, datetime64, or time objects.
        :param target_frame: the frame to transform the points into.
        :param source_frame: the frame of the points.
        :param fixed_frame: with ``target_time``, transform the points into the target at that time; the fixed
            frame is assumed not to move between the times of the points and that time.
        :param target_time: the time of the target frame.
        :param policy: options such as ``tolerance``, see :class:`tf2_py.typing.LookupPolicy`.
        :return: an array of shape (N, 3) of the points' dtype, or float64 of integers, in ``target_frame``.
        :raises TransformException: a lookup failed; the text contains the index of the time.
        :raises TypeError: the points have another dtype, ``times`` are not times, or only one of
            ``fixed_frame`` and ``target_time`` is given.
        :raises ValueError: ``points`` does not have the shape (N, 3), or ``times`` do not have one dimension
            or are NaT.
        :raises OverflowError: a time does not fit into the stamp of a message.
        """
    def can_transform_core(self, target_frame: str, source_frame: str, time: TimeLike) -> tuple[int, str]:
        """
        Return whether :meth:`lookup_transform_core` would succeed: ``(1, '')``, or ``(0, reason)``.

        An invalid name is a reason; ``TypeError``, ``ValueError`` and ``OverflowError`` are raised.
        """
    def can_transform_full_core(
        self,
        target_frame: str,
        target_time: TimeLike,
        source_frame: str,
        source_time: TimeLike,
        fixed_frame: str,
    ) -> tuple[int, str]:
        """Return whether :meth:`lookup_transform_full_core` would succeed; see :meth:`can_transform_core`."""
    def get_latest_common_time(self, target_frame: str, source_frame: str) -> Time:
        """
        Get the newest time at which every dynamic frame between the two has data; 0 if all are static.

        :return: an ``rclpy.time.Time`` of clock type ``SYSTEM_TIME``.
        :raises TransformException: no path connects the frames.
        :raises LookupException: a frame is unknown.
        :raises InvalidArgumentException: a name is empty or begins with ``/``.
        """
    def explain(
        self, target_frame: str, source_frame: str, time: TimeLike = 0, **policy: Unpack[LookupPolicy]
    ) -> Explanation:
        """
        Get why a lookup has its answer: each hop, with the samples that have answered. It does not wait.

        :param target_frame: the frame to transform data into.
        :param source_frame: the frame of the data.
        :param time: the time of the transform; 0: the latest common time.
        :param policy: options such as ``tolerance``, see :class:`tf2_py.typing.LookupPolicy`.
        :return: an :class:`Explanation`; ``print`` shows it.
        :raises TransformException: the lookup fails; see :meth:`lookup_transform_core`.
        :raises TypeError, ValueError, OverflowError: an argument has a wrong type, or is not a valid name,
            time or limit.

        Everything is of one moment, except for the clock of the buffer, which is read before.

        >>> from tf2_py import BufferCore
        >>> from geometry_msgs.msg import TransformStamped
        >>> robot = TransformStamped(child_frame_id="base_link")
        >>> robot.header.frame_id = "odom"
        >>> buffer = BufferCore()
        >>> for robot.header.stamp.sec in (2, 3):
        ...     buffer.set_transform(robot, "wheels")
        >>> print(buffer.explain("odom", "base_link", 2_400_000_000))
        odom ← base_link at 2.400000000
          odom ← base_link  interpolated 40 % between 2.000 and 3.000 s (gap 1.000 s), last from wheels
        weakest: odom ← base_link
        """
    def time_range(self, target_frame: str, source_frame: str) -> tuple[int, int]:
        """
        Get the times for which ``source_frame`` can be looked up in ``target_frame``.

        :return: ``(first_ns, last_ns)``, in nanoseconds, both included: every time between them has an
            answer. ``last_ns`` is what :meth:`get_latest_common_time` returns, if a frame on the path moves.
        :raises ExtrapolationException: the latest common time has no answer, because the data of one frame on
            the path begins after the data of another frame ends.
        :raises ConnectivityException: the frames are in different trees, or one has no data.
        :raises LookupException: a frame is unknown, or the tree contains a loop.
        :raises InvalidArgumentException: a name is empty or begins with ``/``.

        To find the range for several pairs of frames, take the largest ``first_ns`` and the smallest
        ``last_ns``. If all frames on the path are static, or the two frames are the same, the range is
        ``(0, 2147483647999999999)``, which ends at the latest stamp that fits into a message. The path may
        differ within the range if a frame had several parents. A loop in the tree ends the range; for
        static frames, the range begins after it.

        >>> from tf2_py import BufferCore
        >>> from geometry_msgs.msg import TransformStamped
        >>> robot = TransformStamped(child_frame_id="base_link")
        >>> robot.header.frame_id = "odom"
        >>> buffer = BufferCore()
        >>> for robot.header.stamp.sec in (2, 3, 5):
        ...     buffer.set_transform(robot, "example")
        >>> buffer.time_range("odom", "base_link")
        (2000000000, 5000000000)
        """
    def _tf2_follow_clock(self, clock: Any) -> None:
        """Count ages by this clock from now on. None: there is no clock."""
    def _tf2_clear(self, hand_over: Callable[[Any], object]) -> None:
        """As ``clear``; ``hand_over`` is called with what runs code of a program."""
    def _tf2_clock_jumped(self, hand_over: Callable[[Any], object] | None = None) -> None:
        """
        Judge the ages of pending waits anew, because the clock has gone back, or shows another time.

        :param hand_over: called with what runs code of a program. None: this thread runs it.
        """
    def ages(self, target_frame: str, source_frame: str) -> dict[str, float]:
        """
        Get how old the newest sample of each moving frame between two frames is.

        :return: the ages in seconds on the buffer's clock, by the names of the frames, from ``source_frame``
            up to the common ancestor and down to ``target_frame``, along the parents of their newest samples.
            Static frames have no age. A stamp later than the clock results in a negative age. While the clock
            is at 0, because simulated time has not begun, all ages are infinite.
        :raises ConnectivityException: the frames are in different trees, or one has no data.
        :raises LookupException: a frame is unknown, or the tree contains a loop.
        :raises InvalidArgumentException: a name is empty or begins with ``/``.
        :raises ValueError: the buffer has no clock, as a ``BufferCore`` or the buffer of a recording.

        Unlike for a lookup, the frames need not have data for a common time.
        """
    def _poses_between(
        self,
        target_frame: str,
        source_frame: str,
        first_ns: int,
        last_ns: int,
        turn: float,
        move: float,
        most: int,
        *,
        fixed_frame: str | None = None,
        target_time: TimeLike | None = None,
        **policy: Unpack[LookupPolicy],
    ) -> tuple[NDArray[np.int64], NDArray[np.float64]] | None:
        """
        Look up one transform at times between which it is nearly that of a linear interpolation.

        All belong to one state of the buffer. The other parameters are the same as for
        :meth:`lookup_transforms`.

        :param turn: how far a point at 1 m may be off because of the rotation; ``move``, how far the origin,
            in meters.
        :return: the times, ascending, from ``first_ns`` to ``last_ns``, and the matrix at each; None if they
            were more than ``most``, the path differs between times, the transform jumps, a lookup fails, or
            no stamp can hold ``first_ns`` or ``last_ns``.
        """
    def lookupVelocityCore(
        self,
        tracking_frame: str,
        observation_frame: str,
        time: TimeLike,
        averaging_interval: DurationLike,
    ) -> tuple[_Vector, _Vector]:
        """
        Get the twist of ``tracking_frame``'s origin relative to ``observation_frame``, in the latter's axes.

        The arguments, the formula and the errors are described in :meth:`lookupVelocityFullCore`.

        :return: ``((vx, vy, vz), (wx, wy, wz))``: means over the interval, in m/s and rad/s.
        """
    def lookupVelocityFullCore(
        self,
        tracking_frame: str,
        observation_frame: str,
        reference_frame: str,
        reference_point: Sequence[float],
        reference_point_frame: str,
        time: TimeLike,
        averaging_interval: DurationLike,
    ) -> tuple[_Vector, _Vector]:
        """
        Get the mean twist of ``tracking_frame`` relative to ``observation_frame`` around a time.

        :param tracking_frame: the frame that moves.
        :param observation_frame: the frame in which it is observed.
        :param reference_frame: the twist is expressed in the axes of this frame.
        :param reference_point: three floats, meters, in ``reference_point_frame``: the linear velocity
            is the velocity of the point of the tracked body that is there at ``time``.
        :param reference_point_frame: a frame name.
        :param time: the middle of the interval; 0 is the time 0, not the latest common time.
        :param averaging_interval: a duration. The interval ends no later than the latest common time, or
            than ``time`` if a frame changed its parent. 0 results in NaN.
        :return: ``((vx, vy, vz), (wx, wy, wz))`` in m/s and rad/s.
        :raises TransformException: one of the lookups failed; see :meth:`lookup_transform_core`.
        :raises ValueError: ``averaging_interval`` is negative, or the point does not have three numbers.

        Angular: the rotation vector between the two poses over the time between them. Linear: the chord
        of the origin over that time, plus angular x (reference point - origin).
        """
    def __contains__(self, name: object) -> bool:
        """Return whether this is the name of a frame, including parents; False for anything but a ``str``."""
    def histories(self) -> dict[str, History]:
        """
        Get the samples of each frame at one moment, as arrays.

        :return: a dict from the name of each frame with samples to a named tuple :class:`History`, whose
            arrays are copies.
        """
    def frames(self) -> dict[str, FrameInfo]:
        """
        Get the frames of this buffer, in the order in which their names were first used.

        :return: a dict from name to a named tuple :class:`FrameInfo`: ``parent``, ``static``, ``count``,
            ``oldest_ns``, ``newest_ns``.

        The times are exact: ``oldest_ns`` and ``newest_ns`` are the earliest and the latest time at which the
        frame can be looked up in its parent. Roots are included; like static frames, they have None there.
        For the times that two frames have in common, see :meth:`time_range`. The cost grows with the number
        of frames.
        """
    def parent(self, frame: str, time: TimeLike = 0) -> str | None:
        """
        Get the parent of a frame.

        :param frame: the child frame.
        :param time: when; 0: at the time of its newest sample.
        :return: the parent; None if ``frame`` is a root, or has no data for the time.
        :raises LookupException: the frame is unknown.
        """
    def children(self, frame: str) -> list[str]:
        """
        Get the frames whose parent is ``frame`` in their newest sample, in the order of first appearance.

        :param frame: the parent frame.
        :return: the names; an empty list if it has no children.
        :raises LookupException: the frame is unknown.

        The cost grows with the number of all frames.
        """
    def path(self, target_frame: str, source_frame: str, time: TimeLike = 0) -> list[str]:
        """
        Get the frames from ``source_frame`` up to the common ancestor and down to ``target_frame``.

        :param target_frame: the last frame of the path.
        :param source_frame: the first frame of the path.
        :param time: when; 0: at the latest common time.
        :return: the names, both ends included.
        :raises TransformException: see :meth:`lookup_transform_core`.
        """
    def tree(self) -> str:
        """
        Get the frames as indented text: each frame is followed by its children, with their numbers of
        samples.

        The parent is the parent in the newest sample. Frames whose parents form a loop come last and are
        marked. For the rest, see :meth:`frames`.
        """
    def all_frames_as_yaml(self) -> str:
        """Get the frames with data as YAML: parent, broadcaster, rate (Hz), times (s), buffer length (s)."""
    def all_frames_as_string(self) -> str:
        """Get one sentence for each frame that was ever a child; see also :meth:`all_frames_as_yaml`."""
    def _allFramesAsDot(self, time: TimeLike | None = None) -> str:
        """
        Get the frames with data as a Graphviz digraph; see also :meth:`all_frames_as_yaml`.

        :param time: the time from which ages are counted; None or 0: no ages.
        """
    def _frameExists(self, name: str) -> bool:
        """Whether the name was ever a parent or a child."""
    def _getFrameStrings(self) -> list[str]:
        """Every frame name, in the order of first appearance."""
    def _chain(
        self,
        target_frame: str,
        target_time: TimeLike,
        source_frame: str,
        source_time: TimeLike,
        fixed_frame: str,
    ) -> list[str]:
        """
        Get the frames from the source up to the common ancestor and down to the target, each once.

        As in tf2, they are those up to the fixed frame if the target is unknown, and none if the source and
        the fixed frame are.
        """
    def _wait(
        self,
        target_frame: str,
        source_frame: str,
        time: TimeLike,
        fixed_frame: str | None = None,
        target_time: TimeLike | None = None,
        notify: Callable[..., Any] | None = None,
        policy: Any = None,
        after: _Wait | None = None,
        until_refused: bool = False,
    ) -> _Wait:
        """
        Wait for a lookup, which is at two times if ``fixed_frame`` and ``target_time`` are given.

        :param notify: called with the answer by the thread that inserts what was missing, or with None and
            the error that ends the wait; not called if the answer is available at once. It runs no user code,
            but may return a callable that does. A user's thread calls that at once; a receiver hands it over.
            None: :meth:`Wait.wait_for` waits.
        :param policy: of ``policy_of``.
        :param after: a previous wait for the same simple lookup at the latest time: wait for an answer
            that differs from its answer.
        :param until_refused: end with the lookup's error once the buffer refuses the data that a simple
            lookup at a time lacks, because it is older than what the frame keeps.
        :return: a ``Wait``; its answer may be available at once.
        :raises InvalidArgumentException: a name is empty or begins with ``/``: the wait would never end.
        """
    def _tf2_look_up(
        self,
        target_frame: str,
        source_frame: str,
        time: TimeLike,
        fixed_frame: str | None = None,
        target_time: TimeLike | None = None,
        policy: Any = None,
        or_none: bool = False,
    ) -> TransformStamped | None:
        """
        Look up as :meth:`lookup_transform_core`, or at two times, under a policy of ``policy_of``.

        :param or_none: return None if there is no answer, instead of raising why. Arguments that are never
            valid raise all the same, except for invalid names.
        """
    def _tf2_can_look_up(
        self,
        target_frame: str,
        source_frame: str,
        time: TimeLike,
        fixed_frame: str | None = None,
        target_time: TimeLike | None = None,
        policy: Any = None,
    ) -> bool:
        """Whether :meth:`_tf2_look_up` would return an answer. It raises what that raises."""
    def _tf2_can_core(self, target_frame: str, source_frame: str, time: TimeLike) -> bool:
        """What :meth:`can_transform_core` says, also that of a program; if it is ours, it makes no text."""
    def _tf2_can_full_core(
        self,
        target_frame: str,
        target_time: TimeLike,
        source_frame: str,
        source_time: TimeLike,
        fixed_frame: str,
    ) -> bool:
        """What :meth:`can_transform_full_core` says, as :meth:`_tf2_can_core`."""
    def _describe_silence_with(self, find_silence: Callable[[Any], tuple[str, str]]) -> None:
        """
        Have errors report which topics are silent.

        :param find_silence: called with this buffer when an error is made. Returns two clauses, about all
            topics that fill the buffer, and about those of dynamic transforms; ``""`` if none is silent. It
            must not refer to the buffer. The answer is kept for 0.1 s, except that an error about known
            frames calls it again before it reports a silent topic.
        """
    def statistics(self) -> _Statistics:
        """
        Count what this buffer has done, and what it contains.

        :return: a dict of numbers: transforms ``taken``, and ``refused`` by reason (a dict); ``frames`` and
            ``samples``, and the ``bytes`` allocated for them; samples ``displaced`` because of ``max_bytes``;
            pending ``waiters``; ``malformed_messages``.
        """
    def _self_check(self) -> None:
        """Check the tree, histories and waiters; an AssertionError names an invariant that does not hold."""

# For the modules of this project.

DURATION_TO_USE: str
FOR_EVER_NS: int
LIMITS: dict[str, int]
TIMES_TO_USE: str
TIMES_WITHOUT_ROS: str

def as_times_ns(times: Any, *, accepts_nat: bool = False) -> NDArray[np.int64]:
    """
    Times as contiguous int64 nanoseconds of shape (N,); its errors state what is expected. An accepted NaT is
    the least int64.
    """

def mask_of(values: Any) -> NDArray[np.bool_] | None:
    """
    The mask of a masked array of NumPy; None if nothing is masked, and for anything else.

    This does not use ``numpy.ma``, which NumPy imports when it is first used: a fork meanwhile would leave
    the lock of that import taken.
    """

def time_ns(time: Any, argument: str) -> int:
    """
    The nanoseconds of a time: of anything with ``nanoseconds``, or with ``sec`` and ``nanosec``; of an
    integer of nanoseconds; of a ``numpy.datetime64``; or of a ``pandas.Timestamp``.

    :param argument: its name in errors.
    :raises TypeError: it is none of these, or its fields are not integers.
    :raises ValueError: it is NaT.
    :raises OverflowError: it does not fit into 64 bits, or is not a whole number of nanoseconds.
    """

def duration_ns(duration: Any, argument: str) -> int:
    """
    The nanoseconds of a duration: of an rclpy ``Duration``, a message, or anything with their fields; of a
    ``datetime.timedelta``; or of a number of seconds.

    :param argument: its name in errors.
    :raises TypeError: it is none of these, or it is a time.
    :raises ValueError: it is NaN.

    Durations beyond plus or minus FOR_EVER_NS, including infinite floats, are limited to it.
    """

def stamp_parts(time: Any, argument: str) -> tuple[int, int]:
    """
    The ``(sec, nanosec)`` of a time as a stamp; ``nanosec`` is never negative. Raises as :func:`time_ns`.

    :param argument: its name in errors.
    :raises OverflowError: also if no message can hold it.
    """

def frame_name(name: object, argument: str) -> str:
    """The name, if lookups accept it; otherwise raises the errors of a lookup."""

def bool_of(value: Any, argument: str) -> bool:
    """A bool, or one of NumPy; anything else is a TypeError, because ``"no"`` and NaN would count as true."""

def policy_of(call: str, waits: bool, /, **policy: Unpack[LookupPolicy]) -> Any:
    """
    The policy of these arguments, those of :class:`tf2_py.typing.LookupPolicy`; None: all are defaults.

    :param call: the method that a program called with them.
    :param waits: whether it has a ``timeout``.
    :raises TypeError: one of them has the wrong type, or there are others.
    :raises ValueError: a duration is negative.
    """

def refused_transforms(transforms: list[TransformStamped]) -> list[tuple[str, str]]:
    """
    The transforms that every buffer refuses.

    :param transforms: a list of ``geometry_msgs/TransformStamped``.
    :return: a list of pairs: the ``child_frame_id``, and why.
    """

def serialize_as_ros(
    transforms: list[TransformStamped],
) -> tuple[bytes, list[tuple[str, str]]] | None:
    """
    The ``tf2_msgs/TFMessage`` of these transforms as plain CDR, ready for a publisher.

    :param transforms: a list of ``geometry_msgs/TransformStamped``.
    :return: the bytes, and the transforms that every buffer refuses, as pairs of ``child_frame_id`` and
        reason. Numbers of any type are sent as floats. None if a part of one is not exactly of its class but,
        for example, of a subclass: then ROS's own conversion decides.
    """

def normalize(rotations: NDArray[np.float64], *, nan_missing: bool = False) -> int:
    """
    Normalize each row, a quaternion x y z w, in place.

    :param rotations: float64, shape (N, 4), contiguous and writable.
    :param nan_missing: accept rows in which everything is NaN, and leave them unchanged.
    :return: the index of the first row without a finite length above zero, at which this stops; -1: none.
    """

def matrices_from_rotations(rotations: NDArray[np.float64]) -> NDArray[np.float64]:
    """
    Convert each row to a matrix.

    :param rotations: N rows: unit quaternions x y z w, or NaN; float64, contiguous.
    :return: float64, shape (N, 3, 3).
    """

def keep_for_ever(*things: object) -> None:
    """Never destroy these, not even at the interpreter's end."""
