"""The lookup: the query, and its answer from a tree."""

from libc.stdint cimport int64_t

from tf2_py._core.tree cimport Tree
from tf2_py._core.types cimport FrameId, Status, Transform


cdef struct Query:
    const char* target          # names as UTF-8, owned by the caller's objects
    Py_ssize_t target_size      # bytes
    const char* source          # likewise
    Py_ssize_t source_size
    const char* fixed           # NULL: a simple lookup
    Py_ssize_t fixed_size
    int64_t target_ns           # of a two-time lookup: the target's time; 0: the latest common time
    int64_t source_ns           # the source's time, or that of a simple lookup; 0: likewise


# All of these are called with the tree's lock held. `out` NULL only asks whether there is an answer.
cdef Status query_answer(const Tree* tree, const Query* query, Transform* out,
                         int64_t* stamp_ns) noexcept nogil
# The frames named; a bad status: one of the names is invalid or unknown.
cdef Status query_end_frames(const Tree* tree, const Query* query, FrameId* target,
                             FrameId* source) noexcept nogil
# NO_FRAME: the name is invalid or unknown.
cdef FrameId query_fixed_frame(const Tree* tree, const Query* query) noexcept nogil
# A simple lookup between equal names: the frame need not be known.
cdef bint query_is_identity(const Query* query) noexcept nogil
