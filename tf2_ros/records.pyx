"""
Insert serialised messages into a buffer, and record what was in them: who sent which transform when.

A :class:`Recording` is filled by :func:`insert_messages`, or by a listener: ``TransformListener(buffer, node,
recording=recording)``. Neither calls Python for each message.

>>> from tf2_ros import Buffer
>>> from tf2_ros.records import MessageSource, Recording, insert_messages
>>> mount = bytes.fromhex("00010000" "00000000")  # a serialised TFMessage of no transforms
>>> recording = Recording()
>>> insert_messages(Buffer(), [("/tf", 1_000_000_000, mount)], [MessageSource("/tf")], recording=recording)
1
>>> len(recording.take())
0
"""

from cpython.buffer cimport PyBUF_SIMPLE, PyBuffer_Release, PyObject_CheckBuffer, PyObject_GetBuffer
from cpython.long cimport PyLong_AsLongLongAndOverflow
from libc.stddef cimport size_t
from libc.stdint cimport int64_t, uint32_t, uint64_t, uintptr_t
from libc.stdlib cimport calloc, free
from libc.string cimport memset

from tf2_py._internal cimport (
    NAME_NO_MEMORY,
    Batch,
    Engine,
    Entry,
    Incoming,
    Name,
    Names,
    Transform,
    batch_add_cdr,
    batch_cdr,
    batch_error,
    batch_free,
    batch_prefix,
    fork_forget,
    fork_watch,
    incoming_refusals,
    is_unnormalised,
    lock_acquire,
    lock_free,
    lock_init,
    lock_release,
    name_strip,
    name_utf8,
    names_free,
    names_init,
    names_intern,
    new_transform_stamped,
    unchanging_bytes,
)

from struct import unpack

import numpy as np

from tf2_py._internal import log

__all__ = [
    "RECORD",
    "MessageSource",
    "Recording",
    "insert_messages",
    "read_transforms",
    "refusal_text",
    "serialize_arrays",
]

RECORD = np.dtype([
    ("received_ns", np.int64),
    ("stamp_ns", np.int64),
    ("child", np.uint32),
    ("parent", np.uint32),
    ("publisher", np.uint32),
    ("static", np.uint8),
    ("unnormalised", np.uint8),
    ("refusals", np.uint16),
    ("value", np.uint32),
], align=True)

cdef enum:
    CAPACITY = 1 << 17      # records; memory is used only for those that exist
    MAX_NAMES = 1 << 20     # so that a publisher that makes up names does not fill the memory
    MAX_VALUES = 1 << 16    # likewise one that sends static transforms that move
    NOTE_SLICE = 1024       # transforms of a message that are noted before other threads may read the records
    COUNT_EVERY = 256       # messages between two calls of `progress`
    MOST_MESSAGES = 32      # that are inserted together
    MOST_TRANSFORMS = 32    # from which on no further message is added to them


cdef inline uint32_t _intern(Names* names, const char* text, size_t size) noexcept nogil:
    return NAME_NO_MEMORY if names.count >= MAX_NAMES else names_intern(names, text, size)


cdef inline uint32_t _intern_value(Names* values, const Transform* transform) noexcept nogil:
    if values.count >= MAX_VALUES:
        return NAME_NO_MEMORY
    return names_intern(values, <const char*>transform, sizeof(Transform))


cdef uint32_t _intern_frame(Names* names, const char* text, size_t size) noexcept nogil:
    name_strip(&text, &size)
    return _intern(names, text, size)


