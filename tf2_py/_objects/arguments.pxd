"""The arguments of a lookup as its caller words them."""

from tf2_py._core.lookup cimport Query

# Read the caller's objects; TypeError, ValueError or OverflowError where they do not fit.
# The simple lookup without its time: the frames alone.
cdef int query_frames(Query* query, object target_frame, object source_frame) except -1
cdef int query_fill(Query* query, object target_frame, object source_frame, object time) except -1
cdef int query_fill_full(Query* query, object target_frame, object target_time, object source_frame,
                         object source_time, object fixed_frame) except -1
# A lookup at many times, which stand elsewhere; of two times where fixed_frame and target_time are not None.
cdef int query_fill_series(Query* query, object target_frame, object source_frame, object fixed_frame,
                           object target_time) except -1
