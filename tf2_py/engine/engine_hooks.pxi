# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The bases of what an engine calls."""

cdef class WaiterOwner:
    """What a Waiter belongs to."""

    cdef object deliver(self):
        raise NotImplementedError


cdef class ReadHook:
    """Is called before an engine is read: an inbox, which inserts what has arrived."""

    cdef int drain(self) except -1:
        raise NotImplementedError

    cdef void engine_ended(self) noexcept:
        pass


cdef class ClockHook:
    """Reads the clock by which an engine counts ages."""

    cdef bint read(self, buffer, ClockReading* reading) except -1:
        raise NotImplementedError

    cdef int64_t now_ns(self) except? -1:
        raise NotImplementedError