cdef void records_add(
    Records* records, const Batch* batch, int64_t received_ns, const unsigned char* gid, size_t gid_size
) noexcept nogil:
    cdef Incoming incoming
    cdef Record* record
    cdef uint32_t publisher
    cdef size_t i
    lock_acquire(&records.lock)
    records.messages += 1
    publisher = _intern(&records.publishers, <const char*>gid, gid_size)
    for i in range(batch.count):
        if i % NOTE_SLICE == NOTE_SLICE - 1:
            lock_release(&records.lock)
            lock_acquire(&records.lock)
        if records.count == records.capacity or publisher == NAME_NO_MEMORY:
            records.lost += 1
            continue
        incoming = batch.entries[i].incoming
        record = &records.records[records.count]
        record.received_ns = received_ns
        record.stamp_ns = incoming.stamp_ns
        record.child = _intern_frame(&records.frames, incoming.child, incoming.child_size)
        record.parent = _intern_frame(&records.frames, incoming.parent, incoming.parent_size)
        record.publisher = publisher
        record.is_static = batch.is_static
        record.refusals = incoming_refusals(&incoming)
        record.unnormalised = record.refusals == 0 and is_unnormalised(incoming.squared_length)
        record.value = NAME_NO_MEMORY
        if batch.is_static:
            record.value = _intern_value(&records.values, &incoming.transform)
        if record.child == NAME_NO_MEMORY or record.parent == NAME_NO_MEMORY:
            records.lost += 1
        else:
            records.count += 1
    lock_release(&records.lock)


cdef void records_add_malformed(Records* records) noexcept nogil:
    lock_acquire(&records.lock)
    records.malformed += 1
    lock_release(&records.lock)


cdef class Recording:
    """
    Records who sent which transform when, for a listener or for :func:`insert_messages`.

    :param int capacity: how many transforms may arrive between two calls of :meth:`take`.
    """

    def __cinit__(self, size_t capacity=CAPACITY):
        if lock_init(&self._records.lock) != 0:
            raise MemoryError
        fork_watch(&self._records.forked, &self._records.lock)
        if names_init(&self._records.frames) != 0 or names_init(&self._records.publishers) != 0:
            raise MemoryError
        if names_init(&self._records.values) != 0:
            raise MemoryError
        self._array = np.empty(capacity, RECORD)
        self._records.records = <Record*><uintptr_t>self._array.ctypes.data
        self._records.capacity = capacity
        self._frames = []
        self._publishers = []
        self._values = []

    def __dealloc__(self):
        fork_forget(&self._records.forked)
        names_free(&self._records.frames)
        names_free(&self._records.publishers)
        names_free(&self._records.values)
        lock_free(&self._records.lock)

    def take(self):
        """
        Get what has arrived since the last call.

        :return: an array of :data:`RECORD`, in the order of arrival. ``child`` and ``parent`` are indices
            into :meth:`frames`, ``publisher`` into :meth:`publishers`; ``refusals`` is not 0 if every
            buffer refuses the transform, see :func:`refusal_text`; ``unnormalised`` is 1 if buffers
            accept it, but those of tf2 of Kilted and later refuse it because the length of its rotation is
            not 1; ``value`` is an index into :meth:`values` if the transform is static, otherwise a larger
            number.
        """
        cdef size_t count
        taken, fresh = self._array, np.empty(self._records.capacity, RECORD)
        cdef Record* empty = <Record*><uintptr_t>fresh.ctypes.data
        lock_acquire(&self._records.lock)
        count = self._records.count
        self._records.records = empty
        self._records.count = 0
        lock_release(&self._records.lock)
        self._array = fresh
        return taken[:count]

    def frames(self):
        """Get the names of the frames; the list only grows, and is the same object each time."""
        self._frames += [name.decode() for name in self._new_names(&self._records.frames, self._frames)]
        return self._frames

    def publishers(self):
        """
        Get the publishers as bytes: their gids from a listener, or the names of topics from messages.

        The list only grows, and is the same object each time.
        """
        self._publishers += self._new_names(&self._records.publishers, self._publishers)
        return self._publishers

    def values(self):
        """
        Get the numbers of static transforms, each once: x y z in metres, and the quaternion x y z w.

        The list only grows, and is the same object each time. Only the first 65,536 are noted.
        """
        new = self._new_names(&self._records.values, self._values)
        self._values += [unpack("7d", value) for value in new]
        return self._values

    @property
    def messages(self):
        """How many messages were noted."""
        return self._counted(&self._records.messages)

    @property
    def malformed(self):
        """How many messages could not be read."""
        return self._counted(&self._records.malformed)

    @property
    def lost(self):
        """Get how many transforms were lost, because there was no place or no memory for them."""
        return self._counted(&self._records.lost)

    cdef uint64_t _counted(self, const uint64_t* count) noexcept:
        cdef uint64_t found
        lock_acquire(&self._records.lock)
        found = count[0]
        lock_release(&self._records.lock)
        return found

    cdef list _new_names(self, const Names* names, list known):
        cdef list found = []
        cdef const Name* name
        cdef size_t i
        lock_acquire(&self._records.lock)
        try:
            # Names keep their addresses only under the lock, and making bytes runs no other code.
            for i in range(len(known), names.count):
                name = &names.names[i]
                found.append(names.text[name.start:name.start + name.size])
        finally:
            lock_release(&self._records.lock)
        return found


