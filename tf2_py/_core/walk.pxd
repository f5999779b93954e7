"""Walks through the tree: paths, common times, composed transforms."""

from libc.stdint cimport int64_t, uint32_t

from tf2_py._core.tree cimport Tree
from tf2_py._core.types cimport MAX_HOPS, FrameId, Status, Transform


cdef struct Path:
    # The frames whose samples lie between two frames: each hop goes from the frame named to its parent.
    FrameId source[MAX_HOPS + 1]    # up from the source; holds one frame more than hops count
    FrameId target[MAX_HOPS + 1]    # up from the target, likewise
    uint32_t source_hops
    uint32_t target_hops
    FrameId top                     # where the two sides meet


# All of these read the tree only; the caller holds its lock. `time_ns` 0 asks for the latest common time.
# `out` NULL only asks whether there is an answer. `stamp_ns` receives the time looked up. `path` is room to
# work in and afterwards holds the path of a successful lookup.
cdef Status walk_lookup(const Tree* tree, FrameId target, FrameId source, int64_t time_ns, Path* path,
                        Transform* out, int64_t* stamp_ns) noexcept nogil
cdef Status walk_common_time(const Tree* tree, FrameId target, FrameId source, Path* path,
                             int64_t* common_ns) noexcept nogil
# The newest time that every dynamic frame on the path knows; 0: none of them is dynamic.
cdef int64_t walk_path_common_time(const Tree* tree, const Path* path) noexcept nogil
# The path alone, at a time or at NEWEST, for trees in which no link ever closed a loop; target and source
# differ. False: there is none, or too long a one. `mixed` is set where a frame met on the way had several
# parents, so that the path may be another at another time.
cdef bint walk_climb(const Tree* tree, FrameId target, FrameId source, int64_t time_ns, Path* path,
                     bint* mixed) noexcept nogil
