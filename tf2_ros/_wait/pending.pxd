# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What ends once: a future, a message of a filter, a subscription to changes."""


# PENDING, then perhaps QUEUED, then DONE or CANCELLED.
cdef enum State:
    PENDING
    QUEUED      # it has an outcome, which is hidden until its callbacks run
    RUNNING     # the function of a subscription runs; then it is PENDING again
    DONE
    CANCELLED


cdef class Pending:
    cdef object __weakref__
    cdef State _state
    cdef object _result, _error
    cdef public object wait     # for what it lacks, with the buffer; None: for nothing of a buffer
    cdef public object kept     # a dict: the owner's references to what nothing else may refer to
    cdef readonly object call_queue     # that must call it; None: the queue of what received the transform
    cdef int _end(self, State state) except -1
    # For subclasses. Whether ending it would run code of a program.
    cdef bint _runs_user_code(self) except -1
    # Calls the callbacks, after the end.
    cdef int _call_back(self) except -1


# Calls back, and logs an `Exception`; what ends a program is raised.
cdef int call_back(callback, tuple arguments) except -1
