"""Owns reading the arguments of a lookup."""

from tf2_py._core.lookup cimport Query
from tf2_py._objects.messages cimport name_utf8
from tf2_py._objects.times cimport stamp_nanoseconds


cdef int query_frames(Query* query, object target_frame, object source_frame) except -1:
    query.target = name_utf8(target_frame, &query.target_size)
    query.source = name_utf8(source_frame, &query.source_size)
    query.fixed = NULL
    return 0


cdef int query_fill(Query* query, object target_frame, object source_frame, object time) except -1:
    query_frames(query, target_frame, source_frame)
    query.source_ns = stamp_nanoseconds(time, "time")
    return 0


cdef int query_fill_full(Query* query, object target_frame, object target_time, object source_frame,
                         object source_time, object fixed_frame) except -1:
    query_frames(query, target_frame, source_frame)
    query.source_ns = stamp_nanoseconds(source_time, "source_time")
    query.fixed = name_utf8(fixed_frame, &query.fixed_size)
    query.target_ns = stamp_nanoseconds(target_time, "target_time")
    return 0


cdef int query_fill_series(Query* query, object target_frame, object source_frame, object fixed_frame,
                           object target_time) except -1:
    if (fixed_frame is None) != (target_time is None):
        raise TypeError("fixed_frame and target_time go together: both or neither")
    query_frames(query, target_frame, source_frame)
    if fixed_frame is not None:
        query.fixed = name_utf8(fixed_frame, &query.fixed_size)
        query.target_ns = stamp_nanoseconds(target_time, "target_time")
    return 0
