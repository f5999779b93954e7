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
