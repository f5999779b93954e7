# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Batches of transforms that are inserted together; serialized tf2_msgs/TFMessage, read and written."""

cdef struct Entry:
    Incoming incoming
    uint32_t refused            # outcome: REFUSED_* bits; 0: accepted
    bint unnormalized           # outcome: accepted, the first one of its frame with an unnormalized rotation


cdef struct Batch:
    Entry* entries
    size_t count                # entries in use
    size_t capacity             # entries allocated; 0: `entries` is not the batch's own
    size_t done                 # progress: entries tried
    const char* authority       # UTF-8, owned by the caller that fills the batch
    size_t authority_size       # bytes
    bint is_static              # all entries are static transforms
    size_t taken                # outcome: entries accepted
    size_t refused              # outcome: entries refused
    size_t unnormalized         # outcome: entries for which `unnormalized` is set
    bint no_memory              # outcome: memory ran out, and the rest was dropped
    Link ready                  # outcome: waiters that have an answer which must still be delivered
    int64_t in_1970_ns          # outcome: the time of a wait that asks_for_1970; 0: of none
    uint64_t displaced          # outcome: how many samples the tree has displaced, to be logged; 0: it is not
    bint needs_report           # outcome: there is something to log, or an answer to deliver
    char* names                 # memory of batch_prefix
    size_t names_capacity       # bytes
    const char* problem         # why a serialized message could not be read, or NULL ...
    size_t problem_at           # ... and the byte at which


# Zero a Batch before its first use; it may be filled again.
cdef void batch_free(Batch* batch) noexcept nogil
# Resets progress and outcome. The batch must not move from here on.
cdef void batch_begin(Batch* batch) noexcept nogil
# Memory for `count` entries; earlier ones are lost.
cdef int batch_reserve(Batch* batch, size_t count) noexcept nogil           # 0, or -1: no memory
# The bytes of any bytes-like object; a copy if another thread or process may change them, because they must
# not change between the check and the use.
cdef bytes unchanging_bytes(data)
# Fills the entries from one serialized TFMessage, whose bytes must outlive them. False: the batch is empty,
# see `problem` and `no_memory`.
cdef bint batch_read_cdr(Batch* batch, const unsigned char* data, size_t size) noexcept nogil
# Adds the entries of another message. False: none is added, see `problem` and `no_memory`.
cdef bint batch_add_cdr(Batch* batch, const unsigned char* data, size_t size) noexcept nogil
# Puts a prefix before every name but empty ones, which are refused. False: no memory, and the batch is empty.
cdef bint batch_prefix(Batch* batch, const char* prefix, size_t prefix_size) noexcept nogil
# All entries, as one serialized TFMessage.
cdef bytes batch_cdr(const Batch* batch)
# The ValueError for the `problem` of a message of `size` bytes.
cdef object batch_error(const Batch* batch, size_t size)
