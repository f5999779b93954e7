# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The arguments of a lookup, and why it has no answer."""

# Read the caller's objects; TypeError, ValueError or OverflowError where they do not fit.
# The frames of a simple lookup; its time, which `argument` names; and what makes it a lookup at two times.
cdef int query_frames(Query* query, object target_frame, object source_frame) except -1
cdef int query_at(Query* query, object time, str argument=*) except -1
cdef int query_fix(Query* query, object fixed_frame, object target_time) except -1


# Its target, source, and fixed frame or None.
cdef tuple query_names(const Query* query)


cdef class PolicyObject:
    # What one call of a program accepts beyond tf2's. A query with its policy refers to its memory.
    cdef Policy policy
    cdef list _names            # keeps the UTF-8 of the limits' names
    cdef int _read_limits(self, FrameLimits* limits, object given, str argument, int64_t others_ns) except -1

# The frames of a lookup, at two times if there is a fixed frame, under a policy if there is one. query_at
# adds the time, which a series has elsewhere. Where the policy judges ages, Engine.read_clock must follow.
cdef int query_full(Query* query, object target_frame, object source_frame, object fixed_frame,
                    object target_time, PolicyObject policy) except -1


# ValueError: the policy judges ages, and the time, which `argument` names, is not 0.
cdef int require_latest(const Query* query, int64_t time_ns, str argument) except -1


# Why a lookup has no answer, as an exception.

# Of a name that is invalid, or unknown to the buffer whose names `list_names` returns.
cdef object name_error(str name, str argument, str call, Advice advice, object list_names)
# The only function that converts a status to an exception; the names are those of status.child and
# status.parent; of STATUS_BAD_LIMIT, `parent` is that of a static frame. `instead`: of STATUS_BAD_LIMIT, what
# may be limited instead; None: its frame is unknown.
# `limiting`: as in errors.extrapolation. `advice` was begun with `buffer`. `clock`: the buffer's, or None.
cdef object query_error(const Query* query, Status status, str child, str parent, list instead,
                        str limiting, str call, Advice advice, object buffer, ClockHook clock)
