# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""BufferCore reads arguments, calls the engine, and raises its errors."""

cimport cython
from cpython.bytearray cimport PyByteArray_AS_STRING
from cpython.bytes cimport PyBytes_AS_STRING, PyBytes_FromStringAndSize, PyBytes_GET_SIZE
from cpython.buffer cimport (
    PyBUF_C_CONTIGUOUS,
    PyBUF_FORMAT,
    PyBUF_READ,
    PyBuffer_Release,
    PyObject_GetBuffer,
)
from cpython.exc cimport PyErr_CheckSignals
from cpython.float cimport PyFloat_AS_DOUBLE, PyFloat_AsDouble, PyFloat_CheckExact, PyFloat_FromDouble
from cpython.long cimport PyLong_AsLongLong, PyLong_CheckExact
from cpython.memoryview cimport PyMemoryView_FromMemory
from cpython.object cimport PyTypeObject
from cpython.ref cimport Py_DECREF, Py_INCREF, Py_XDECREF
from cpython.unicode cimport PyUnicode_Check
from libc.errno cimport ENOMEM, errno
from libc.float cimport DBL_EPSILON
from libc.stdint cimport INT64_MIN, SIZE_MAX
from libc.string cimport strchr
from posix.mman cimport MADV_DONTNEED, MAP_FAILED, MAP_SHARED, PROT_READ, madvise, mmap

import datetime
import operator
import os
import sys
import types
import warnings
import zlib
from collections.abc import Mapping, Sequence
from numbers import Integral, Real
from stat import S_ISREG
from threading import get_ident, main_thread

from tf2_py._objects import errors, explanations, frame_names, frozen_file, listings, log
from tf2_py._objects.assumptions import Assumption, attempt
# Programs also import them from tf2's extension module.
from tf2_py._objects.errors import (
    ConnectivityException,
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
    MalformedObjectError,
    TimeoutException,
    TransformException,
)
from tf2_py._objects.late_hints import LateHints
from tf2_py.printable import printable

__all__ = [
    "BufferCore",
    "ConnectivityException",
    "ExtrapolationException",
    "InvalidArgumentException",
    "LookupException",
    "TimeoutException",
    "TransformException",
]

include "engine/message_layouts.pxi"
include "engine/times.pxi"
include "engine/read_messages.pxi"
include "engine/reused_messages.pxi"
include "engine/sent_messages.pxi"
include "engine/arrays.pxi"
include "engine/advice.pxi"
include "engine/engine_hooks.pxi"
include "engine/queries_and_errors.pxi"
include "engine/tree_as_objects.pxi"
include "engine/explained.pxi"
include "engine/frozen_buffers.pxi"
include "engine/engine.pxi"
include "engine/wait.pxi"


# The limits of a buffer, so that no sender can fill the memory.
LIMITS = {"max_frames": 1_000_000, "max_bytes": 1 << 30}


cdef object _limit(str name, object given):
    # The argument, else the environment variable, else the default.
    cdef str source = name
    if given is None:
        source = f"TF2_ROS_CYTHON_{name.upper()}"
        text = os.environ.get(source, "")
        if not text:
            return LIMITS[name]
        if not text.isdecimal():
            raise ValueError(f"{source}: expected a whole number, got {text!r}")
        given = int(text)
    if isinstance(given, bool) or not isinstance(given, int):
        raise TypeError(f"{source}: expected an int, got {type(given).__name__}")
    if not 0 < given < 1 << 31 and not (name == "max_bytes" and 0 < given < 1 << 63):
        raise ValueError(f"{source}: expected a number above 0 that fits into a C integer, got {given}")
    return given


cdef extern from "Python.h":
    bint PyMethod_Check(object)
    PyObject* PyMethod_GET_FUNCTION(object)
    PyObject* PyMethod_GET_SELF(object)


cdef inline bint is_method(object found, object function, object instance) noexcept:
    # Whether it is this method of the instance, and not one of a subclass or a mock.
    return (PyMethod_Check(found) and PyMethod_GET_FUNCTION(found) == <PyObject*>function
            and PyMethod_GET_SELF(found) == <PyObject*>instance)


cdef object _can_transform_core = None          # as in the class, below
cdef object _can_transform_full_core = None


