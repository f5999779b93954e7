# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What an engine calls: before it is read, when a waiter has an answer, and to read its clock."""

cdef enum:
    RECENTLY = 2    # of ReadHook.read


cdef class ReadHook:
    # Holds what has arrived for an engine until somebody reads the engine, or a waiter needs it. The words
    # are read and written without a lock, in any thread (sync_header.pxi).
    cdef ReadHook following         # the next one of the same engine
    cdef uint32_t* unread           # not 0: something may have arrived
    cdef uint32_t* has_waiters      # of the engine; not 0: what arrives is to be inserted at once
    cdef uint32_t* read             # set to RECENTLY by each read; an inbox may count down
    # Inserts all that has arrived. It runs no user code, and nothing that waits for the GIL.
    cdef int drain(self) except -1
    # The engine is being destroyed: it must not be used any more.
    cdef void engine_ended(self) noexcept


cdef class WaiterOwner:
    # The base of what waits with a Waiter. It holds its engine, and removes the waiter before it is
    # destroyed.
    # Called with the GIL and without the lock, when the waiter has an answer and has been removed; once more
    # if it raises.
    # Returns a callable that runs a user's code, to be called later, or None; the callable also returns one.
    cdef object deliver(self)


cdef class ClockHook:
    # The clock by which an engine counts ages. It does not refer to the buffer.
    cdef bint runs_code     # reading it runs code of a program, so that an error may be the clock's own
    # Returns whether nothing reports that it is set back. With the GIL.
    cdef bint read(self, buffer, ClockReading* reading) except -1
    # The time for the text of an error; 0: it is not known.
    cdef int64_t now_ns(self) except? -1
