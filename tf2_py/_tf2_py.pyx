"""Owns BufferCore: it reads arguments, calls the engine, and raises."""

cimport cython
from cpython.buffer cimport PyBUF_SIMPLE, PyBuffer_Release, PyObject_GetBuffer
from libc.stdint cimport int64_t
from libc.string cimport memset

from tf2_py._core.lookup cimport Query
from tf2_py._core.names cimport NAME_UNKNOWN
from tf2_py._core.series cimport TimeSeries
from tf2_py._core.tree cimport DEFAULT_CACHE_TIME_NS, Limits
from tf2_py._core.twist cimport twist_of_point
from tf2_py._core.types cimport (
    NO_FRAME,
    STATUS_LOOP,
    STATUS_OK,
    STATUS_UNCONNECTED,
    Status,
    Transform,
)
from tf2_py._engine.chain cimport chain_between
from tf2_py._engine.sharing cimport SharingEngine
from tf2_py._engine.wait cimport Wait
from tf2_py._objects.arguments cimport (
    query_fill,
    query_fill_full,
    query_fill_series,
    query_frames,
)
from tf2_py._objects.messages cimport (
    authority_utf8,
    name_utf8,
    new_transform_stamped,
    read_transform_stamped,
)
from tf2_py._objects.times cimport (
    duration_nanoseconds, duration_or_seconds, nanoseconds, new_time, stamp_nanoseconds,
)
from tf2_py._wire.batch cimport Batch, Entry, batch_free, batch_read_cdr, batch_reserve

import os

from tf2_py._objects import errors, listings
from tf2_py._objects.arrays import as_points, as_times_ns, new_rows
from tf2_py._objects.attributes import attributes_of, check_attributes, set_attributes
# Programs also catch them by the name of tf2's extension module.
from tf2_py._objects.errors import (
    ConnectivityException,
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
    TimeoutException,
    TransformException,
)
from tf2_py._objects.frame_tree import tree_text
from tf2_py._objects.limits import limit
from tf2_py._objects.printable import printable

__all__ = [
    "BufferCore",
    "ConnectivityException",
    "ExtrapolationException",
    "InvalidArgumentException",
    "LookupException",
    "TimeoutException",
    "TransformException",
]


