"""Owns reading the arguments of a lookup."""

from tf2_py._core.lookup cimport Query
from tf2_py._objects.messages cimport name_utf8
from tf2_py._objects.times cimport stamp_nanoseconds


cdef const char* _name(object name, str argument, Py_ssize_t* size) except NULL:
    if not isinstance(name, str):
        raise TypeError(f"{argument}: a frame name must be a str, not {type(name).__name__}")
    return name_utf8(name, size)


cdef int query_frames(Query* query, object target_frame, object source_frame) except -1:
    query.target = _name(target_frame, "target_frame", &query.target_size)
    query.source = _name(source_frame, "source_frame", &query.source_size)
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
    query.fixed = _name(fixed_frame, "fixed_frame", &query.fixed_size)
    query.target_ns = stamp_nanoseconds(target_time, "target_time")
    return 0


cdef int query_fill_series(Query* query, object target_frame, object source_frame, object fixed_frame,
                           object target_time) except -1:
    if (fixed_frame is None) != (target_time is None):
        raise TypeError("fixed_frame and target_time go together: both or neither")
    query_frames(query, target_frame, source_frame)
    if fixed_frame is not None:
        query.fixed = _name(fixed_frame, "fixed_frame", &query.fixed_size)
        query.target_ns = stamp_nanoseconds(target_time, "target_time")
    return 0


def frame_name(name, str argument):
    """The name, where it is one that a lookup takes; otherwise the errors of a lookup."""
    cdef Py_ssize_t size
    _name(name, argument, &size)
    return name
