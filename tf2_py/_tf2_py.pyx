"""The binding of the engine: BufferCore checks arguments, locks, calls, raises."""

from cpython.buffer cimport PyBUF_SIMPLE, PyBuffer_Release, PyObject_GetBuffer
from libc.stdint cimport int64_t, uint32_t
from libc.string cimport memset

from tf2_py._core.geometry cimport vector_rotate
from tf2_py._core.lookup cimport Query
from tf2_py._core.series cimport TimeSeries
from tf2_py._core.tree cimport Limits
from tf2_py._core.twist cimport twist_between
from tf2_py._core.types cimport STATUS_LOOP, STATUS_OK, STATUS_UNCONNECTED, Status, Transform
from tf2_py._core.walk cimport Path
from tf2_py._engine.engine cimport DEFAULT_CACHE_TIME_NS, Engine
from tf2_py._engine.wait cimport Wait
from tf2_py._objects.arguments cimport (
    query_fill,
    query_fill_full,
    query_fill_series,
    query_frames,
    query_time,
)
from tf2_py._objects.messages cimport name_utf8, new_transform_stamped, read_transform_stamped
from tf2_py._objects.times cimport nanoseconds, new_time
from tf2_py._wire.batch cimport Batch, Entry, batch_free, batch_read_cdr, batch_reserve

from tf2_py._objects import errors, listings
from tf2_py._objects.arrays import as_points, as_times_ns, new_rows
# Programs catch them by the name of tf2's extension module, too.
from tf2_py._objects.errors import (
    ConnectivityException,
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
    TimeoutException,
    TransformException,
)
from tf2_py._objects.limits import limit

__all__ = [
    "BufferCore",
    "ConnectivityException",
    "ExtrapolationException",
    "InvalidArgumentException",
    "LookupException",
    "TimeoutException",
    "TransformException",
]


