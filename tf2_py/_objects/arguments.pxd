"""The arguments of a lookup as its caller words them."""

from libc.stdint cimport int64_t

from tf2_py._core.lookup cimport Query

# Read the caller's objects; TypeError, ValueError or OverflowError where they do not fit.
cdef int64_t query_time(object time) except? -1    # nanoseconds; OverflowError for what no message can carry
cdef int query_fill(Query* query, object target_frame, object source_frame, object time) except -1
cdef int query_fill_full(Query* query, object target_frame, object target_time, object source_frame,
                         object source_time, object fixed_frame) except -1
