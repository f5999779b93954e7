"""Owns the records of received transforms, between the receiver's thread and the program that reads them."""

from libc.stddef cimport size_t
from libc.stdint cimport int64_t, uint32_t, uint64_t, uintptr_t
from libc.stdlib cimport free, malloc
from libc.string cimport memcpy

from tf2_py._internal cimport (
    FORK_INNER,
    NAME_NO_MEMORY,
    Batch,
    Incoming,
    Name,
    Names,
    fork_forget,
    fork_watch,
    incoming_refusals,
    lock_free,
    lock_init,
    lock_write,
    name_strip,
    names_free,
    names_init,
    names_intern,
    unlock_write,
)

import numpy as np

__all__ = ["RECORD", "Recording"]

RECORD = np.dtype([
    ("received_ns", np.int64),
    ("stamp_ns", np.int64),
    ("child", np.uint32),
    ("parent", np.uint32),
    ("publisher", np.uint32),
    ("static", np.uint16),
    ("refusals", np.uint16),
])

cdef enum:
    CAPACITY = 1 << 17      # records; their memory is used only as far as they are
    MAX_NAMES = 1 << 20     # a publisher that makes up names must not fill the memory


cdef inline uint32_t _intern(Names* names, const char* text, size_t size) noexcept nogil:
    return NAME_NO_MEMORY if names.count >= MAX_NAMES else names_intern(names, text, size)


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
    lock_write(&records.lock)
    records.messages += 1
    publisher = _intern(&records.publishers, <const char*>gid, gid_size)
    for i in range(batch.count):
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
        if record.child == NAME_NO_MEMORY or record.parent == NAME_NO_MEMORY:
            records.lost += 1
        else:
            records.count += 1
    unlock_write(&records.lock)


cdef void records_add_malformed(Records* records) noexcept nogil:
    lock_write(&records.lock)
    records.malformed += 1
    unlock_write(&records.lock)


cdef class Recording:
    """
    What a receiver notes of each transform; a :class:`tf2_ros._receive.loop.Receiver` fills it.

    :param int capacity: how many transforms may arrive between two calls of :meth:`take`.
    """

    def __cinit__(self, size_t capacity=CAPACITY):
        if lock_init(&self._records.lock) != 0:
            raise MemoryError
        fork_watch(&self._records.forked, &self._records.lock, FORK_INNER)
        if names_init(&self._records.frames) != 0 or names_init(&self._records.publishers) != 0:
            raise MemoryError
        self._array = np.empty(capacity, RECORD)
        self._records.records = <Record*><uintptr_t>self._array.ctypes.data
        self._records.capacity = capacity
        self._frames = []
        self._publishers = []

    def __dealloc__(self):
        fork_forget(&self._records.forked)
        names_free(&self._records.frames)
        names_free(&self._records.publishers)
        lock_free(&self._records.lock)

    def take(self):
        """
        What has arrived since the last call.

        :return: an array of :data:`RECORD`, in the order of arrival. ``child`` and ``parent`` are indices
            into :meth:`frames`, ``publisher`` into :meth:`publishers`; ``refusals`` says by the bits of
            ``tf2_py._objects.log.REFUSALS`` for what every buffer refuses the transform.
        """
        cdef size_t count
        taken, fresh = self._array, np.empty(self._records.capacity, RECORD)
        cdef Record* empty = <Record*><uintptr_t>fresh.ctypes.data
        lock_write(&self._records.lock)
        count = self._records.count
        self._records.records = empty
        self._records.count = 0
        unlock_write(&self._records.lock)
        self._array = fresh
        return taken[:count]

    def frames(self):
        """The names of the frames; the list only grows, and is the same object each time."""
        self._frames += [name.decode() for name in self._new_names(&self._records.frames, self._frames)]
        return self._frames

    def publishers(self):
        """The gids of the publishers, as bytes; the list only grows, and is the same object each time."""
        self._publishers += self._new_names(&self._records.publishers, self._publishers)
        return self._publishers

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
        """How many transforms there was no place for, or no memory."""
        return self._counted(&self._records.lost)

    cdef uint64_t _counted(self, const uint64_t* count) noexcept:
        cdef uint64_t found
        lock_write(&self._records.lock)
        found = count[0]
        unlock_write(&self._records.lock)
        return found

    cdef list _new_names(self, const Names* names, list known):
        # No Python object is made under the lock, and names stay where they are under the lock only.
        cdef size_t known_count = len(known)
        cdef size_t count, text_size, i
        cdef char* text = NULL
        cdef Name* found = NULL
        lock_write(&self._records.lock)
        count = names.count
        text_size = names.text_size
        unlock_write(&self._records.lock)
        if count == known_count:
            return []
        text = <char*>malloc(text_size + 1)
        found = <Name*>malloc(count * sizeof(Name))
        try:
            if text == NULL or found == NULL:
                raise MemoryError
            lock_write(&self._records.lock)
            memcpy(text, names.text, text_size)
            memcpy(found, names.names, count * sizeof(Name))
            unlock_write(&self._records.lock)
            return [
                text[found[i].start:found[i].start + found[i].size] for i in range(known_count, count)
            ]
        finally:
            free(text)
            free(found)