cdef class MessageSource:
    """
    A topic whose transforms are wanted.

    :param str topic: its name, which is also the authority of its transforms.
    :param bool static: whether its transforms are valid at all times.
    :param str prefix: is put in front of the names of its frames.
    """

    cdef readonly str topic
    cdef str _prefix_text       # keeps _prefix alive
    cdef bint _is_static
    cdef const char* _authority
    cdef size_t _authority_size
    cdef const char* _prefix
    cdef size_t _prefix_size

    def __cinit__(self, str topic not None, bint static=False, str prefix not None=""):
        cdef Py_ssize_t size
        self.topic = topic
        self._is_static = static
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
    Insert all transforms of serialised messages.

    :param buffer: a ``BufferCore``, or a ``Buffer``.
    :param messages: an iterable of ``(topic, time in ns, serialised TFMessage)``. The topic is a name, or an
        object with the name as ``topic``, such as a connection of rosbags.
    :param sources: a :class:`MessageSource` for each topic among them.
    :param on_malformed: called with topic, time and a ``ValueError`` for each message that cannot be read. If
        it raises an exception, the work ends. None: the error is raised.
    :param on_broken: called with an ``Exception`` that the iteration raises, and the time of the last message
        before, or None. What it returns is raised instead. None: the error itself is raised.
    :param Recording recording: records each transform, with the topic as publisher and the time as time of
        reception.
    :param list records: receives, as arrays, the records for which ``recording`` has no place.
    :param progress: called from time to time with the number of messages since the last call.
    :return: the number of messages.
    :raises KeyError: a topic has no source.
    :raises ValueError: a message cannot be read, a time does not fit into 64 bits, or data are not bytes.

    It holds the GIL. If it is interrupted, the buffer keeps what was inserted before.
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
        records_add(noted, &self.batch, log_ns, <const unsigned char*>self.source._authority,
                    self.source._authority_size)
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

    :param raw: a serialised TFMessage.
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


def serialize_arrays(frames, stamps_ns, transforms):
    """
    Serialise one TFMessage, as plain CDR.

    :param frames: N pairs of names, parent and child.
    :param stamps_ns: nanoseconds, shape (N,).
    :param transforms: x y z in metres, and the quaternion x y z w, which is not changed: shape (N, 7).
    :return: what a publisher sends, and a recording stores.
    :raises TypeError: a name is not a str.
    :raises ValueError: a name contains a NUL character, or there are not as many of one as of the others.

    >>> from tf2_ros.records import MessageSource, read_transforms, serialize_arrays
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
        raise ValueError(f"{len(pairs)} pairs of frames, {len(stamps)} stamps, {len(rows)} transforms")
    memset(&batch, 0, sizeof(Batch))
    batch.entries = <Entry*>calloc(len(pairs) + 1, sizeof(Entry))
    if batch.entries == NULL:
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
        free(batch.entries)


def refusal_text(int refusals):
    """Say in a clause why every buffer refuses a transform, from the ``refusals`` of a record."""
    return log.because(refusals)
