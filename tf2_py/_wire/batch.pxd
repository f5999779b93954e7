"""Transforms on their way in together: from one message, or from one call."""

from libc.stddef cimport size_t
from libc.stdint cimport uint32_t

from tf2_py._core.types cimport Incoming
from tf2_py._core.waiters cimport WaiterList, Wake


cdef struct Entry:
    Incoming incoming
    uint32_t refused            # outcome: REFUSED_* bits, 0: taken


cdef struct Batch:
    Entry* entries
    size_t count                # in use
    size_t capacity             # allocated; 0 where `entries` belongs to somebody else
    size_t done                 # progress: how many entries have been looked at
    bint waking                 # progress: somebody may be helped by the last one
    Wake wake
    const char* authority       # UTF-8, owned by whoever fills the batch
    size_t authority_size       # bytes
    bint is_static
    size_t taken                # outcome: how many entries were taken
    size_t refused              # outcome: how many were not
    bint no_memory              # outcome: the rest was dropped for want of memory
    WaiterList ready            # outcome: whom it completed, and whose answers are still to be delivered
    bint needs_report           # outcome: there is something to log, or an answer to deliver
    const char* problem         # why a serialised message could not be read, or NULL ...
    size_t problem_at           # ... and the byte at which


# Zero a Batch before its first use; its memory may be used again and again.
cdef void batch_free(Batch* batch) noexcept nogil
# No progress and no outcome yet.
cdef void batch_begin(Batch* batch) noexcept nogil
cdef int batch_reserve(Batch* batch, size_t count) noexcept nogil           # 0, or -1: no memory
# Fills the entries from one serialised TFMessage, whose bytes must outlive them. False: nothing of it can be
# used, see `problem` and `no_memory`.
cdef bint batch_read_cdr(Batch* batch, const unsigned char* data, size_t size) noexcept nogil
