"""Owns what is computed along a known path: the composed transform, or which history does not answer."""

from libc.stdint cimport int64_t, uint32_t

from tf2_py._core.cache cimport Cache
from tf2_py._core.cache_find cimport cache_gap, cache_prefetch, cache_transform_at
from tf2_py._core.geometry cimport (
    quaternion_canonicalise,
    quaternion_normalise,
    transform_between,
    transform_compose,
    transform_identity,
)
from tf2_py._core.tree cimport Tree, tree_newest_parent, tree_oldest_parent
from tf2_py._core.types cimport (
    GAP_NONE,
    GAP_PAST,
    HALF_NONE,
    MAX_HOPS,
    NO_FRAME,
    STATUS_EXTRAPOLATION,
    STATUS_OK,
    FrameId,
    Gap,
    Status,
    Transform,
    status_of,
)


cdef Status gap_status(const Tree* tree, FrameId frame, int64_t time_ns) noexcept nogil:
    cdef const Cache* cache = &tree.caches[frame]
    cdef Gap gap = cache_gap(cache, time_ns)
    cdef Status status
    status.code = STATUS_EXTRAPOLATION
    status.half = HALF_NONE
    status.gap = gap
    status.on_path = False
    status.child = frame
    status.parent = tree_oldest_parent(tree, frame) if gap == GAP_PAST else tree_newest_parent(tree, frame)
    status.requested_ns = time_ns
    status.edge_ns = cache.oldest_ns if gap == GAP_PAST else cache.newest_ns
    return status


cdef Status _first_gap(const Tree* tree, const Path* path, int64_t time_ns) noexcept nogil:
    # Of several gaps the target side's first; STATUS_OK: there is none.
    cdef uint32_t i
    cdef FrameId frame = NO_FRAME
    cdef Status status
    for i in range(path.target_hops):
        if frame == NO_FRAME and cache_gap(&tree.caches[path.target[i]], time_ns) != GAP_NONE:
            frame = path.target[i]
    for i in range(path.source_hops):
        if frame == NO_FRAME and cache_gap(&tree.caches[path.source[i]], time_ns) != GAP_NONE:
            frame = path.source[i]
    if frame == NO_FRAME:
        return status_of(STATUS_OK)
    status = gap_status(tree, frame, time_ns)
    status.on_path = True
    return status


cdef inline void _prefetch_side(const Tree* tree, const FrameId* frames, uint32_t hops, int64_t time_ns,
                                uint32_t* hints) noexcept nogil:
    cdef uint32_t i
    for i in range(hops):
        hints[i] = cache_prefetch(&tree.caches[frames[i]], time_ns)


cdef inline bint _compose_side(const Tree* tree, const FrameId* frames, const uint32_t* hints, uint32_t hops,
                               int64_t time_ns, Transform* out) noexcept nogil:
    # From frames[0] up all hops; hops > 0. False, and `out` undefined: a history does not answer.
    cdef Transform hop
    cdef uint32_t i
    if cache_transform_at(&tree.caches[frames[0]], time_ns, hints[0], out) != GAP_NONE:
        return False
    for i in range(1, hops):
        if cache_transform_at(&tree.caches[frames[i]], time_ns, hints[i], &hop) != GAP_NONE:
            return False
        transform_compose(&hop, out, out)
    return True


cdef Status path_transform(const Tree* tree, const Path* path, int64_t time_ns,
                           Transform* out) noexcept nogil:
    cdef Transform source_side, target_side
    cdef uint32_t source_hints[MAX_HOPS + 1]
    cdef uint32_t target_hints[MAX_HOPS + 1]
    if out == NULL:
        return _first_gap(tree, path, time_ns)
    transform_identity(&source_side)
    transform_identity(&target_side)
    _prefetch_side(tree, path.target, path.target_hops, time_ns, target_hints)
    _prefetch_side(tree, path.source, path.source_hops, time_ns, source_hints)
    if path.target_hops and not _compose_side(
            tree, path.target, target_hints, path.target_hops, time_ns, &target_side):
        return _first_gap(tree, path, time_ns)
    if path.source_hops and not _compose_side(
            tree, path.source, source_hints, path.source_hops, time_ns, &source_side):
        return _first_gap(tree, path, time_ns)
    if path.target_hops:
        transform_between(&target_side, &source_side, out)
    else:
        out[0] = source_side
    # By rounding, long chains drift from unit length.
    quaternion_normalise(out.rotation)
    quaternion_canonicalise(out.rotation)
    return status_of(STATUS_OK)