# The first line of its text, which CPython takes away, is what `inspect` reads the signature of a class from.
@cython.no_gc_clear
cdef class BufferCore(SharingEngine):
    """BufferCore(cache_time=None, *, max_frames=None, max_bytes=None, max_waiters=None)\n--\n
    A tree of coordinate frames that changes with time, and the history of each frame.

    :param cache_time: how far each frame's history reaches back: a duration, or a number, which is seconds.
        Default 10 s.
    :param int max_frames: how many frame names. Default: a million.
    :param int max_bytes: memory for names and histories. Default: 1 GiB.
    :param int max_waiters: how many lookups may wait at once. Default: a hundred thousand.
    :raises TypeError: ``cache_time`` is neither, or a limit is no int.
    :raises ValueError: ``cache_time`` is negative, or a limit is not above 0.
    :raises OverflowError: ``cache_time`` does not fit into 64-bit nanoseconds.

    Transforms that would exceed a limit are refused, counted and logged; a wait that would is a
    ``TransformException``. What the buffer holds stays available. The environment variables
    ``TF2_ROS_CYTHON_MAX_FRAMES``, ``TF2_ROS_CYTHON_MAX_BYTES`` and ``TF2_ROS_CYTHON_MAX_WAITERS`` set other
    defaults.

    For all methods: a frame name is a ``str``; a time or duration is any object with ``nanoseconds``, or with
    ``sec`` and ``nanosec``; a time may also be an integer, which is nanoseconds, or a ``numpy.datetime64``.
    The time 0 asks for the latest time that every frame on the path has data for. Anything else is a
    ``TypeError``. A name that holds a NUL character, or the time NaT, is a ``ValueError``, a name with a lone
    surrogate a ``UnicodeEncodeError``. A time whose seconds do not fit into the 32 bits of a message is an
    ``OverflowError``. Every method may be called from any thread. Calling ``__init__`` again empties the
    buffer; pending waits go on.

    >>> from tf2_py import BufferCore
    >>> from geometry_msgs.msg import TransformStamped
    >>> mount = TransformStamped(child_frame_id="camera")
    >>> mount.header.frame_id, mount.transform.translation.x = "base_link", 0.3
    >>> buffer = BufferCore()
    >>> buffer.set_transform_static(mount, "example")
    >>> "camera" in buffer
    True
    >>> print(buffer.tree())
    base_link
      camera (static)

    It can be pickled and copied, with everything that answers and listings depend on. A copy by
    ``copy.copy`` is as independent as a deep one, but shares the attributes of a subclass.

    >>> import copy, pickle
    >>> pickle.loads(pickle.dumps(buffer)).tree() == copy.deepcopy(buffer).tree() == buffer.tree()
    True
    """

    def __init__(
        self,
        cache_time: Duration | None = None,
        *,
        max_frames: int | None = None,
        max_bytes: int | None = None,
        max_waiters: int | None = None,
    ) -> None:
        cdef int64_t cache_time_ns = DEFAULT_CACHE_TIME_NS
        cdef Limits limits
        limits.frames = limit("max_frames", max_frames)
        limits.bytes = limit("max_bytes", max_bytes)
        limits.waiters = limit("max_waiters", max_waiters)
        if cache_time is not None:
            cache_time_ns = duration_or_seconds(cache_time, "cache_time")
        if cache_time_ns < 0:
            raise ValueError(f"cache_time must not be negative, it is {errors.seconds(cache_time_ns)} s")
        self.start_over(cache_time_ns, &limits)

    # Inserting transforms.

    cdef int _set_one(self, object transform, object authority, bint is_static) except -1:
        cdef Entry entry
        cdef Batch batch
        cdef Py_ssize_t size
        # Whatever the names point into stays alive: the slots of `transform`, or what `keep` holds.
        cdef list keep = []
        read_transform_stamped(transform, &entry.incoming, keep)
        memset(&batch, 0, sizeof(Batch))
        batch.entries = &entry
        batch.count = 1
        batch.is_static = is_static
        batch.authority = authority_utf8(authority, &size)
        batch.authority_size = size
        self.insert(&batch)
        return self.report(&batch, None) if batch.needs_report else 0

    def set_transform(self, transform: TransformStamped, authority: str) -> None:
        """
        Add one dynamic transform.

        :param transform: a ``geometry_msgs/TransformStamped`` or an object with its fields.
            The translation is in metres, the rotation a quaternion x y z w. The stamp 0 is a stamp like any
            other.
        :param str authority: who publishes it; listings and log lines show it.
        :raises TypeError: an object lacks a field, or a value has the wrong type.
        :raises ValueError: a name holds a NUL character.
        :raises OverflowError: the stamp does not fit into 64-bit nanoseconds.

        A transform that is refused (no names, NaN, too old, ...) is logged and counted, not raised.
        """
        self._set_one(transform, authority, False)

    def set_transform_static(self, transform: TransformStamped, authority: str) -> None:
        """Add one transform that holds at all times; otherwise as :meth:`set_transform`."""
        self._set_one(transform, authority, True)

    def set_transforms(
        self, transforms: Iterable[TransformStamped], authority: str, static: bool = False
    ) -> int:
        """
        Add many transforms; other threads may see the first ones before the last ones are added.

        :param transforms: an iterable of what :meth:`set_transform` accepts.
        :param str authority: as for :meth:`set_transform`.
        :param bool static: whether they hold at all times.
        :return: how many were added; the others are logged and counted.
        :raises TypeError, ValueError, OverflowError: as :meth:`set_transform`, before anything is added.
        """
        cdef list messages = list(transforms)
        cdef list keep = []
        cdef Batch batch
        cdef Py_ssize_t size, i
        memset(&batch, 0, sizeof(Batch))
        if batch_reserve(&batch, len(messages)) != 0:
            raise MemoryError
        try:
            batch.count = len(messages)
            batch.is_static = static
            for i in range(len(messages)):
                read_transform_stamped(messages[i], &batch.entries[i].incoming, keep)
            batch.authority = authority_utf8(authority, &size)
            batch.authority_size = size
            self.insert(&batch)
            if batch.needs_report:
                self.report(&batch, None)
            return batch.taken
        finally:
            batch_free(&batch)

    def set_transforms_cdr(
        self, data: bytes | bytearray | memoryview, authority: str, static: bool = False
    ) -> int:
        """
        Add the transforms of one serialised ``tf2_msgs/TFMessage``.

        :param data: bytes-like: plain CDR of either byte order, with its encapsulation header.
        :param str authority: as for :meth:`set_transform`.
        :param bool static: whether they hold at all times.
        :return: how many were added; the others are logged and counted.
        :raises TypeError: ``data`` is not bytes-like.
        :raises BufferError: its bytes are not in one piece.
        :raises ValueError: ``data`` is malformed; nothing is added.
        """
        cdef Py_buffer view
        cdef Batch batch
        cdef Py_ssize_t size
        memset(&batch, 0, sizeof(Batch))
        batch.is_static = static
        batch.authority = authority_utf8(authority, &size)
        batch.authority_size = size
        PyObject_GetBuffer(data, &view, PyBUF_SIMPLE)
        try:
            if batch_read_cdr(&batch, <const unsigned char*>view.buf, view.len):
                self.insert(&batch)
            elif batch.problem != NULL:
                raise self.malformed(&batch, view.len)
            if batch.needs_report or batch.no_memory:
                self.report(&batch, None)
            return batch.taken
        finally:
            batch_free(&batch)
            PyBuffer_Release(&view)

    def clear(self) -> None:
        """Remove every dynamic transform; names, authorities and static transforms stay."""
        self.forget()

    # Travelling: pickles, copies, files.

    def __reduce__(self):
        return _without_init, (type(self),), self.__getstate__()

    def __getstate__(self) -> dict[str, Any]:
        """
        What a pickle or copy of this buffer is made of, as of one moment; other threads may go on inserting.

        :return: a dict of everything that answers, listings and later inserts depend on, with the samples as
            NumPy arrays, and under ``"attributes"`` those of a subclass. Pending waits do not travel.
        """
        cdef dict state = self.export()
        state["attributes"] = attributes_of(self)
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        """
        Become the buffer that such a state says; pending waits go on.

        :raises ValueError: it is of another version, or no state that a buffer can have. Then, as with any
            other error, nothing has changed.
        """
        cdef dict core
        if type(state) is not dict:
            raise ValueError(f"not the state of a buffer: it is no dict but {type(state).__name__}")
        core = dict(state)
        attributes = core.pop("attributes", None)
        check_attributes(self, attributes)
        self.restore(core)
        set_attributes(self, attributes)

    def save(self, path: str | os.PathLike[str]) -> None:
        """
        Write this buffer as of now to an ``.mcap`` file, which any tool for recordings opens.

        The transforms are ordinary messages on ``/tf`` and ``/tf_static``, in the order of their stamps;
        what a message cannot hold is metadata of the file. :meth:`load` gives the same buffer back. A file
        of that name is replaced once the new one is whole. Attributes of a subclass are not saved.

        :raises OSError: it cannot be written; what was there before stays.
        :raises ModuleNotFoundError: the library mcap is missing: ``pip install 'tf2-ros-cython[bag]'``.
        """
        from tf2_py._objects.saved import save_state
        save_state(self.export(), path)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> BufferCore:
        """
        Make a buffer of a file that :meth:`save` wrote: its answers are the same to the last bit.

        ``__init__`` is not called. Recordings that something else wrote are read by ``tf2_ros.bag.load``.

        :raises FileNotFoundError, OSError: it cannot be read.
        :raises ValueError: it holds no buffer, or is damaged; the text names the file.
        :raises ModuleNotFoundError: as of :meth:`save`.
        """
        from tf2_py._objects.saved import load_state
        loaded = _without_init(cls)
        state = load_state(path)
        try:
            loaded.__setstate__(state | {"attributes": {}})
        except ValueError as error:
            raise ValueError(f"{printable(os.fspath(path))}: {error}") from None
        return loaded

    # Looking transforms up.

    cdef int _lookup_or_raise(self, const Query* query, Transform* out, int64_t* stamp_ns) except -1:
        cdef Status status = self.lookup(query, out, stamp_ns)
        if status.code != STATUS_OK:
            raise self.error(query, status)
        return 0

    cdef tuple _can(self, const Query* query):
        cdef int64_t stamp_ns
        cdef Status status = self.lookup(query, NULL, &stamp_ns)
        if status.code == STATUS_OK:
            return (1, "")
        return (0, str(self.error(query, status, "canTransform")))

    def lookup_transform_core(self, target_frame: str, source_frame: str, time: Time) -> TransformStamped:
        """
        Get the pose of ``source_frame`` in ``target_frame``: it carries data from the source to the target.

        A point at p in ``source_frame`` is at R p + t in ``target_frame``: R and t are the rotation and the
        translation returned. ``Time()``, which is 0, asks for the latest time for which all frames on the
        path have data.

        :param str target_frame: the frame that the data is wanted in.
        :param str source_frame: the frame that the data is in.
        :param time: when; 0: the latest common time.
        :return: a ``geometry_msgs/TransformStamped`` with the stamp looked up, ``frame_id`` the target and
            ``child_frame_id`` the source; metres, unit quaternion.
        :raises LookupException: a frame is unknown, or the tree contains a loop.
        :raises ConnectivityException: the frames are in different trees.
        :raises ExtrapolationException: a frame on the path has no data for the time.
        :raises InvalidArgumentException: a name is empty or begins with ``/``.
        :raises TypeError, ValueError, OverflowError: an argument is of a wrong type or cannot be a name or a
            time: see the class.
        """
        cdef Query query
        cdef Transform transform
        cdef int64_t stamp_ns
        query_fill(&query, target_frame, source_frame, time)
        self._lookup_or_raise(&query, &transform, &stamp_ns)
        return new_transform_stamped(&transform, stamp_ns, target_frame, source_frame)

    def lookup_transform_full_core(
        self, target_frame: str, target_time: Time, source_frame: str, source_time: Time, fixed_frame: str
    ) -> TransformStamped:
        """
        Get the pose of ``source_frame`` at ``source_time`` in ``target_frame`` at ``target_time``.

        It carries data from the source to the target: a point at p in ``source_frame`` at the one time is at
        R p + t in ``target_frame`` at the other, if ``fixed_frame`` does not move meanwhile. ``Time()``,
        which is 0, asks for the latest time.

        :param target_time: when the target frame is looked at; 0: the latest common time of it and the fixed
            frame.
        :param source_time: when the source frame is looked at; 0: likewise.
        :param str fixed_frame: the frame that is assumed not to move between the two times.

        The answer's stamp is the target's time; otherwise as :meth:`lookup_transform_core`.
        """
        cdef Query query
        cdef Transform transform
        cdef int64_t stamp_ns
        query_fill_full(&query, target_frame, target_time, source_frame, source_time, fixed_frame)
        self._lookup_or_raise(&query, &transform, &stamp_ns)
        return new_transform_stamped(&transform, stamp_ns, target_frame, source_frame)

    def lookup_transforms(
        self,
        target_frame: str,
        source_frame: str,
        times: ArrayLike | Sequence[Time],
        *,
        fixed_frame: str | None = None,
        target_time: Time | None = None,
        on_missing: Literal["raise", "nan"] = "raise",
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """
        Look one transform up at many times, with the results of as many single lookups.

        :param times: N times: integer nanoseconds or datetime64 (array-like of shape (N,), also a column of a
            data frame), or a sequence of time objects; 0 is the latest common time.
        :param fixed_frame: with ``target_time``, a two-time lookup: the source at each of ``times``, the
            target at ``target_time``.
        :param on_missing: ``'raise'`` raises the error of the first time without an answer, with its index;
            ``'nan'`` fills in NaN there. Unknown and invalid names always raise.
        :return: ``(translations, rotations)``: float64 arrays of shape (N, 3), metres, and (N, 4), x y z w.
        :raises TransformException: as :meth:`lookup_transform_core`.
        :raises TypeError: ``times`` are no times, or ``fixed_frame`` and ``target_time`` are not both given.
        :raises ValueError: ``times`` have not one dimension, are NaT or do not fit into 64 bits, or
            ``on_missing`` is neither.

        Other threads run meanwhile: the GIL is released.
        """
        cdef Query query
        cdef TimeSeries series
        cdef const int64_t[::1] times_ns = as_times_ns(times)
        cdef double[:, ::1] translations, rotations
        series.count = times_ns.shape[0]
        translations_array, rotations_array = new_rows(series.count, 3), new_rows(series.count, 4)
        if on_missing not in ("raise", "nan"):
            raise ValueError(f"on_missing must be 'raise' or 'nan', not {on_missing!r}")
        query_fill_series(&query, target_frame, source_frame, fixed_frame, target_time)
        if series.count:
            translations, rotations = translations_array, rotations_array
            series.times_ns = &times_ns[0]
            series.translations = &translations[0, 0]
            series.rotations = &rotations[0, 0]
            series.points = NULL
            series.transformed = NULL
            series.nan_missing = on_missing == "nan"
            self._lookup_series(&query, &series)
        return translations_array, rotations_array

    def transform_points(
        self,
        points: NDArray[np.floating],
        times: ArrayLike | Sequence[Time],
        target_frame: str,
        source_frame: str,
        *,
        fixed_frame: str | None = None,
        target_time: Time | None = None,
    ) -> NDArray[np.floating]:
        """
        Transform each point with the transform of its own time.

        :param points: array-like of shape (N, 3), metres, each in ``source_frame`` at its time; float32,
            float64 or integers.
        :param times: N times. This and the other arguments are as in :meth:`lookup_transforms`.
        :return: an array of shape (N, 3) of the points' dtype, or float64 of integers, in ``target_frame``.
        :raises TransformException: as :meth:`lookup_transform_core`, with the index of the time.
        :raises TypeError: the points are of another dtype; otherwise as :meth:`lookup_transforms`.
        :raises ValueError: ``points`` is not of shape (N, 3); otherwise as :meth:`lookup_transforms`.
        """
        cdef Query query
        cdef TimeSeries series
        cdef const int64_t[::1] times_ns
        cdef const double[:, ::1] rows
        cdef double[:, ::1] transformed
        rows_array, dtype = as_points(points)
        times_ns = as_times_ns(times)
        series.count = times_ns.shape[0]
        if len(rows_array) != series.count:
            raise ValueError(f"{len(rows_array)} points, {series.count} times: each point needs its own time")
        transformed_array = new_rows(series.count, 3)
        query_fill_series(&query, target_frame, source_frame, fixed_frame, target_time)
        if series.count:
            rows, transformed = rows_array, transformed_array
            series.times_ns = &times_ns[0]
            series.points = &rows[0, 0]
            series.transformed = &transformed[0, 0]
            series.translations = NULL
            series.rotations = NULL
            series.nan_missing = False
            self._lookup_series(&query, &series)
        return transformed_array.astype(dtype, copy=False)

    cdef int _lookup_series(self, Query* query, const TimeSeries* series) except -1:
        cdef Py_ssize_t answered
        cdef Status status
        with nogil:
            answered = self.lookup_series(query, series, &status)
        if answered < series.count:
            error = self.error(query, status)
            raise error if answered < 0 else type(error)(f"times[{answered}]: {error}")
        return 0

    def can_transform_core(self, target_frame: str, source_frame: str, time: Time) -> tuple[int, str]:
        """
        Whether :meth:`lookup_transform_core` would return: ``(1, '')``, or ``(0, reason)``.

        An invalid name is a reason; ``TypeError``, ``ValueError`` and ``OverflowError`` are raised.
        """
        cdef Query query
        query_fill(&query, target_frame, source_frame, time)
        return self._can(&query)

    def can_transform_full_core(
        self, target_frame: str, target_time: Time, source_frame: str, source_time: Time, fixed_frame: str
    ) -> tuple[int, str]:
        """Whether :meth:`lookup_transform_full_core` would return; as :meth:`can_transform_core`."""
        cdef Query query
        query_fill_full(&query, target_frame, target_time, source_frame, source_time, fixed_frame)
        return self._can(&query)

    def get_latest_common_time(self, target_frame: str, source_frame: str) -> Time:
        """
        The newest time at which every dynamic frame between the two has data; 0 where all are static.

        :return: an ``rclpy.time.Time`` of clock type ``SYSTEM_TIME``.
        :raises TransformException: there is no path between the frames.
        :raises LookupException: a frame is unknown.
        :raises InvalidArgumentException: a name is empty or begins with ``/``.
        """
        return new_time(self._common_time(target_frame, source_frame))

    cdef int64_t _common_time(self, target_frame, source_frame) except? -1:
        cdef Query query
        cdef int64_t common_ns = 0
        cdef Status status
        query_frames(&query, target_frame, source_frame)
        status = self.common_time(&query, &common_ns)
        if status.code == STATUS_OK:
            return common_ns
        error = self.error(&query, status, "get_latest_common_time")
        if status.code == STATUS_UNCONNECTED or status.code == STATUS_LOOP:
            raise errors.TransformException(str(error))
        raise error

    def lookupVelocityCore(
        self, tracking_frame: str, observation_frame: str, time: Time, averaging_interval: Duration
    ) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        """
        The twist of ``tracking_frame``'s origin relative to ``observation_frame``, in the axes of the latter.

        As :meth:`lookupVelocityFullCore` with the observation frame as reference frame.
        """
        return self.lookupVelocityFullCore(
            tracking_frame, observation_frame, observation_frame, (0.0, 0.0, 0.0), tracking_frame, time,
            averaging_interval,
        )

    def lookupVelocityFullCore(
        self,
        tracking_frame: str,
        observation_frame: str,
        reference_frame: str,
        reference_point: Sequence[float],
        reference_point_frame: str,
        time: Time,
        averaging_interval: Duration,
    ) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        """
        The mean twist of ``tracking_frame`` relative to ``observation_frame`` around a time.

        :param reference_frame: the twist is expressed in the axes of this frame.
        :param reference_point: three floats, metres, in ``reference_point_frame``: the linear velocity
            is that of the point of the tracking frame's body that is there at ``time``.
        :param reference_point_frame: a frame name.
        :param time: the middle of the interval; 0 is the time 0, not the latest common time.
        :param averaging_interval: a duration; the interval ends at the latest common time at the latest. 0
            gives NaN.
        :return: ``((vx, vy, vz), (wx, wy, wz))`` in m/s and rad/s.
        :raises TransformException: as :meth:`lookup_transform_core`, for one of the lookups that it needs.
        :raises ValueError: ``averaging_interval`` is negative, or the point has not three numbers.

        Angular: the rotation vector between the two poses over the time between them. Linear: the chord
        of the origin over that time, plus angular x (reference point - origin).
        """
        # At least 1: a lookup would take 0 for "latest".
        cdef int64_t time_ns = max(stamp_nanoseconds(time, "time"), 1)
        cdef int64_t interval_ns = duration_nanoseconds(averaging_interval, "averaging_interval")
        cdef int64_t start_ns, end_ns, common_ns
        cdef Transform start, end, middle, point_frame, reference
        cdef double point[3]
        cdef double linear[3]
        cdef double angular[3]
        if interval_ns < 0:
            raise ValueError("averaging_interval must not be negative")
        point[0], point[1], point[2] = reference_point
        common_ns = self._common_time(observation_frame, tracking_frame)
        start_ns = max(time_ns - interval_ns // 2, 1)
        end_ns = time_ns + (interval_ns - interval_ns // 2)
        if common_ns and end_ns > common_ns:
            end_ns = common_ns
        self._transform_at(observation_frame, tracking_frame, start_ns, &start)
        self._transform_at(observation_frame, tracking_frame, end_ns, &end)
        self._transform_at(observation_frame, tracking_frame, time_ns, &middle)
        self._transform_at(observation_frame, reference_point_frame, time_ns, &point_frame)
        self._transform_at(reference_frame, observation_frame, time_ns, &reference)
        twist_of_point(&start, &end, <double>(end_ns - start_ns) * 1e-9, &middle, &point_frame, point,
                       &reference, linear, angular)
        return (linear[0], linear[1], linear[2]), (angular[0], angular[1], angular[2])

    cdef int _transform_at(self, target_frame, source_frame, int64_t time_ns, Transform* out) except -1:
        cdef Query query
        cdef int64_t stamp_ns
        query_frames(&query, target_frame, source_frame)
        query.source_ns = time_ns
        return self._lookup_or_raise(&query, out, &stamp_ns)

    # Waiting.

    def _wait(
        self,
        target_frame: str,
        source_frame: str,
        time: Time,
        fixed_frame: str | None = None,
        target_time: Time | None = None,
        notify: Callable[[TransformStamped], Any] | None = None,
    ) -> Wait:
        """
        Wait for a lookup: the simple one, or with ``fixed_frame`` and ``target_time`` the one at two times.

        :param notify: called with the answer, once, by the thread that inserts what was missing; not called
            where the answer is available at once. It runs no code of a user; it may return a callable that
            does, which a thread of the user calls at once and a receiver hands over. None:
            :meth:`Wait.wait_for` waits.
        :return: a ``Wait``; its ``answer`` may be available at once.
        :raises InvalidArgumentException: a name is empty or begins with ``/``: the wait would never end.
        :raises TransformException: ``max_waiters`` lookups wait already.
        """
        cdef Query query
        cdef Wait wait = Wait.__new__(Wait)
        if fixed_frame is None:
            query_fill(&query, target_frame, source_frame, time)
        else:
            query_fill_full(&query, target_frame, target_time, source_frame, time, fixed_frame)
        wait.begin(self, (target_frame, source_frame, fixed_frame), &query, notify)
        if self._begin_following is not None and self._follows():
            self._begin_following()
        return wait

    def _pending_waits(self, size_t most=1000) -> list[str]:
        """
        One line for each pending wait, at most so many: what it waits for, and what it lacks now.

        For debugging. Names are escaped as in errors. Inserts wait while up to ``most`` pointers are copied.
        """
        return [wait.lacks() for wait in self.pending(most)]

    # Listing frames, and counts.

    def __repr__(self):
        cdef int64_t oldest_ns = 0
        cdef int64_t newest_ns = 0
        cdef bint has_dynamic
        with nogil:
            has_dynamic = self.span(&oldest_ns, &newest_ns)
        return listings.as_line(type(self), self.counts(), newest_ns - oldest_ns if has_dynamic else None)

    def __contains__(self, name):
        """Whether this is the name of a frame, that of a parent included; False for all but a ``str``."""
        cdef Py_ssize_t size
        cdef const char* text
        if not isinstance(name, str):
            return False
        try:
            text = name_utf8(name, &size)
        except ValueError:
            return False    # it holds a NUL or a lone surrogate: no frame can
        return self.find_name(text, size) not in (NAME_UNKNOWN, NO_FRAME)

    def frames(self) -> dict[str, FrameInfo]:
        """
        What this buffer holds of each frame, in the order in which their names were first used.

        :return: a dict from name to a named tuple :class:`FrameInfo`: ``parent``, ``static``, ``count``,
            ``oldest_ns``, ``newest_ns``.

        The times are exact: with a lookup of the frame in its parent, ``oldest_ns`` and ``newest_ns`` are the
        earliest and the latest time that have an answer. Roots are listed, too. Other threads may change the
        buffer meanwhile: of more than 1024 frames it is no snapshot. Its cost grows with their number.
        """
        return listings.as_frames(self.frame_facts(True))

    def tree(self) -> str:
        """
        The frames as indented text: under each frame those whose parent it is, with their samples.

        A frame is under the parent of its newest sample. Frames whose parents form a loop stand at the end,
        marked. As :meth:`frames` otherwise.
        """
        return tree_text(listings.as_frames(self.frame_facts(True)))

    def all_frames_as_yaml(self) -> str:
        """
        The frames that hold data as YAML: parent, broadcaster, rate (Hz), times (s), buffer length (s).

        A listing of more than 1024 frames is no snapshot: other threads may change the buffer between parts.
        """
        return listings.as_yaml(self.frame_facts())

    def all_frames_as_string(self) -> str:
        """One sentence for each frame that was ever a child; otherwise as :meth:`all_frames_as_yaml`."""
        return listings.as_string(self.frame_facts())

    def _allFramesAsDot(self, time: Time | None = None) -> str:
        """
        The frames that hold data as a Graphviz digraph; otherwise as :meth:`all_frames_as_yaml`.

        :param time: ages are as of this time; None or 0: no ages.
        """
        cdef int64_t time_ns = 0 if time is None else nanoseconds(time, "time")
        return listings.as_dot(self.frame_facts(), time_ns)

    def _frameExists(self, name: str) -> bool:
        """Whether the name was ever a parent or a child."""
        cdef Py_ssize_t size
        cdef const char* text = name_utf8(name, &size)
        return self.find_name(text, size) != NAME_UNKNOWN

    def _getFrameStrings(self) -> list[str]:
        """Every frame name, in the order of first appearance."""
        return self._known_names()

    def _chain(
        self, target_frame: str, target_time: Time, source_frame: str, source_time: Time, fixed_frame: str
    ) -> list[str]:
        """The frames from source up to the common ancestor and down to target, each once."""
        return chain_between(
            self, target_frame, stamp_nanoseconds(target_time, "target_time"), source_frame,
            stamp_nanoseconds(source_time, "source_time"), fixed_frame,
        )

    def statistics(self) -> dict[str, Any]:
        """
        What this buffer has done and holds.

        :return: a dict: how many transforms were ``taken``, and ``refused`` by reason; how many ``frames``
            and ``samples`` it holds and the ``bytes`` allocated for them; how many ``waiters`` are pending;
            ``waits_refused``, ``malformed_messages``.
        """
        return self.counts()

    def _self_check(self) -> None:
        """Check the tree, histories and waiters; AssertionError names an invariant that does not hold."""
        cdef const char* problem = self.check()
        if problem != NULL:
            raise AssertionError(problem.decode())


def _without_init(cls):
    """
    An empty buffer of a class whose ``__init__`` is not called: its state is to follow.

    Pickles name this function.
    """
    return BufferCore.__new__(cls)
