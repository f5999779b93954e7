# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Serialized TFMessages: make them from transforms or arrays, read them, and insert many into a buffer.

:func:`insert_messages` calls no Python for each transform, and also fills a
:class:`~tf2_ros.records.Recording`.

>>> from tf2_ros import Buffer
>>> from tf2_ros.serialization import MessageSource, insert_messages, serialize_arrays
>>> data = serialize_arrays([("map", "odom")], [2_000_000_000], [[1, 0, 0, 0, 0, 0, 1]])
>>> buffer = Buffer()
>>> insert_messages(buffer, [("/tf", 2_000_000_000, data)], [MessageSource("/tf")])
1
>>> buffer.frames()["odom"].parent
'map'
"""

from cpython.buffer cimport PyBUF_SIMPLE, PyBuffer_Release, PyObject_CheckBuffer, PyObject_GetBuffer
from cpython.long cimport PyLong_AsLongLongAndOverflow
from libc.stddef cimport size_t
from libc.stdint cimport int64_t
from libc.string cimport memset

from tf2_py._internal cimport (
    Batch,
    Engine,
    Incoming,
    Transform,
    batch_add_cdr,
    batch_cdr,
    batch_error,
    batch_free,
    batch_prefix,
    batch_reserve,
    name_utf8,
    new_transform_stamped,
    read_transform_stamped,
    stamp_nanoseconds,
    unchanging_bytes,
)
from tf2_ros.records cimport Recording, Records, records_add, records_add_malformed

from collections.abc import Iterable

import numpy as np

from tf2_py._internal import bool_of

__all__ = ["MessageSource", "insert_messages", "read_transforms", "serialize_arrays", "serialize_transforms"]

cdef enum:
    COUNT_EVERY = 256       # messages between two calls of `progress`
    MOST_MESSAGES = 32      # that are inserted together
    MOST_TRANSFORMS = 32    # from which on no further message is added to them


cdef class MessageSource:
    """MessageSource(topic, static=False, prefix='', publisher=b'')\n--\n
    A topic whose transforms are wanted.

    :param str topic: its name, which is also the authority of its transforms.
    :param bool static: whether its transforms are valid at all times.
    :param str prefix: a text that is put in front of the names of its frames.
    :param bytes publisher: its publisher in a recording. Empty: the name of the topic.
    """

    cdef readonly str topic
    cdef str _prefix_text       # keeps _prefix alive
    cdef bint _is_static
    cdef const char* _authority
    cdef size_t _authority_size
    cdef const char* _prefix
    cdef size_t _prefix_size
    cdef bytes _publisher

    def __cinit__(self, str topic not None, static=False, str prefix not None="",
                  bytes publisher not None=b""):
        cdef Py_ssize_t size
        self.topic = topic
        self._publisher = publisher or topic.encode()
        self._is_static = bool_of(static, "static")
        self._authority = name_utf8(topic, &size)
        self._authority_size = size
        self._prefix_text = prefix
        self._prefix = name_utf8(prefix, &size)
        self._prefix_size = size

    cdef bint read(self, Batch* batch, const Py_buffer* view) except -1:
        # Like batch_add_cdr. With a prefix, the batch must be empty; its names are valid until the next call.
        batch.is_static = self._is_static
        batch.authority = self._authority
        batch.authority_size = self._authority_size
        if not batch_add_cdr(batch, <const unsigned char*>view.buf, view.len):
            if batch.no_memory:
                raise MemoryError
            return False
        if self._prefix_size and not batch_prefix(batch, self._prefix, self._prefix_size):
            raise MemoryError
        return True


def insert_messages(Engine buffer not None, messages, sources, *, on_malformed=None, on_broken=None,
                    Recording recording=None, list records=None, progress=None):
    """
    Insert all transforms of serialized messages.

    :param buffer: a ``BufferCore``, or a ``Buffer``.
    :param messages: an iterable of ``(topic, time in ns, serialized TFMessage)``. The topic is a name, or an
        object with the name as ``topic``, such as a connection of rosbags.
    :param sources: a :class:`MessageSource` for each topic among them.
    :param on_malformed: ``on_malformed(topic, time_ns, error)`` is called for each message that cannot be
        read, with a ``ValueError``. Raise an exception in it to stop. None: the error is raised.
    :param on_broken: ``on_broken(error, last_time_ns)`` is called if iterating over ``messages`` raises.
        Return the exception to raise instead. ``last_time_ns`` is None before the first message. None: the
        error itself is raised.
    :param Recording recording: records each transform, with the publisher of its source and the time as time
        of reception.
    :param list records: the records that do not fit into ``recording`` are appended, as arrays.
    :param progress: called from time to time with the number of messages since the last call.
    :return: the number of messages.
    :raises KeyError: a topic has no source.
    :raises ValueError: a message cannot be read, a time does not fit into 64 bits, or a message is not bytes.

    The call holds the GIL. If it is interrupted, the buffer keeps the transforms that were inserted before.
    """
    cdef dict by_topic = {source.topic: source for source in sources}
    cdef Filling filling = Filling.__new__(Filling)
    cdef size_t number = 0
    cdef object connection = object()   # of the latest message; at first, of none
    cdef tuple message = None       # the latest one
    cdef tuple following
    filling.buffer = buffer
    filling.on_malformed = on_malformed
    filling.recording = recording
    filling.records = records
    iterator = iter(messages)
    try:
        while True:
            try:
                following = next(iterator, None)
                if following is None:
                    break
                _check(following)
            except Exception as error:
                if on_broken is None:
                    raise
                explained = on_broken(error, None if message is None else message[1])
                if explained is error:
                    raise
                raise explained from error
            message = following
            if message[0] is not connection:
                connection = message[0]
                filling.begin(by_topic[connection if isinstance(connection, str) else connection.topic])
            filling.add(message)
            number += 1
            if progress is not None and number % COUNT_EVERY == 0:
                progress(COUNT_EVERY)
    finally:
        filling.insert()
    if progress is not None:
        progress(number % COUNT_EVERY)
    return number


cdef int _check(tuple message) except -1:
    # A database may hold values of any type, and a damaged file any number.
    cdef int overflow = 0
    PyLong_AsLongLongAndOverflow(message[1], &overflow)
    if overflow:
        raise ValueError(f"a log time of {message[1]} ns does not fit into 64 bits")
    if not PyObject_CheckBuffer(message[2]):
        raise ValueError(f"message: expected bytes, got {type(message[2]).__name__}")
    return 0


cdef class Filling:
    # A few messages of one source are inserted together, which saves half of the cost of small ones.

    cdef Engine buffer
    cdef object on_malformed    # or None
    cdef Recording recording    # or None
    cdef list records
    cdef MessageSource source
    cdef bint is_single         # each message is inserted by itself
    cdef Batch batch
    cdef Py_buffer views[MOST_MESSAGES]     # of the messages that the batch points into
    cdef size_t count                       # of views

    def __dealloc__(self):
        self.release()
        batch_free(&self.batch)

    cdef void release(self):
        while self.count:
            self.count -= 1
            PyBuffer_Release(&self.views[self.count])
        self.batch.count = 0

    cdef int begin(self, MessageSource source) except -1:
        self.insert()
        self.source = source
        self.is_single = self.recording is not None or source._prefix_size > 0
        return 0

    cdef int add(self, tuple message) except -1:
        cdef Py_buffer* view = &self.views[self.count]
        PyObject_GetBuffer(unchanging_bytes(message[2]), view, PyBUF_SIMPLE)
        self.count += 1
        if not self.source.read(&self.batch, view):
            if self.recording is not None:
                records_add_malformed(&self.recording._records)
            self.buffer.count_malformed()
            error = self.buffer.malformed(&self.batch, view.len)
            self.insert()
            if self.on_malformed is None:
                raise error
            self.on_malformed(self.source.topic, message[1], error)
            return 0
        if self.recording is not None:
            self.note(message[1])
        if self.is_single or self.count == MOST_MESSAGES or self.batch.count >= MOST_TRANSFORMS:
            self.insert()
        return 0

    cdef int note(self, int64_t log_ns) except -1:
        # No other thread uses this recording.
        cdef Records* noted = &self.recording._records
        if noted.count and noted.count + self.batch.count > noted.capacity:
            self.records.append(self.recording.take())
        cdef bytes publisher = self.source._publisher
        records_add(noted, &self.batch, log_ns, publisher, len(publisher))
        return 0

    cdef int insert(self) except -1:
        try:
            if self.batch.count:
                self.buffer.insert(&self.batch)
                if self.batch.needs_report:
                    self.buffer.report(&self.batch, None)
        finally:
            self.release()
        return 0


def read_transforms(raw, MessageSource source not None):
    """
    Read the transforms of one message.

    :param raw: a serialized TFMessage.
    :param source: the topic of the message: whether it is static, and the prefix for the names of frames.
    :return: a list of ``geometry_msgs/TransformStamped``; without ROS, a list of objects with the same
        fields.
    :raises ValueError: the message is malformed.
    """
    cdef Batch batch
    cdef Py_buffer view
    cdef const Incoming* incoming
    cdef size_t i
    cdef list transforms = []
    memset(&batch, 0, sizeof(Batch))
    PyObject_GetBuffer(unchanging_bytes(raw), &view, PyBUF_SIMPLE)
    try:
        if not source.read(&batch, &view):
            raise batch_error(&batch, view.len)
        for i in range(batch.count):
            incoming = &batch.entries[i].incoming
            transforms.append(new_transform_stamped(
                &incoming.transform,
                incoming.stamp_ns,
                incoming.parent[:incoming.parent_size].decode(),
                incoming.child[:incoming.child_size].decode(),
            ))
        return transforms
    finally:
        batch_free(&batch)
        PyBuffer_Release(&view)


def serialize_transforms(transforms):
    """
    Serialize one TFMessage, as plain CDR.

    :param transforms: a ``geometry_msgs/TransformStamped``, or an iterable of them, as for a broadcaster.
        What every buffer refuses, such as a rotation of zero length, is serialized as it is.
    :return: the bytes that a publisher sends and a recording stores.
    :raises TypeError: ``transforms`` is something else, or a name is not a str.
    :raises ValueError: a name contains a lone surrogate.
    :raises OverflowError: a stamp does not fit into a message.

    >>> from geometry_msgs.msg import TransformStamped
    >>> from tf2_ros.serialization import MessageSource, read_transforms, serialize_transforms
    >>> pose = TransformStamped(child_frame_id="base_link")
    >>> pose.header.frame_id = "odom"
    >>> pose.transform.translation.x = 1.5
    >>> read_transforms(serialize_transforms(pose), MessageSource("/tf")) == [pose]
    True
    """
    cdef Batch batch
    cdef Incoming* incoming
    cdef size_t i
    cdef list messages = list(transforms) if isinstance(transforms, Iterable) else [transforms]
    cdef list names = []    # which must live as long as the batch points to them
    memset(&batch, 0, sizeof(Batch))
    if batch_reserve(&batch, len(messages)) != 0:
        raise MemoryError
    try:
        batch.count = len(messages)
        for i in range(batch.count):
            incoming = &batch.entries[i].incoming
            read_transform_stamped(messages[i], incoming, names)
            stamp_nanoseconds(incoming.stamp_ns, "header.stamp")
        return batch_cdr(&batch)
    finally:
        batch_free(&batch)


def serialize_arrays(frames, stamps_ns, transforms):
    """
    Serialize one TFMessage, as plain CDR.

    :param frames: N pairs of names, parent and child.
    :param stamps_ns: nanoseconds, shape (N,).
    :param transforms: x y z in meters, and the quaternion x y z w, which is not normalized: shape (N, 7).
    :return: the bytes that a publisher sends and a recording stores.
    :raises TypeError: a name is not a str.
    :raises ValueError: a name contains a NUL character, or the three arguments have different lengths.

    >>> from tf2_ros.serialization import MessageSource, read_transforms, serialize_arrays
    >>> data = serialize_arrays([("map", "base")], [2_000_000_000], [[1, 0, 0, 0, 0, 0, 1]])
    >>> read_transforms(data, MessageSource("/tf"))[0].transform.translation.x
    1.0
    """
    cdef Batch batch
    cdef Incoming* incoming
    cdef Py_ssize_t parent_size, child_size
    cdef size_t i
    cdef list pairs = [(parent, child) for parent, child in frames]
    cdef list stamps = np.asarray(stamps_ns, np.int64).tolist()
    cdef list rows = np.asarray(transforms, np.float64).reshape(-1, 7).tolist()
    if not len(pairs) == len(stamps) == len(rows):
        raise ValueError("expected equal numbers of frames, stamps and transforms, "
                         f"got {len(pairs)}, {len(stamps)} and {len(rows)}")
    memset(&batch, 0, sizeof(Batch))
    if batch_reserve(&batch, len(pairs)) != 0:
        raise MemoryError
    try:
        batch.count = len(pairs)
        for i in range(batch.count):
            incoming = &batch.entries[i].incoming
            parent, child = pairs[i]
            incoming.parent = name_utf8(parent, &parent_size)
            incoming.child = name_utf8(child, &child_size)
            incoming.parent_size, incoming.child_size = parent_size, child_size
            incoming.stamp_ns = stamps[i]
            x, y, z, qx, qy, qz, qw = rows[i]
            incoming.transform = Transform(translation=[x, y, z], rotation=[qx, qy, qz, qw])
        return batch_cdr(&batch)
    finally:
        batch_free(&batch)
