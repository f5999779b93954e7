"""Walks through the tree: paths, common times, composed transforms."""

from libc.stdint cimport int64_t, uint32_t

from tf2_py._tree cimport Tree
from tf2_py._types cimport MAX_HOPS, FrameId, Status, Transform


cdef struct Path:
    # The frames whose samples lie between two frames: each hop goes from the frame named to its parent.
    FrameId source[MAX_HOPS + 1]    # up from the source; holds one frame more than hops count
    FrameId target[MAX_HOPS + 1]    # up from the target, likewise
    uint32_t source_hops
    uint32_t target_hops
    FrameId top                     # where the two sides meet


# All of these read the tree only; the caller holds its lock. `time_ns` 0 asks for the latest common time.
# `out` NULL only asks whether there is an answer. `stamp_ns` receives the time looked up. `path` is room to work in
# and afterwards holds the path of a successful lookup.
cdef Status walk_lookup(const Tree* tree, FrameId target, FrameId source, int64_t time_ns, Path* path,
                        Transform* out, int64_t* stamp_ns) noexcept nogil
cdef Status walk_common_time(const Tree* tree, FrameId target, FrameId source, Path* path,
                             int64_t* common_ns) noexcept nogil
