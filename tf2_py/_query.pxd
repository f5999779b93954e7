"""A lookup as its caller words it."""

from libc.stdint cimport int64_t

from tf2_py._tree cimport Tree
from tf2_py._types cimport FrameId, Status, Transform


cdef struct Query:
    const char* target          # names as UTF-8, owned by the caller's objects
    Py_ssize_t target_size      # bytes
    const char* source
    Py_ssize_t source_size
    const char* fixed           # NULL: a simple lookup
    Py_ssize_t fixed_size
    int64_t target_ns           # of a two-time lookup; 0: the latest common time
    int64_t source_ns           # of a simple lookup, too


# Read the caller's objects; TypeError, ValueError or OverflowError where they do not fit.
cdef int64_t query_time(object time) except? -1    # nanoseconds; OverflowError for what no message can carry
cdef int query_fill(Query* query, object target_frame, object source_frame, object time) except -1
cdef int query_fill_full(Query* query, object target_frame, object target_time, object source_frame,
                         object source_time, object fixed_frame) except -1

# With the tree's lock held. `out` NULL only asks whether there is an answer.
cdef Status query_walk(const Tree* tree, const Query* query, Transform* out, int64_t* stamp_ns) noexcept nogil
cdef Status query_ends(const Tree* tree, const Query* query, FrameId* target, FrameId* source) noexcept nogil
cdef FrameId query_fixed(const Tree* tree, const Query* query) noexcept nogil      # NO_FRAME: no such frame
cdef bint query_is_identity(const Query* query) noexcept nogil

# The one place that turns a status into an exception; the names are those of status.child and status.parent.
cdef object query_error(const Query* query, Status status, str child, str parent, str call)
