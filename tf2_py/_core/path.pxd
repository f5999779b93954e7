"""The path between two frames, and what is computed along it."""

from libc.stdint cimport INT64_MAX, int64_t, uint32_t

from tf2_py._core.tree cimport Tree
from tf2_py._core.types cimport MAX_HOPS, FrameId, Status, Transform


cdef struct Path:
    # The frames whose samples lie between two frames: each hop leads from the frame named to its parent.
    FrameId source[MAX_HOPS + 1]    # up from the source; one entry more than hops count
    FrameId target[MAX_HOPS + 1]    # up from the target, likewise
    uint32_t source_hops            # 0: the source is the top
    uint32_t target_hops            # 0: the target is the top
    FrameId top                     # the common ancestor at which the two sides meet


cdef inline int64_t _oldest_of_newest(const Tree* tree, const FrameId* frames, uint32_t hops,
                                      int64_t common_ns) noexcept nogil:
    # Static frames and those whose newest stamp is 0 do not count.
    cdef uint32_t i
    cdef int64_t newest_ns
    for i in range(hops):
        newest_ns = tree.caches[frames[i]].newest_ns
        if newest_ns != 0 and newest_ns < common_ns:
            common_ns = newest_ns
    return common_ns


cdef inline int64_t path_common_time(const Tree* tree, const Path* path) noexcept nogil:
    # The newest time that the history of every dynamic frame on the path covers; 0: none of them is dynamic.
    cdef int64_t common_ns = INT64_MAX
    common_ns = _oldest_of_newest(tree, path.source, path.source_hops, common_ns)
    common_ns = _oldest_of_newest(tree, path.target, path.target_hops, common_ns)
    return 0 if common_ns == INT64_MAX else common_ns


# The caller holds the tree's lock. The transform from the source to the target at a time; `out` NULL only
# asks whether every history answers.
cdef Status path_transform(const Tree* tree, const Path* path, int64_t time_ns,
                           Transform* out) noexcept nogil
# The status of a lookup that fails because the history of this frame does not answer for the time.
cdef Status gap_status(const Tree* tree, FrameId frame, int64_t time_ns) noexcept nogil
