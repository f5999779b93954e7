"""Owns the walks in the order of tf2, the reference."""

from libc.stdint cimport int64_t, uint32_t

from tf2_py._core.cache cimport CACHE_NONE
from tf2_py._core.path cimport Path, gap_status, path_common_time
from tf2_py._core.tree cimport Tree, tree_newest_parent, tree_parent_at
from tf2_py._core.types cimport (
    MAX_HOPS,
    NO_FRAME,
    STATUS_LOOP,
    STATUS_OK,
    STATUS_UNCONNECTED,
    FrameId,
    Status,
    status_of,
)


cdef Status reference_walk(const Tree* tree, FrameId target, FrameId source, int64_t time_ns,
                           Path* path) noexcept nogil:
    cdef FrameId frame = source
    cdef FrameId top = source
    cdef FrameId parent
    cdef FrameId source_gap = NO_FRAME
    path.source_hops = path.target_hops = 0
    while frame != NO_FRAME:
        top = frame
        if tree.caches[frame].kind == CACHE_NONE:
            break
        parent = tree_parent_at(tree, frame, time_ns)
        if parent == NO_FRAME:
            source_gap = frame
            break
        if frame == target:
            path.top = frame
            return status_of(STATUS_OK)
        if path.source_hops == MAX_HOPS:
            return status_of(STATUS_LOOP)
        path.source[path.source_hops] = frame
        path.source_hops += 1
        frame = parent
    frame = target
    while frame != top:
        if tree.caches[frame].kind == CACHE_NONE:
            break
        parent = tree_parent_at(tree, frame, time_ns)
        if parent == NO_FRAME:
            return gap_status(tree, frame, time_ns)
        if frame == source:
            path.top = frame
            path.source_hops = 0
            return status_of(STATUS_OK)
        if path.target_hops == MAX_HOPS:
            return status_of(STATUS_LOOP)
        path.target[path.target_hops] = frame
        path.target_hops += 1
        frame = parent
    if frame == top:
        path.top = top
        return status_of(STATUS_OK)
    if source_gap != NO_FRAME:
        return gap_status(tree, source_gap, time_ns)
    return status_of(STATUS_UNCONNECTED)


cdef Status reference_common_time(const Tree* tree, FrameId target, FrameId source, Path* path,
                                  int64_t* common_ns) noexcept nogil:
    cdef FrameId frame = source
    cdef uint32_t i
    path.source_hops = path.target_hops = 0
    while True:
        path.source[path.source_hops] = frame
        frame = tree_newest_parent(tree, frame)
        if frame == NO_FRAME:
            break
        path.source_hops += 1
        if frame == target:
            common_ns[0] = path_common_time(tree, path)
            return status_of(STATUS_OK)
        if path.source_hops > MAX_HOPS:
            return status_of(STATUS_LOOP)
    frame = target
    while True:
        path.target[path.target_hops] = frame
        frame = tree_newest_parent(tree, frame)
        if frame == NO_FRAME:
            return status_of(STATUS_UNCONNECTED)
        path.target_hops += 1
        for i in range(path.source_hops):
            if path.source[i + 1] == frame:
                path.source_hops = i + 1
                common_ns[0] = path_common_time(tree, path)
                return status_of(STATUS_OK)
        if frame == source:
            path.source_hops = 0
            common_ns[0] = path_common_time(tree, path)
            return status_of(STATUS_OK)
        if path.target_hops > MAX_HOPS:
            return status_of(STATUS_LOOP)