# `inspect` reads the signature of the class from the first line of its docstring, which CPython removes.
@cython.no_gc_clear
cdef class BufferCore(Engine):
    """BufferCore(cache_time=None, *, max_frames=None, max_bytes=None)\n--\n
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

    def __init__(
        self,
        cache_time: DurationLike | None = None,
        *,
        max_frames: int | None = None,
        max_bytes: int | None = None,
    ) -> None:
        cdef Retention retention = DEFAULT_RETENTION
        cdef Limits limits
        limits.frames = _limit("max_frames", max_frames)
        limits.bytes = _limit("max_bytes", max_bytes)
        if cache_time is not None:
            retention.cache_time_ns = duration_ns(cache_time, "cache_time")
        if retention.cache_time_ns < 0:
            seconds = errors.seconds(retention.cache_time_ns)
            raise ValueError(f"cache_time: expected 0 or more, got {seconds} s")
        self.start_over(&retention, &limits)

    # Inserting transforms.

    cdef int _set_one(self, object transform, object authority, bint is_static) except -1:
        cdef Entry entry
        cdef Batch batch
        cdef Py_ssize_t size
        # The names point into the slots of `transform`, or into what `keep` holds; both stay alive.
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

    cdef size_t _set_many(self, list messages, object authority, bint is_static, bint replace) except? 0:
        # Returns how many were accepted.
        cdef list keep = []
        cdef Batch batch
        cdef Py_ssize_t size, i
        memset(&batch, 0, sizeof(Batch))
        if batch_reserve(&batch, len(messages)) != 0:
            raise MemoryError
        try:
            batch.count = len(messages)
            batch.is_static = is_static
            for i in range(len(messages)):
                read_transform_stamped(messages[i], &batch.entries[i].incoming, keep)
            batch.authority = authority_utf8(authority, &size)
            batch.authority_size = size
            return self._set_batch(&batch, replace, True)
        finally:
            batch_free(&batch)

    @cython.final
    cdef size_t _set_serialized(self, data, authority, bint is_static, bint replace,
                                bint logs_refused) except? 0:
        # The same for one serialized TFMessage.
        cdef Batch batch
        cdef Py_ssize_t size
        cdef bytes message
        memset(&batch, 0, sizeof(Batch))
        batch.is_static = is_static
        batch.authority = authority_utf8(authority, &size)
        batch.authority_size = size
        message = unchanging_bytes(data)
        size = PyBytes_GET_SIZE(message)
        try:
            if batch_read_cdr(&batch, <const unsigned char*>PyBytes_AS_STRING(message), size):
                return self._set_batch(&batch, replace, logs_refused)
            if batch.problem == NULL:
                raise MemoryError
            self.count_malformed()
            raise self.malformed(&batch, size)
        finally:
            batch_free(&batch)

    @cython.final
    cdef size_t _set_batch(self, Batch* batch, bint replace, bint logs_refused) except? 0:
        if replace and batch.count:
            catch_up(self)      # what has arrived is part of the past, too
            with nogil:
                self.replace(batch)
        else:
            self.insert(batch)
        if not logs_refused:
            batch.refused = 0
        if batch.needs_report:
            self.report(batch, None)
        return batch.taken

    def set_transform(
        self, transform: TransformStamped, authority: str = None, *, replace: bool = False
    ) -> None:
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
        if bool_of(replace, "replace"):
            self._set_many([transform], authority, False, True)
        else:
            self._set_one(transform, authority, False)

    def set_transform_static(self, transform: TransformStamped, authority: str = None) -> None:
        """
        Add one transform that is valid at all times.

        :param transform: a ``geometry_msgs/TransformStamped`` or an object with its fields.
        :param str authority: the publisher; listings and log lines show it.

        Invalid transforms are dropped, and the same exceptions are raised, as in :meth:`set_transform`.
        """
        self._set_one(transform, authority, True)

    def set_transforms(
        self,
        transforms: Iterable[TransformStamped],
        authority: str = None,
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
        cdef bint is_static = bool_of(static, "static")
        cdef bint replaces = bool_of(replace, "replace")
        return self._set_many(list(transforms), authority, is_static, replaces)

    def _tf2_replace(self, data: bytes, authority: str, logs_refused: bool) -> int:
        """As :meth:`set_transforms` with ``replace``, for the transforms of one serialized TFMessage."""
        return self._set_serialized(data, authority, False, True, logs_refused)

    def set_transforms_cdr(
        self, data: bytes | bytearray | memoryview, authority: str = None, static: bool = False
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
        return self._set_serialized(data, authority, bool_of(static, "static"), False, True)

    def clear(self) -> None:
        """Remove every dynamic transform; names, authorities and static transforms remain."""
        self.remove(NULL, 0)

    def forget(self, frame: str) -> bool:
        """
        Remove every transform of a frame, also static ones, as if it had never been a child.

        :param frame: the child frame of these transforms.
        :return: whether it had any. A frame that is unknown has none.

        Frames that no remaining transform refers to become unknown, until a new transform refers to them.
        Their names still count for ``max_frames`` and ``max_bytes``.
        """
        cdef Py_ssize_t size
        cdef const char* text = name_utf8(frame, &size, "frame")
        return self.remove(text, size)

    # Travelling: pickles, copies, files.

    def __reduce__(self):
        return _without_init, (type(self),), self.__getstate__()

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
        cdef dict state = self.state()
        state["attributes"] = self._tf2_attributes()
        return state

    def _tf2_attributes(self) -> dict[str, Any]:
        """Get the attributes that a pickle or copy has, too."""
        return dict(getattr(self, "__dict__", {}))

    def __setstate__(self, state: dict[str, Any]) -> None:
        """
        Replace the contents of this buffer by a state; pending waits continue.

        :param state: a dict that :meth:`__getstate__` returned.
        :raises ValueError: ``state`` is not the state of a buffer, is damaged, or names a frozen file that is
            damaged or was replaced by another. The buffer is unchanged.
        :raises OSError: this frozen file cannot be opened.
        """
        if not isinstance(state, dict):
            raise ValueError(
                f"this is not the state of a buffer: expected a dict, got {type(state).__name__}"
            )
        attributes = state.get("attributes", {})
        if not isinstance(attributes, dict) or (attributes and not hasattr(self, "__dict__")):
            raise ValueError(
                f"this is not the state of a {type(self).__name__}: it cannot have these attributes"
            )
        try:
            if "frozen" in state:
                path, expected = frozen_file.from_state(state)
                self.open_frozen(path, expected)
            else:
                self.restore(state.get("image"))
        except (BufferError, TypeError) as error:
            raise ValueError(f"this is not the state of a buffer: {error}") from error
        if attributes:
            # As in pickle, this bypasses a __setattr__ of the class, which may rely on what __init__ does.
            self.__dict__.update(attributes)
        self._tf2_restored()

    def _tf2_restored(self) -> None:
        """Set the attributes that a state does not have; called after it has replaced the contents."""

    def freeze(self, path: str | os.PathLike[str]) -> None:
        """
        Write the present contents of this buffer to a file that :meth:`open` maps into memory.

        The file has 72 bytes for each sample. An existing file is replaced when the new one is complete;
        processes that have opened it keep the old one. The new file is read-only, because writing into it
        would change what others have mapped. Attributes of a subclass are not written. Other threads may
        continue to insert; the file has what the buffer holds at one moment.

        :param path: the file.
        :raises OSError: the file cannot be written; an existing file remains unchanged.
        """
        from tf2_py.atomic_files import whole_file
        with whole_file(path) as file:
            self.write_frozen(file)
            frozen_file.protect(file)

    @classmethod
    def open(cls, path: str | os.PathLike[str]) -> BufferCore:
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
        opened = _without_init(cls)
        opened.__setstate__({"frozen": (os.fspath(path),)})
        return opened

    # Looking transforms up.

    cdef bint _find(self, Query* query, Transform* out, int64_t* stamp_ns, bint or_none) except -1:
        # Whether there is an answer. Without `or_none`, and for a limit that never applies, raise why not.
        cdef ClockReading reading
        cdef Status status
        if query.policy.is_given and query.policy.judges_age:
            self.read_clock(query, &reading)
        catch_up(self)
        status = self.lookup(query, out, stamp_ns)
        if status.code != STATUS_OK and (status.code == STATUS_BAD_LIMIT or not or_none):
            raise self.error(query, status)
        return status.code == STATUS_OK

    cdef int _lookup_or_raise(self, Query* query, Transform* out, int64_t* stamp_ns) except -1:
        self._find(query, out, stamp_ns, False)
        return 0

    cdef object _answer(self, Query* query, target_frame, source_frame):
        cdef Transform transform
        cdef int64_t stamp_ns
        self._lookup_or_raise(query, &transform, &stamp_ns)
        return new_transform_stamped(&transform, stamp_ns, target_frame, source_frame)

    cdef bint _can(self, const Query* query, Status* status) except -1:
        cdef int64_t stamp_ns
        catch_up(self)
        status[0] = self.lookup(query, NULL, &stamp_ns)
        if status.code != STATUS_OK and asks_for_1970(query, status):
            self.log_1970(status.requested_ns)
        return status.code == STATUS_OK

    cdef tuple _can_or_why(self, const Query* query):
        cdef Status status
        if self._can(query, &status):
            return (1, "")
        return (0, str(self.error(query, status, "canTransform")))

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
        cdef Query query
        query_frames(&query, target_frame, source_frame)
        query_at(&query, time)
        return self._answer(&query, target_frame, source_frame)

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
        cdef Query query
        query_frames(&query, target_frame, source_frame)
        query_at(&query, source_time, "source_time")
        query_fix(&query, fixed_frame, target_time)
        return self._answer(&query, target_frame, source_frame)

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
        return self._look_up_many("lookup_transforms", target_frame, source_frame, times, fixed_frame,
                                  target_time, on_missing, policy, False)

    def lookup_matrix(
        self,
        target_frame: str,
        source_frame: str,
        time: TimeLike,
        out: NDArray[np.floating] | None = None,
        *,
        fixed_frame: str | None = None,
        target_time: TimeLike | None = None,
        **policy: Unpack[LookupPolicy],
    ) -> NDArray[np.floating]:
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
        cdef Query query
        cdef Transform transform
        cdef int64_t stamp_ns
        cdef bint is_direct = out is None or require_matrix(out)
        # A name, because the query refers to its memory.
        accepted = policy_of("lookup_matrix", False, **policy) if policy else None
        query_full(&query, target_frame, source_frame, fixed_frame, target_time, accepted)
        query_at(&query, time)
        self._lookup_or_raise(&query, &transform, &stamp_ns)
        matrix = out if out is not None and is_direct else new_matrix()
        matrix_from_transform(&transform, matrix_of(matrix))
        if not is_direct:
            out[...] = matrix
            return out
        return matrix

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
        matrices = self._look_up_many("lookup_matrices", target_frame, source_frame, times, fixed_frame,
                                      target_time, on_missing, policy, True)
        shape = matrices.shape
        return matrices.reshape(*shape[:len(shape) - 1], 4, 4)

    cdef object _look_up_many(self, str call, target_frame, source_frame, times, fixed_frame, target_time,
                              on_missing, dict policy, bint as_matrices):
        # The rows of matrices, or translations and rotations, of one frame or of each in a sequence.
        cdef Query query
        cdef ClockReading reading
        cdef TimeSeries series
        cdef Status status
        cdef Py_ssize_t i
        cdef bint is_nan_wanted = _is_nan_wanted(on_missing)
        times_ns, missing = _times_and_missing(times, is_nan_wanted)
        accepted = policy_of(call, False, **policy)
        is_many = not isinstance(source_frame, (str, bytes)) and is_sequence(source_frame)
        frames = list(source_frame) if is_many else [source_frame]
        cdef Py_ssize_t count = len(times_ns)
        widths = [16] if as_matrices else [3, 4]
        arrays = [new_array((len(frames) * count, width)) for width in widths]
        series_begin(&series, int64s_of(times_ns), count)
        series.nan_missing = is_nan_wanted
        catch_up(self)
        for frame in frames if is_many else ():     # all names, before the lookups
            query_full(&query, target_frame, frame, fixed_frame, target_time, accepted)
            status = self._check_names(&query)
            if count and status.code != STATUS_OK:
                raise self.error(&query, status)
        for i, frame in enumerate(frames if count else ()):
            query_full(&query, target_frame, frame, fixed_frame, target_time, accepted)
            self._read_clock_for(&query, times_ns, &reading)
            if as_matrices:
                series.matrices = doubles_of(arrays[0], 16) + 16 * count * i
            else:
                series.translations = doubles_of(arrays[0], 3) + 3 * count * i
                series.rotations = doubles_of(arrays[1], 4) + 4 * count * i
            self._lookup_series(&query, &series)
        if is_many:
            arrays = [array.reshape(len(frames), count, widths[i]) for i, array in enumerate(arrays)]
        if missing is not None:
            for array in arrays:
                array[..., missing, :] = float("nan")
        return arrays[0] if as_matrices else tuple(arrays)

    def transform_points(
        self,
        points: NDArray[np.floating],
        times: TimesLike,
        target_frame: str,
        source_frame: str,
        *,
        fixed_frame: str | None = None,
        target_time: TimeLike | None = None,
        **policy: Unpack[LookupPolicy],
    ) -> NDArray[np.floating]:
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
        cdef Query query
        cdef ClockReading reading
        cdef TimeSeries series
        rows, dtype = as_points(points)
        times_ns, _ = _times_and_missing(times, False)
        series_begin(&series, int64s_of(times_ns), len(times_ns))
        if len(rows) != series.count:
            raise ValueError(f"times: expected one for each of {len(rows)} points, got {series.count}")
        transformed = new_array((series.count, 3))
        accepted = policy_of("transform_points", False, **policy)      # whose memory the query refers to
        query_full(&query, target_frame, source_frame, fixed_frame, target_time, accepted)
        self._read_clock_for(&query, times_ns, &reading)
        if series.count:
            series.points = doubles_of(rows, 3)
            series.transformed = doubles_of(transformed, 3)
            self._lookup_series(&query, &series)
        return transformed.astype(dtype, copy=False)

    cdef int _read_clock_for(self, Query* query, times_ns, ClockReading* reading) except -1:
        if query.policy.is_given and query.policy.judges_age:
            for time_ns in times_ns[times_ns != 0][:1]:
                require_latest(query, time_ns, "every time")
            self.read_clock(query, reading)
        return 0

    cdef int _lookup_series(self, Query* query, const TimeSeries* series) except -1:
        cdef Py_ssize_t answered
        cdef Status status
        catch_up(self)
        with nogil:
            answered = self.lookup_series(query, series, &status)
        if answered == SERIES_NO_MEMORY:
            raise MemoryError
        if answered < series.count:
            if answered >= 0:
                query.source_ns = series.times_ns[answered]
            error = self.error(query, status)
            if answered != SERIES_BAD_NAME and status.code != STATUS_BAD_LIMIT:
                error = _error_of_time(error, answered)
            raise error
        return 0

    def can_transform_core(self, target_frame: str, source_frame: str, time: TimeLike) -> tuple[int, str]:
        """
        Return whether :meth:`lookup_transform_core` would succeed: ``(1, '')``, or ``(0, reason)``.

        An invalid name is a reason; ``TypeError``, ``ValueError`` and ``OverflowError`` are raised.
        """
        cdef Query query
        query_frames(&query, target_frame, source_frame)
        query_at(&query, time)
        return self._can_or_why(&query)

    def can_transform_full_core(
        self,
        target_frame: str,
        target_time: TimeLike,
        source_frame: str,
        source_time: TimeLike,
        fixed_frame: str,
    ) -> tuple[int, str]:
        """Return whether :meth:`lookup_transform_full_core` would succeed; see :meth:`can_transform_core`."""
        cdef Query query
        query_frames(&query, target_frame, source_frame)
        query_at(&query, source_time, "source_time")
        query_fix(&query, fixed_frame, target_time)
        return self._can_or_why(&query)

    def _tf2_can_core(self, target_frame: str, source_frame: str, time: TimeLike) -> bool:
        """What :meth:`can_transform_core` says, also that of a program; if it is ours, it makes no text."""
        cdef Query query
        cdef Status status
        core = self.can_transform_core
        if not is_method(core, _can_transform_core, self):
            can, _ = core(target_frame, source_frame, time)
            return bool(can)
        query_frames(&query, target_frame, source_frame)
        query_at(&query, time)
        return self._can(&query, &status)

    def _tf2_can_full_core(
        self,
        target_frame: str,
        target_time: TimeLike,
        source_frame: str,
        source_time: TimeLike,
        fixed_frame: str,
    ) -> bool:
        """What :meth:`can_transform_full_core` says, as :meth:`_tf2_can_core`."""
        cdef Query query
        cdef Status status
        core = self.can_transform_full_core
        if not is_method(core, _can_transform_full_core, self):
            can, _ = core(target_frame, target_time, source_frame, source_time, fixed_frame)
            return bool(can)
        query_frames(&query, target_frame, source_frame)
        query_at(&query, source_time, "source_time")
        query_fix(&query, fixed_frame, target_time)
        return self._can(&query, &status)

    def get_latest_common_time(self, target_frame: str, source_frame: str) -> Time:
        """
        Get the newest time at which every dynamic frame between the two has data; 0 if all are static.

        :return: an ``rclpy.time.Time`` of clock type ``SYSTEM_TIME``.
        :raises TransformException: no path connects the frames.
        :raises LookupException: a frame is unknown.
        :raises InvalidArgumentException: a name is empty or begins with ``/``.
        """
        return new_time(self._common_time(target_frame, source_frame, "get_latest_common_time"))

    cdef int64_t _common_time(self, target_frame, source_frame, str method) except? -1:
        cdef Query query
        cdef int64_t common_ns = 0
        cdef Status status
        query_frames(&query, target_frame, source_frame)
        catch_up(self)
        status = self.common_time(&query, &common_ns)
        if status.code == STATUS_OK:
            return common_ns
        error = self.error(&query, status, method)
        if method != "lookupTransform" and status.code in (STATUS_UNCONNECTED, STATUS_LOOP):
            raise errors.TransformException(str(error))  # as in tf2
        raise error

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
        cdef Query query
        accepted = policy_of("explain", False, **policy)       # whose memory the query refers to
        query_full(&query, target_frame, source_frame, None, None, accepted)
        query_at(&query, time)
        return self.explanation(&query)

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
        cdef Query query
        cdef Status status
        cdef TimeRange answered
        cdef int problem
        query_frames(&query, target_frame, source_frame)
        catch_up(self)
        with nogil:
            problem = self.answered_times(&query, &answered, &status)
        if problem != 0:
            raise MemoryError
        if status.code != STATUS_OK:
            raise self.error(&query, status, "time_range")
        return answered.first, answered.last

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
        cdef Query query
        cdef Status status
        cdef uint32_t count
        cdef FrameId frames[2 * MAX_HOPS]
        cdef int64_t ages_ns[2 * MAX_HOPS]
        cdef ClockReading reading
        query_frames(&query, target_frame, source_frame)
        self.read_clock(&query, &reading)
        catch_up(self)
        count = self.moving_frames(&query, &reading, frames, ages_ns, &status)
        if status.code != STATUS_OK:
            raise self.error(&query, status, "ages")
        ages = [float("inf") if ages_ns[i] == INT64_MAX else <object>ages_ns[i] / 1e9 for i in range(count)]
        return dict(zip(self.frame_names([frames[i] for i in range(count)]), ages, strict=True))

    def _poses_between(
        self, target_frame: str, source_frame: str, first_ns: int, last_ns: int, turn: float, move: float,
        most: int, *, fixed_frame: str | None = None, target_time: TimeLike | None = None,
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
        cdef Query query
        cdef Knots knots
        cdef Py_ssize_t count
        accepted = policy_of("_poses_between", False, **policy)
        query_full(&query, target_frame, source_frame, fixed_frame, target_time, accepted)
        knots.first_ns, knots.last_ns = first_ns, last_ns
        if not is_stamp(knots.first_ns) or not is_stamp(knots.last_ns):
            return None
        knots.turn, knots.move = turn, move
        knots.most = most
        catch_up(self)
        with nogil:
            count = self.find_knots(&query, &knots)
        try:
            if count == SERIES_NO_MEMORY:
                raise MemoryError
            if count < 0:
                return None
            times, matrices = new_array((count,), "int64"), new_array((count, 16))
            memcpy(int64s_of(times), knots.times_ns, count * sizeof(int64_t))
            memcpy(doubles_of(matrices, 16), knots.matrices, 16 * count * sizeof(double))
            return times, matrices.reshape(count, 4, 4)
        finally:
            knots_free(&knots)

    def lookupVelocityCore(
        self, tracking_frame: str, observation_frame: str, time: TimeLike, averaging_interval: DurationLike
    ) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        """
        Get the twist of ``tracking_frame``'s origin relative to ``observation_frame``, in the latter's axes.

        The arguments, the formula and the errors are described in :meth:`lookupVelocityFullCore`.

        :return: ``((vx, vy, vz), (wx, wy, wz))``: means over the interval, in m/s and rad/s.
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
        time: TimeLike,
        averaging_interval: DurationLike,
    ) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
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
        # At least 1, because 0 would mean "latest".
        cdef int64_t time_ns = max(stamp_nanoseconds(time, "time"), 1)
        cdef int64_t interval_ns = duration_ns(averaging_interval, "averaging_interval")
        cdef int64_t start_ns, end_ns, common_ns
        cdef Transform start, end, middle, point_frame, reference
        cdef double point[3]
        cdef double linear[3]
        cdef double angular[3]
        if interval_ns < 0:
            raise ValueError(f"averaging_interval: expected 0 or more, got {errors.seconds(interval_ns)} s")
        point[0], point[1], point[2] = reference_point
        common_ns = self._common_time(observation_frame, tracking_frame, "lookupTransform")
        twist_interval(time_ns, interval_ns, common_ns, &start_ns, &end_ns)
        self._transform_at(observation_frame, tracking_frame, start_ns, &start)
        self._transform_at(observation_frame, tracking_frame, end_ns, &end)
        self._transform_at(observation_frame, tracking_frame, time_ns, &middle)
        self._transform_at(observation_frame, reference_point_frame, time_ns, &point_frame)
        self._transform_at(reference_frame, observation_frame, time_ns, &reference)
        twist_of_point(&start, &end, <double>(end_ns - start_ns) * 1e-9, &middle, &point_frame, point,
                       &reference, linear, angular)
        return (linear[0], linear[1], linear[2]), (angular[0], angular[1], angular[2])

    # For lookupVelocityFullCore: one transform at one time, as a struct.
    cdef int _transform_at(self, target_frame, source_frame, int64_t time_ns, Transform* out) except -1:
        cdef Query query
        cdef int64_t stamp_ns
        query_frames(&query, target_frame, source_frame)
        query.source_ns = time_ns
        return self._lookup_or_raise(&query, out, &stamp_ns)

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
        cdef Query query
        cdef Transform transform
        cdef int64_t stamp_ns
        query_full(&query, target_frame, source_frame, fixed_frame, target_time, policy)
        query_at(&query, time, "time" if fixed_frame is None else "source_time")
        if not self._find(&query, &transform, &stamp_ns, or_none):
            return None
        return new_transform_stamped(&transform, stamp_ns, target_frame, source_frame)

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
        cdef Query query
        cdef Transform transform
        cdef int64_t stamp_ns
        query_full(&query, target_frame, source_frame, fixed_frame, target_time, policy)
        query_at(&query, time, "time" if fixed_frame is None else "source_time")
        # Without a transform to compose, a limit is judged before the other path is walked.
        return self._find(&query, &transform if query.policy.is_given else NULL, &stamp_ns, True)

    # Waiting.

    def _wait(
        self,
        target_frame: str,
        source_frame: str,
        time: TimeLike,
        fixed_frame: str | None = None,
        target_time: TimeLike | None = None,
        notify: Callable[[TransformStamped], Any] | None = None,
        policy: Any = None,
        after: Wait | None = None,
        until_refused: bool = False,
    ) -> Wait:
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
        cdef Query query
        cdef Wait wait = Wait.__new__(Wait)
        query_full(&query, target_frame, source_frame, fixed_frame, target_time, policy)
        query_at(&query, time, "time" if fixed_frame is None else "source_time")
        if after is not None:
            wait.only_after(after)
        wait._waiter.until_refused = until_refused
        wait.begin(self, (target_frame, source_frame, fixed_frame), &query, policy, notify)
        return wait

    # Listing frames, and counts.

    def __repr__(self):
        return listings.as_line(type(self), self.counts(), self.frame_facts())

    def __contains__(self, name):
        """Return whether this is the name of a frame, including parents; False for anything but a ``str``."""
        cdef Py_ssize_t size
        cdef const char* text
        if not isinstance(name, str):
            return False
        try:
            text = name_utf8(name, &size)
        except ValueError:
            return False    # it contains a NUL or a lone surrogate, so it cannot be a frame
        catch_up(self)
        return self.has_frame(text, size)

    def histories(self) -> dict[str, History]:
        """
        Get the samples of each frame at one moment, as arrays.

        :return: a dict from the name of each frame with samples to a named tuple :class:`History`, whose
            arrays are copies.
        """
        return self.frame_histories()

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
        return frame_infos(self.frame_facts(True))

    cdef int _require_frame(self, frame, str call) except -1:
        cdef Py_ssize_t size
        name_utf8(frame, &size, "frame")
        if frame not in self:
            self._begin_advice()
            raise name_error(frame, "frame", call, self._advice, self._tf2_names)
        return 0

    def parent(self, frame: str, time: TimeLike = 0) -> str | None:
        """
        Get the parent of a frame.

        :param frame: the child frame.
        :param time: when; 0: at the time of its newest sample.
        :return: the parent; None if ``frame`` is a root, or has no data for the time.
        :raises LookupException: the frame is unknown.
        """
        cdef Py_ssize_t size
        cdef const char* text
        cdef FrameId parent
        cdef int64_t time_ns = stamp_nanoseconds(time, "time")
        self._require_frame(frame, "parent")
        text = name_utf8(frame, &size)
        parent = self.parent_at(text, size, time_ns)
        return None if parent == NO_FRAME else self.frame_names((parent,))[0]

    def children(self, frame: str) -> list[str]:
        """
        Get the frames whose parent is ``frame`` in their newest sample, in the order of first appearance.

        :param frame: the parent frame.
        :return: the names; an empty list if it has no children.
        :raises LookupException: the frame is unknown.

        The cost grows with the number of all frames.
        """
        self._require_frame(frame, "children")
        return [one.name for one in self.frame_facts() if one.parent == frame]

    def path(self, target_frame: str, source_frame: str, time: TimeLike = 0) -> list[str]:
        """
        Get the frames from ``source_frame`` up to the common ancestor and down to ``target_frame``.

        :param target_frame: the last frame of the path.
        :param source_frame: the first frame of the path.
        :param time: when; 0: at the latest common time.
        :return: the names, both ends included.
        :raises TransformException: see :meth:`lookup_transform_core`.
        """
        cdef int64_t time_ns = stamp_nanoseconds(time, "time")
        catch_up(self)
        return self.frame_names(self.frames_between(target_frame, source_frame, time_ns))

    def tree(self) -> str:
        """
        Get the frames as indented text: each frame is followed by its children, with their numbers of
        samples.

        The parent is the parent in the newest sample. Frames whose parents form a loop come last and are
        marked. For the rest, see :meth:`frames`.
        """
        return listings.tree_text(frame_infos(self.frame_facts(True)))

    def all_frames_as_yaml(self) -> str:
        """Get the frames with data as YAML: parent, broadcaster, rate (Hz), times (s), buffer length (s)."""
        return listings.as_yaml(self.frame_facts())

    def all_frames_as_string(self) -> str:
        """Get one sentence for each frame that was ever a child; see also :meth:`all_frames_as_yaml`."""
        return listings.as_string(self.frame_facts())

    def _allFramesAsDot(self, time: TimeLike | None = None) -> str:
        """
        Get the frames with data as a Graphviz digraph; see also :meth:`all_frames_as_yaml`.

        :param time: the time from which ages are counted; None or 0: no ages.
        """
        cdef int64_t time_ns = 0 if time is None else nanoseconds(time, "time")
        return listings.as_dot(self.frame_facts(), time_ns)

    def _frameExists(self, name: str) -> bool:
        """Whether the name was ever a parent or a child."""
        cdef Py_ssize_t size
        name_utf8(name, &size)
        return name in self or name == "NO_PARENT"

    def _getFrameStrings(self) -> list[str]:
        """Every frame name, in the order of first appearance."""
        catch_up(self)
        return self._tf2_names()

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
        cdef Py_ssize_t size
        cdef int64_t target_ns = stamp_nanoseconds(target_time, "target_time")
        cdef int64_t source_ns = stamp_nanoseconds(source_time, "source_time")
        cdef list chain = []
        name_utf8(target_frame, &size, "target_frame")
        name_utf8(source_frame, &size, "source_frame")
        name_utf8(fixed_frame, &size, "fixed_frame")
        if source_frame in self or fixed_frame in self:
            extend_path(chain, self.frames_between(fixed_frame, source_frame, source_ns))
            if target_frame in self:
                extend_path(chain, self.frames_between(target_frame, fixed_frame, target_ns))
        return self.frame_names(chain)

    def statistics(self) -> dict[str, Any]:
        """
        Count what this buffer has done, and what it contains.

        :return: a dict of numbers: transforms ``taken``, and ``refused`` by reason (a dict); ``frames`` and
            ``samples``, and the ``bytes`` allocated for them; samples ``displaced`` because of ``max_bytes``;
            pending ``waiters``; ``malformed_messages``.
        """
        return self.counts()

    def _self_check(self) -> None:
        """Check the tree, histories and waiters; an AssertionError names an invariant that does not hold."""
        cdef const char* problem = self.check()
        if problem != NULL:
            raise AssertionError(problem.decode())


