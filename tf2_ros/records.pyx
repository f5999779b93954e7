# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Record who sent which transform when.

A :class:`Recording` is filled by a listener: ``TransformListener(buffer, node, recording=recording)``; or by
:func:`tf2_ros.serialization.insert_messages`. Neither calls Python for each message.

>>> from tf2_ros import Buffer
>>> from tf2_ros.records import Recording
>>> from tf2_ros.serialization import MessageSource, insert_messages, serialize_arrays
>>> data = serialize_arrays([("map", "odom")], [2_000_000_000], [[1, 0, 0, 0, 0, 0, 1]])
>>> recording = Recording()
>>> insert_messages(Buffer(), [("/tf", 2_500_000_000, data)], [MessageSource("/tf")], recording=recording)
1
>>> (record,) = recording.take()
>>> recording.frames()[record["child"]], int(record["received_ns"] - record["stamp_ns"])
('odom', 500000000)
"""

from libc.stddef cimport size_t
from libc.stdint cimport int64_t, uint32_t, uint64_t, uintptr_t

from tf2_py._internal cimport (
    NAME_NO_MEMORY,
    Batch,
    Incoming,
    Name,
    Names,
    Transform,
    fork_forget,
    fork_watch,
    incoming_refusals,
    is_unnormalized,
    lock_acquire,
    lock_free,
    lock_init,
    lock_release,
    names_free,
    names_init,
    names_intern,
)

from struct import unpack

import numpy as np

from tf2_py._internal import log

__all__ = ["RECORD", "Recording", "refusal_text"]

RECORD = np.dtype([
    ("received_ns", np.int64),
    ("stamp_ns", np.int64),
    ("child", np.uint32),
    ("parent", np.uint32),
    ("publisher", np.uint32),
    ("static", np.uint8),
    ("unnormalized", np.uint8),
    ("refusals", np.uint16),
    ("value", np.uint32),
], align=True)

cdef enum:
    CAPACITY = 1 << 17      # records; memory is used only for those that exist
    MAX_NAMES = 1 << 20     # so that a publisher that makes up names does not fill the memory
    MAX_VALUES = 1 << 16    # likewise one that sends static transforms that move
    NOTE_SLICE = 1024       # transforms of a message that are noted before other threads may read the records


cdef inline uint32_t _intern(Names* names, uint32_t most, const void* text, size_t size) noexcept nogil:
    return NAME_NO_MEMORY if names.count >= most else names_intern(names, <const char*>text, size)


cdef void records_add(
    Records* records, const Batch* batch, int64_t received_ns, const unsigned char* gid, size_t gid_size
) noexcept nogil:
    cdef Incoming incoming
    cdef Record* record
    cdef uint32_t publisher
    cdef size_t i
    lock_acquire(&records.lock)
    records.messages += 1
    publisher = _intern(&records.publishers, MAX_NAMES, gid, gid_size)
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
        record.refusals = incoming_refusals(&incoming)      # which also strips the names
        record.child = _intern(&records.frames, MAX_NAMES, incoming.child, incoming.child_size)
        record.parent = _intern(&records.frames, MAX_NAMES, incoming.parent, incoming.parent_size)
        record.publisher = publisher
        record.is_static = batch.is_static
        record.unnormalized = record.refusals == 0 and is_unnormalized(incoming.squared_length)
        record.value = NAME_NO_MEMORY
        if batch.is_static:
            record.value = _intern(&records.values, MAX_VALUES, &incoming.transform, sizeof(Transform))
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
    """Recording(capacity=131072)\n--\n
    Records who sent which transform when, for a listener or for ``insert_messages``.

    :param int capacity: how many transforms may arrive between two calls of :meth:`take`. Default: 131,072.
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
        Get the records since the last call.

        :return: an array of shape (N,) and dtype :data:`RECORD`, in the order of arrival, with these fields:
            ``received_ns`` and ``stamp_ns`` in nanoseconds; ``child`` and ``parent``, indices into
            :meth:`frames`; ``publisher``, an index into :meth:`publishers`; ``static``, 0 or 1;
            ``refusals``, not 0 if every buffer refuses the transform, see :func:`refusal_text`;
            ``unnormalized``, 1 if buffers accept the transform, but tf2 of Kilted and later refuses it
            because the length of its rotation is not 1; ``value``, an index into :meth:`values` if the
            transform is static, otherwise a larger number.
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
        Get the publishers as bytes: their gids from a listener; from messages, those of their sources.

        The list only grows, and is the same object each time.
        """
        self._publishers += self._new_names(&self._records.publishers, self._publishers)
        return self._publishers

    def values(self):
        """
        Get the numbers of static transforms, each once: x y z in meters, and the quaternion x y z w.

        The list only grows, and is the same object each time. Only the first 65,536 are recorded.
        """
        new = self._new_names(&self._records.values, self._values)
        self._values += [unpack("7d", value) for value in new]
        return self._values

    @property
    def messages(self):
        """How many messages were recorded."""
        return self._counted(&self._records.messages)

    @property
    def malformed(self):
        """How many messages could not be read."""
        return self._counted(&self._records.malformed)

    @property
    def lost(self):
        """How many transforms were lost: beyond ``capacity``, with too many names, or without memory."""
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


def refusal_text(int refusals):
    """Return, as a clause, why every buffer refuses a transform with these ``refusals`` in its record."""
    return log.because(refusals)
