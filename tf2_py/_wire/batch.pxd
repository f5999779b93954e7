"""Transforms that are inserted together: those of one message or of one call."""

from libc.stddef cimport size_t
from libc.stdint cimport uint32_t

from tf2_py._core.types cimport Incoming
from tf2_py._core.waiters cimport WaiterList, Wake


cdef struct Entry:
    Incoming incoming
    uint32_t refused            # outcome: REFUSED_* bits; 0: accepted


cdef struct Batch:
    Entry* entries
    size_t count                # entries in use
    size_t capacity             # entries allocated; 0: `entries` is not the batch's own
    size_t done                 # progress: entries tried
    bint waking                 # progress: the wake for the last of them is running
    Wake wake                   # progress: that one
    const char* authority       # UTF-8, owned by the caller that fills the batch
    size_t authority_size       # bytes
    bint is_static              # all entries are static transforms
    size_t taken                # outcome: entries accepted
    size_t refused              # outcome: entries refused
    bint no_memory              # outcome: memory ran out, and the rest was dropped
    WaiterList ready            # outcome: waiters that have an answer which must still be delivered
    bint needs_report           # outcome: there is something to log, or an answer to deliver
    const char* problem         # why a serialised message could not be read, or NULL ...
    size_t problem_at           # ... and the byte at which


# Zero a Batch before its first use; it may be filled again.
cdef void batch_free(Batch* batch) noexcept nogil
# Resets progress and outcome.
cdef void batch_begin(Batch* batch) noexcept nogil
# Memory for `count` entries; earlier ones are lost.
cdef int batch_reserve(Batch* batch, size_t count) noexcept nogil           # 0, or -1: no memory
# Fills the entries from one serialised TFMessage, whose bytes must outlive them. False: the batch is empty,
# see `problem` and `no_memory`.
cdef bint batch_read_cdr(Batch* batch, const unsigned char* data, size_t size) noexcept nogil
# Adds those of another message. False: none is added, see `problem` and `no_memory`.
cdef bint batch_add_cdr(Batch* batch, const unsigned char* data, size_t size) noexcept nogil
# The ValueError that tells the `problem` of a message of `size` bytes.
cdef object batch_error(const Batch* batch, size_t size)
