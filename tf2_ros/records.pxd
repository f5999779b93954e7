# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Note the sender and the time of reception of each transform that a receiver inserts."""

from libc.stddef cimport size_t
from libc.stdint cimport int64_t, uint8_t, uint16_t, uint32_t, uint64_t

from tf2_py._internal cimport Batch, ForkedLock, Lock, Names


cdef struct Record:
    # The same as RECORD of records.pyx.
    int64_t received_ns         # of the listener's clock
    int64_t stamp_ns
    uint32_t child              # id in `frames`
    uint32_t parent             # likewise
    uint32_t publisher          # id in `publishers`
    uint8_t is_static           # 0 or 1
    uint8_t unnormalized        # 1: accepted, with a rotation that tf2 of Kilted and later refuses
    uint16_t refusals           # for what every buffer refuses it: REFUSED_* bits
    uint32_t value              # id in `values` if static, otherwise a larger number


cdef struct Records:
    Lock lock                   # guards the rest
    ForkedLock forked           # lock
    Record* records
    size_t count                # records in use
    size_t capacity             # records allocated
    Names frames
    Names publishers            # the bytes of their ids
    Names values                # the bytes of the numbers of static transforms
    uint64_t messages           # that could be read
    uint64_t malformed          # messages that could not be read
    uint64_t lost               # transforms for which there was no place or memory


# Notes the transforms of a batch that was read from one message of the publisher with this gid.
cdef void records_add(
    Records* records, const Batch* batch, int64_t received_ns, const unsigned char* gid, size_t gid_size
) noexcept nogil
# Counts a message that could not be read.
cdef void records_add_malformed(Records* records) noexcept nogil


cdef class Recording:
    cdef Records _records
    cdef object _array          # owns _records.records
    cdef list _frames           # names, by id, as far as they were asked for
    cdef list _publishers       # likewise
    cdef list _values           # likewise

    cdef uint64_t _counted(self, const uint64_t* count) noexcept
    cdef list _new_names(self, const Names* names, list known)