# Cython counts the arguments that a call lacks, and does not name them. So the code has a default for the
# authority, which authority_utf8 refuses; signatures show that it must be given.
with warnings.catch_warnings():
    warnings.simplefilter("ignore", RuntimeWarning)     # that the new defaults have no effect on calls
    for _setter in (BufferCore.set_transform, BufferCore.set_transform_static, BufferCore.set_transforms,
                    BufferCore.set_transforms_cdr):
        _setter.__defaults__ = _setter.__defaults__[1:] or None
    del _setter

for _method in vars(BufferCore).values():
    _method = getattr(_method, "__func__", _method)     # of a class method
    if hasattr(_method, "__annotations__"):
        _method.__annotations__ = LateHints(_method.__annotations__, globals())
del _method


cdef tuple _times_and_missing(times, bint is_nan_wanted):
    import numpy as np
    # Times that can be looked up, and which of them stand for times that have no answer; None: none of them.
    # These are times that no stamp can hold, and NaT, or the least int64, with which recordings mark a stamp
    # that is not set.
    times_ns = as_times_ns(times, accepts_nat=is_nan_wanted)
    cdef const int64_t* times_of = int64s_of(times_ns)
    cdef Py_ssize_t count = len(times_ns)
    cdef Py_ssize_t i = 0
    while i < count and is_stamp(times_of[i]):
        i += 1
    if i == count:
        return times_ns, None
    if is_nan_wanted:
        missing = (times_ns < MIN_STAMP_NS) | (times_ns > MAX_STAMP_NS)
        # Another one of them, which adds no error, such as that of a limit without effect.
        present = times_ns[~missing]
        return np.where(missing, present[0] if len(present) else 0, times_ns), missing
    if times_of[i] == INT64_MIN:
        raise ValueError(f"times[{i}]: expected a time, got NaT (the smallest int64): this stamp is not set")
    raise _error_of_time(OverflowError(no_stamp(times_of[i])), i)


cdef object _error_of_time(object error, Py_ssize_t i):
    # The attributes are for deskew, whose texts name a point instead.
    found = type(error)(f"times[{i}]: {error}")
    found._row, found._text = i, str(error)
    return found


cdef bint _is_nan_wanted(on_missing) except -1:
    if on_missing not in ("raise", "nan"):
        raise ValueError(f"on_missing: expected 'raise' or 'nan', got {on_missing!r}")
    return on_missing == "nan"


def _without_init(cls):
    """
    Make an empty buffer without calling ``__init__``; its state follows.

    Pickles refer to this function by name.
    """
    return BufferCore.__new__(cls)


_can_transform_core = BufferCore.can_transform_core
_can_transform_full_core = BufferCore.can_transform_full_core