cdef class BufferCore(Engine):
    """
    A tree of coordinate frames that moves in time, as tf2 keeps it.

    :param cache_time: how far each frame's history reaches back; anything with ``nanoseconds`` or with
        ``sec`` and ``nanosec``. Default 10 s.
    :param int max_frames: names of frames. Default: a million.
    :param int max_bytes: of memory for names and histories. Default: 1 GiB.
    :param int max_waiters: lookups that wait. Default: a hundred thousand.

    Transforms that would exceed a limit are refused, counted and logged; a wait that would is a
    ``TransformException``. What is there goes on to answer. The environment's ``TF2_ROS_CYTHON_MAX_FRAMES``,
    ``TF2_ROS_CYTHON_MAX_BYTES`` and ``TF2_ROS_CYTHON_MAX_WAITERS`` set other defaults.

    Frame names are ``str``. Times are anything with ``nanoseconds``, or with ``sec`` and ``nanosec``; time 0
    asks for the latest time that every frame on the path knows; one that no message can carry, whose seconds
    have 32 bits, is an ``OverflowError``. Every method may be called from any thread.
    Calling ``__init__`` again empties the buffer; whoever waits goes on waiting.
    """

    def __init__(self, cache_time=None, *, max_frames=None, max_bytes=None, max_waiters=None):
        cdef int64_t cache_time_ns = DEFAULT_CACHE_TIME_NS
        cdef Limits limits
        limits.frames = limit("max_frames", max_frames)
        limits.bytes = limit("max_bytes", max_bytes)
        limits.waiters = limit("max_waiters", max_waiters)
        if cache_time is not None:
            cache_time_ns = nanoseconds(cache_time, "cache_time")
        if cache_time_ns < 0:
            raise ValueError(f"cache_time must not be negative, it is {errors.seconds(cache_time_ns)} s")
        self.start_over(cache_time_ns, &limits)

    # What comes in.

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
        batch.authority = name_utf8(authority, &size)
        batch.authority_size = size
        self.insert(&batch)
        return self.report(&batch, None) if batch.needs_report else 0

    def set_transform(self, transform, authority):
        """
        Add one dynamic transform.

        :param transform: a ``geometry_msgs/TransformStamped`` or an object with its fields.
        :param str authority: who says so; listings show it.

        A transform that cannot be taken (no names, NaN, too old, ...) is logged and counted, not raised.
        """
        self._set_one(transform, authority, False)

    def set_transform_static(self, transform, authority):
        """Add one transform that holds at every time; otherwise as :meth:`set_transform`."""
        self._set_one(transform, authority, True)

    def set_transforms(self, transforms, authority, static=False):
        """
        Add many transforms. Other threads may find a part of them meanwhile.

        :param transforms: an iterable of what :meth:`set_transform` takes.
        :return: how many were taken; the others are logged and counted.

        Where an element is no transform, the ``TypeError`` comes before anything is added.
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
            batch.authority = name_utf8(authority, &size)
            batch.authority_size = size
            self.insert(&batch)
            if batch.needs_report:
                self.report(&batch, None)
            return batch.taken
        finally:
            batch_free(&batch)

    def set_transforms_cdr(self, data, authority, static=False):
        """
        Add the transforms of one serialised ``tf2_msgs/TFMessage``.

        :param data: bytes-like, plain CDR of either byte order, with its encapsulation header.
        :return: how many were taken; the others are logged and counted.
        :raises ValueError: the data is malformed; nothing is added.
        """
        cdef Py_buffer view
        cdef Batch batch
        cdef Py_ssize_t size
        memset(&batch, 0, sizeof(Batch))
        batch.is_static = static
        batch.authority = name_utf8(authority, &size)
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

    def clear(self):
        """Forget every dynamic transform; names, authorities and static transforms stay."""
        self.forget()

    # What goes out.

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

    def lookup_transform_core(self, target_frame, source_frame, time):
        """
        Get the transform that carries data from ``source_frame`` into ``target_frame``.

        :return: a ``geometry_msgs/TransformStamped`` with the stamp looked up, ``frame_id`` the target and
            ``child_frame_id`` the source; metres, unit quaternion.
        :raises LookupException: a frame is unknown, or the tree contains a loop.
        :raises ConnectivityException: the frames are in different trees.
        :raises ExtrapolationException: a frame on the path has no data for the time.
        :raises InvalidArgumentException: a name is empty or begins with ``/``.
        """
        cdef Query query
        cdef Transform transform
        cdef int64_t stamp_ns
        query_fill(&query, target_frame, source_frame, time)
        self._lookup_or_raise(&query, &transform, &stamp_ns)
        return new_transform_stamped(&transform, stamp_ns, target_frame, source_frame)

    def lookup_transform_full_core(self, target_frame, target_time, source_frame, source_time, fixed_frame):
        """
        Get the transform from ``source_frame`` at ``source_time`` into ``target_frame`` at ``target_time``.

        :param fixed_frame: the frame that is taken to stand still between the two times.

        Stamped with the target's time; otherwise as :meth:`lookup_transform_core`.
        """
        cdef Query query
        cdef Transform transform
        cdef int64_t stamp_ns
        query_fill_full(&query, target_frame, target_time, source_frame, source_time, fixed_frame)
        self._lookup_or_raise(&query, &transform, &stamp_ns)
        return new_transform_stamped(&transform, stamp_ns, target_frame, source_frame)

    def lookup_transforms(self, target_frame, source_frame, times, *, fixed_frame=None, target_time=None,
                          on_missing="raise"):
        """
        Look one transform up at many times, with the numbers of as many single lookups.

        :param times: N times: integer nanoseconds (array-like of shape (N,)) or a sequence of time objects.
        :param fixed_frame: with ``target_time``, a two-time lookup: the source at each of ``times``, the
            target at ``target_time``.
        :param on_missing: ``'raise'`` raises what the first time without an answer raises, and names its
            index; ``'nan'`` fills NaN there. Names that are no known frames always raise.
        :return: ``(translations, rotations)``: float64 arrays of shape (N, 3), metres, and (N, 4), x y z w.

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
            series.carried = NULL
            series.nan_missing = on_missing == "nan"
            self._lookup_series(&query, &series)
        return translations_array, rotations_array

    def transform_points(self, points, times, target_frame, source_frame, *, fixed_frame=None,
                         target_time=None):
        """
        Carry each point with the transform of its own time.

        :param points: array-like of shape (N, 3), metres, in ``source_frame`` at its time; float32 or
            float64.
        :param times: N times, as in :meth:`lookup_transforms`; so are the other arguments.
        :return: an array of shape (N, 3) of the points' dtype, in ``target_frame``.
        """
        cdef Query query
        cdef TimeSeries series
        cdef const int64_t[::1] times_ns = as_times_ns(times)
        cdef const double[:, ::1] rows
        cdef double[:, ::1] carried
        rows_array, dtype = as_points(points)
        series.count = times_ns.shape[0]
        if len(rows_array) != series.count:
            raise ValueError(f"{len(rows_array)} points, {series.count} times: each point needs its own time")
        carried_array = new_rows(series.count, 3)
        query_fill_series(&query, target_frame, source_frame, fixed_frame, target_time)
        if series.count:
            rows, carried = rows_array, carried_array
            series.times_ns = &times_ns[0]
            series.points = &rows[0, 0]
            series.carried = &carried[0, 0]
            series.translations = NULL
            series.rotations = NULL
            series.nan_missing = False
            self._lookup_series(&query, &series)
        return carried_array.astype(dtype, copy=False)

    cdef int _lookup_series(self, Query* query, const TimeSeries* series) except -1:
        cdef Py_ssize_t answered
        cdef Status status
        with nogil:
            answered = self.lookup_series(query, series, &status)
        if answered < series.count:
            error = self.error(query, status)
            raise error if answered < 0 else type(error)(f"times[{answered}]: {error}")
        return 0

    def can_transform_core(self, target_frame, source_frame, time):
        """Whether :meth:`lookup_transform_core` would answer: ``(1, '')`` or ``(0, reason)``."""
        cdef Query query
        query_fill(&query, target_frame, source_frame, time)
        return self._can(&query)

    def can_transform_full_core(self, target_frame, target_time, source_frame, source_time, fixed_frame):
        """Whether :meth:`lookup_transform_full_core` would answer: ``(1, '')`` or ``(0, reason)``."""
        cdef Query query
        query_fill_full(&query, target_frame, target_time, source_frame, source_time, fixed_frame)
        return self._can(&query)

    def get_latest_common_time(self, target_frame, source_frame):
        """
        The newest time at which every dynamic frame between the two has data; 0 where all are static.

        :return: an ``rclpy.time.Time`` of clock type ``SYSTEM_TIME``.
        :raises TransformException: there is no path between the frames.
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

    def lookupVelocityCore(self, tracking_frame, observation_frame, time, averaging_interval):
        """
        The twist of ``tracking_frame``'s origin relative to ``observation_frame``, in the axes of the latter.

        As :meth:`lookupVelocityFullCore` with the observation frame as reference frame.
        """
        return self.lookupVelocityFullCore(
            tracking_frame, observation_frame, observation_frame, (0.0, 0.0, 0.0), tracking_frame, time,
            averaging_interval,
        )

    def lookupVelocityFullCore(self, tracking_frame, observation_frame, reference_frame, reference_point,
                               reference_point_frame, time, averaging_interval):
        """
        The mean twist of ``tracking_frame`` relative to ``observation_frame`` around a time.

        :param reference_frame: the twist is expressed in the axes of this frame.
        :param reference_point: three floats, metres, in ``reference_point_frame``: the linear velocity
            is that of the point of the tracking frame's body that is there at ``time``.
        :param time: the middle of the interval; 0 is the time 0, not "latest".
        :param averaging_interval: a duration; the interval ends at the newest common stamp at the latest. 0
            gives NaN.
        :return: ``((vx, vy, vz), (wx, wy, wz))`` in m/s and rad/s.

        Angular: the rotation vector between the two poses over the time between them. Linear: the chord
        of the origin over that time, plus angular x (reference point - origin).
        """
        cdef int64_t time_ns = max(query_time(time, "time"), 1)     # a lookup would take 0 for "latest"
        cdef int64_t interval_ns = nanoseconds(averaging_interval, "averaging_interval")
        cdef int64_t start_ns, end_ns, common_ns
        cdef Transform start, end, origin, point_frame, reference
        cdef double point[3]
        cdef double linear[3]
        cdef double angular[3]
        cdef int i
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
        self._transform_at(observation_frame, tracking_frame, time_ns, &origin)
        self._transform_at(observation_frame, reference_point_frame, time_ns, &point_frame)
        self._transform_at(reference_frame, observation_frame, time_ns, &reference)
        twist_between(&start, &end, <double>(end_ns - start_ns) * 1e-9, linear, angular)
        # From the origin to the reference point, in the observation frame.
        vector_rotate(point_frame.rotation, point, point)
        for i in range(3):
            point[i] += point_frame.translation[i] - origin.translation[i]
        linear[0] += angular[1] * point[2] - angular[2] * point[1]
        linear[1] += angular[2] * point[0] - angular[0] * point[2]
        linear[2] += angular[0] * point[1] - angular[1] * point[0]
        vector_rotate(reference.rotation, linear, linear)
        vector_rotate(reference.rotation, angular, angular)
        return (linear[0], linear[1], linear[2]), (angular[0], angular[1], angular[2])

    cdef int _transform_at(self, target_frame, source_frame, int64_t time_ns, Transform* out) except -1:
        cdef Query query
        cdef int64_t stamp_ns
        query_frames(&query, target_frame, source_frame)
        query.source_ns = time_ns
        return self._lookup_or_raise(&query, out, &stamp_ns)

    # Who waits.

    def _wait(self, target_frame, source_frame, time, fixed_frame=None, target_time=None, notify=None):
        """
        Wait for a lookup: the simple one, or with ``fixed_frame`` and ``target_time`` that of two times.

        :param notify: called with the answer, once, by the thread that inserts what was missing, and not
            where the answer is available at once. It runs no code of a user; it may return a callable that
            does. A thread of the user calls that at once, a receiver hands it over. None:
            :meth:`Wait.wait_for` waits.
        :return: a ``Wait``; its ``answer`` may be there at once.
        :raises InvalidArgumentException: a name is empty or begins with ``/``: that would never end.
        """
        cdef Query query
        cdef Wait wait = Wait.__new__(Wait)
        if fixed_frame is None:
            query_fill(&query, target_frame, source_frame, time)
        else:
            query_fill_full(&query, target_frame, target_time, source_frame, time, fixed_frame)
        wait.begin(self, (target_frame, source_frame, fixed_frame), &query, notify)
        return wait

    def _pending_waits(self, size_t most=1000):
        """
        One line for each pending wait, at most so many: what it waits for, and what it lacks now.

        For debugging. Names are escaped as in errors. Inserts wait while up to ``most`` pointers are copied.
        """
        return [wait.lacks() for wait in self.pending(most)]

    # What is known.

    def all_frames_as_yaml(self):
        """
        The frames that hold data as YAML: parent, broadcaster, rate (Hz), times (s), buffer length (s).

        Beyond 1024 frames they need not be of one moment: others use the buffer meanwhile.
        """
        return listings.as_yaml(self.frames())

    def all_frames_as_string(self):
        """One sentence for each frame that was ever a child; otherwise as :meth:`all_frames_as_yaml`."""
        return listings.as_string(self.frames())

    def _allFramesAsDot(self, time=None):
        """
        The frames that hold data as a Graphviz digraph; ages are as of ``time``.

        Otherwise as :meth:`all_frames_as_yaml`.
        """
        cdef int64_t time_ns = 0 if time is None else nanoseconds(time, "time")
        return listings.as_dot(self.frames(), time_ns)

    def _frameExists(self, name):
        """Whether the name was ever a parent or a child."""
        cdef Py_ssize_t size
        cdef const char* text = name_utf8(name, &size)
        return self.knows_frame(text, size)

    def _getFrameStrings(self):
        """Every frame name, in the order in which they came."""
        return self.frame_names(None)[1:]

    def _chain(self, target_frame, target_time, source_frame, source_time, fixed_frame):
        """The frames from source up to the common ancestor and down to target, each once."""
        cdef list chain = []
        cdef int64_t source_ns = query_time(source_time, "source_time")
        cdef int64_t target_ns = query_time(target_time, "target_time")
        _extend_chain(chain, self._frames_between(fixed_frame, source_frame, source_ns))
        _extend_chain(chain, self._frames_between(target_frame, fixed_frame, target_ns))
        return self.frame_names(chain)

    cdef list _frames_between(self, target_frame, source_frame, int64_t time_ns):
        cdef Query query
        cdef Path path
        cdef Status status
        cdef uint32_t i
        query_frames(&query, target_frame, source_frame)
        query.source_ns = time_ns
        status = self.find_path(&query, &path)
        if status.code != STATUS_OK:
            raise self.error(&query, status)
        return ([path.source[i] for i in range(path.source_hops)]
                + [path.top]
                + [path.target[i - 1] for i in range(path.target_hops, 0, -1)])

    def statistics(self):
        """
        What this buffer has done and holds.

        :return: a dict: ``taken`` transforms, ``refused`` by reason, ``frames`` and ``samples`` held,
            ``bytes`` allocated for them, ``waiters``, ``waits_refused``, ``malformed_messages``.
        """
        return self.counts()

    def _self_check(self):
        """Walk every ring and the tree; AssertionError names an invariant that does not hold."""
        cdef const char* problem = self.check()
        if problem != NULL:
            raise AssertionError(problem.decode())


cdef _extend_chain(list chain, frames):
    # A frame met again closes a detour; cut it off.
    for frame in frames:
        if frame in chain:
            del chain[chain.index(frame):]
        chain.append(frame)
