"""Owns the way from one frame to another: the path, the time all of it knows, the transform along it."""

from libc.stdint cimport INT64_MAX, int64_t, uint32_t, uint64_t
from libc.string cimport memset

from tf2_py._core.cache cimport (
    CACHE_UNBORN,
    Cache,
    cache_aim,
    cache_gap,
    cache_newest_parent,
    cache_parent_at,
    cache_transform_at,
)
from tf2_py._core.geometry cimport (
    quaternion_canonicalise,
    quaternion_normalise,
    transform_between,
    transform_compose,
    transform_identity,
)
from tf2_py._core.tree cimport MIXED_PARENTS, NEWEST, Tree
from tf2_py._core.types cimport (
    GAP_NONE,
    GAP_PAST,
    HALF_NONE,
    MAX_HOPS,
    NO_FRAME,
    STATUS_EXTRAPOLATION,
    STATUS_LOOP,
    STATUS_OK,
    STATUS_UNCONNECTED,
    FrameId,
    Gap,
    Status,
    Transform,
    status_of,
)


cdef enum:
    SEEN_WORDS = 8          # 512 bits on each side


cdef extern from *:
    void __builtin_prefetch(const void* address) nogil


cdef struct Side:
    # One of the two climbs, and which frames it has met: a bit says maybe, then the list is searched.
    FrameId* frames
    uint32_t count
    FrameId top                 # the frame to go on from; NO_FRAME: there is none above
    uint64_t bits[SEEN_WORDS]


cdef inline void _begin(Side* side, FrameId* frames, FrameId frame) noexcept nogil:
    memset(side.bits, 0, sizeof(side.bits))
    side.frames = frames
    side.count = 0
    _add(side, frame)


cdef inline void _add(Side* side, FrameId frame) noexcept nogil:
    side.bits[(frame >> 6) & (SEEN_WORDS - 1)] |= (<uint64_t>1) << (frame & 63)
    side.frames[side.count] = frame
    side.count += 1
    side.top = frame


cdef inline uint32_t _position(const Side* side, FrameId wanted) noexcept nogil:
    # Where among its frames `wanted` is; their count where it is not.
    cdef uint32_t i
    if not (side.bits[(wanted >> 6) & (SEEN_WORDS - 1)] >> (wanted & 63)) & 1:
        return side.count
    for i in range(side.count):
        if side.frames[i] == wanted:
            return i
    return side.count


cdef inline FrameId _parent(const Tree* tree, FrameId frame, int64_t time_ns, bint* mixed) noexcept nogil:
    cdef uint32_t parent = tree.parents[frame]
    if not parent & MIXED_PARENTS:
        return parent
    mixed[0] = True
    if time_ns == NEWEST:
        return parent & ~<uint32_t>MIXED_PARENTS
    return cache_parent_at(&tree.caches[frame], time_ns)


cdef inline bint _step(const Tree* tree, Side* side, const Side* other, int64_t time_ns, bint* mixed,
                       uint32_t* met_at) noexcept nogil:
    # One hop up. True where that is a frame of the other side, at `met_at` among them.
    side.top = NO_FRAME if side.count > MAX_HOPS else _parent(tree, side.top, time_ns, mixed)
    if side.top == NO_FRAME:
        return False
    met_at[0] = _position(other, side.top)
    if met_at[0] < other.count:
        return True
    _add(side, side.top)
    __builtin_prefetch(&tree.caches[side.top])
    return False


cdef bint walk_climb(const Tree* tree, FrameId target, FrameId source, int64_t time_ns, Path* path,
                     bint* mixed) noexcept nogil:
    # Climb from both ends in turn to the lowest common ancestor: the cost follows the hops between the two.
    # For trees in which no link ever closed a loop. False: no path, or too long a one.
    cdef Side source_side, target_side
    cdef uint32_t met_at
    __builtin_prefetch(&tree.caches[source])
    __builtin_prefetch(&tree.caches[target])
    _begin(&source_side, path.source, source)
    _begin(&target_side, path.target, target)
    while source_side.top != NO_FRAME or target_side.top != NO_FRAME:
        if source_side.top != NO_FRAME and _step(tree, &source_side, &target_side, time_ns, mixed, &met_at):
            path.top = source_side.top
            path.source_hops = source_side.count
            path.target_hops = met_at
            return True
        if target_side.top != NO_FRAME and _step(tree, &target_side, &source_side, time_ns, mixed, &met_at):
            path.top = target_side.top
            path.source_hops = met_at
            path.target_hops = target_side.count
            return True
    return False


cdef inline int64_t _newest_common(const Tree* tree, const FrameId* frames, uint32_t hops,
                                   int64_t common_ns) noexcept nogil:
    # Static frames and those whose newest stamp is 0 have no say.
    cdef uint32_t i
    cdef int64_t newest_ns
    for i in range(hops):
        newest_ns = tree.caches[frames[i]].newest_ns
        if newest_ns != 0 and newest_ns < common_ns:
            common_ns = newest_ns
    return common_ns


cdef int64_t walk_path_common_time(const Tree* tree, const Path* path) noexcept nogil:
    cdef int64_t common_ns = INT64_MAX
    common_ns = _newest_common(tree, path.source, path.source_hops, common_ns)
    common_ns = _newest_common(tree, path.target, path.target_hops, common_ns)
    return 0 if common_ns == INT64_MAX else common_ns


cdef Status _gap_status(const Tree* tree, FrameId frame, int64_t time_ns) noexcept nogil:
    cdef const Cache* cache = &tree.caches[frame]
    cdef Gap gap = cache_gap(cache, time_ns)
    cdef Status status
    status.code = STATUS_EXTRAPOLATION
    status.half = HALF_NONE
    status.gap = gap
    status.on_path = False
    status.child = frame
    status.parent = cache_newest_parent(cache)
    status.requested_ns = time_ns
    status.edge_ns = cache.oldest_ns if gap == GAP_PAST else cache.newest_ns
    return status


cdef Status _first_gap(const Tree* tree, const Path* path, int64_t time_ns) noexcept nogil:
    # Of two gaps the target side's; a path without one is an answer.
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
    status = _gap_status(tree, frame, time_ns)
    status.on_path = True
    return status


cdef inline void _aim_side(const Tree* tree, const FrameId* frames, uint32_t hops, int64_t time_ns,
                           uint32_t* hints) noexcept nogil:
    cdef uint32_t i
    for i in range(hops):
        hints[i] = cache_aim(&tree.caches[frames[i]], time_ns)


cdef inline bint _compose_side(const Tree* tree, const FrameId* frames, const uint32_t* hints, uint32_t hops,
                               int64_t time_ns, Transform* out) noexcept nogil:
    # From frames[0] up all hops; `out` is undefined where a history does not answer. hops > 0.
    cdef Transform hop
    cdef uint32_t i
    if cache_transform_at(&tree.caches[frames[0]], time_ns, hints[0], out) != GAP_NONE:
        return False
    for i in range(1, hops):
        if cache_transform_at(&tree.caches[frames[i]], time_ns, hints[i], &hop) != GAP_NONE:
            return False
        transform_compose(&hop, out, out)
    return True


cdef Status _compose(const Tree* tree, const Path* path, int64_t time_ns, Transform* out) noexcept nogil:
    cdef Transform source_side, target_side
    cdef uint32_t source_hints[MAX_HOPS + 1]
    cdef uint32_t target_hints[MAX_HOPS + 1]
    if out == NULL:
        return _first_gap(tree, path, time_ns)
    transform_identity(&source_side)
    transform_identity(&target_side)
    _aim_side(tree, path.target, path.target_hops, time_ns, target_hints)
    _aim_side(tree, path.source, path.source_hops, time_ns, source_hints)
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
    # Long chains drift from unit length by rounding only.
    quaternion_normalise(out.rotation)
    quaternion_canonicalise(out.rotation)
    return status_of(STATUS_OK)


# The reference's order: up from the source to its root or first gap, then up from the target. It decides
# which error wins, and what a tree with a loop answers; lookups that succeed in loop-free trees never come
# here.

cdef Status _reference_walk(const Tree* tree, FrameId target, FrameId source, int64_t time_ns,
                            Path* path) noexcept nogil:
    cdef FrameId frame = source
    cdef FrameId top = source
    cdef FrameId parent
    cdef FrameId source_gap = NO_FRAME
    path.source_hops = path.target_hops = 0
    while frame != NO_FRAME:
        top = frame
        if tree.caches[frame].kind == CACHE_UNBORN:
            break
        parent = cache_parent_at(&tree.caches[frame], time_ns)
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
        if tree.caches[frame].kind == CACHE_UNBORN:
            break
        parent = cache_parent_at(&tree.caches[frame], time_ns)
        if parent == NO_FRAME:
            return _gap_status(tree, frame, time_ns)
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
        return _gap_status(tree, source_gap, time_ns)
    return status_of(STATUS_UNCONNECTED)


cdef Status _reference_common_time(const Tree* tree, FrameId target, FrameId source, Path* path,
                                   int64_t* common_ns) noexcept nogil:
    cdef FrameId frame = source
    cdef uint32_t i
    path.source_hops = path.target_hops = 0
    while True:
        path.source[path.source_hops] = frame
        frame = cache_newest_parent(&tree.caches[frame])
        if frame == NO_FRAME:
            break
        path.source_hops += 1
        if frame == target:
            common_ns[0] = walk_path_common_time(tree, path)
            return status_of(STATUS_OK)
        if path.source_hops > MAX_HOPS:
            return status_of(STATUS_LOOP)
    frame = target
    while True:
        path.target[path.target_hops] = frame
        frame = cache_newest_parent(&tree.caches[frame])
        if frame == NO_FRAME:
            return status_of(STATUS_UNCONNECTED)
        path.target_hops += 1
        for i in range(path.source_hops):
            if path.source[i + 1] == frame:
                path.source_hops = i + 1
                common_ns[0] = walk_path_common_time(tree, path)
                return status_of(STATUS_OK)
        if frame == source:
            path.source_hops = 0
            common_ns[0] = walk_path_common_time(tree, path)
            return status_of(STATUS_OK)
        if path.target_hops > MAX_HOPS:
            return status_of(STATUS_LOOP)


cdef Status walk_common_time(const Tree* tree, FrameId target, FrameId source, Path* path,
                             int64_t* common_ns) noexcept nogil:
    cdef bint mixed = False
    if target == source:
        common_ns[0] = tree.caches[source].newest_ns
        return status_of(STATUS_OK)
    if not tree.ever_looped and walk_climb(tree, target, source, NEWEST, path, &mixed):
        common_ns[0] = walk_path_common_time(tree, path)
        return status_of(STATUS_OK)
    return _reference_common_time(tree, target, source, path, common_ns)


cdef Status walk_lookup(const Tree* tree, FrameId target, FrameId source, int64_t time_ns, Path* path,
                        Transform* out, int64_t* stamp_ns) noexcept nogil:
    cdef bint mixed = False
    cdef bint latest = time_ns == 0
    cdef bint found
    cdef Status status
    path.source_hops = path.target_hops = 0
    path.top = source
    stamp_ns[0] = time_ns
    if target == source:
        if latest:
            stamp_ns[0] = tree.caches[source].newest_ns
        if out != NULL:
            transform_identity(out)
        return status_of(STATUS_OK)
    found = (not tree.ever_looped
             and walk_climb(tree, target, source, NEWEST if latest else time_ns, path, &mixed))
    if latest:
        if found:
            stamp_ns[0] = walk_path_common_time(tree, path)
        else:
            status = _reference_common_time(tree, target, source, path, stamp_ns)
            if status.code != STATUS_OK:
                return status
        if found and mixed:
            # At the common time a frame may hang elsewhere than at its newest stamp.
            found = walk_climb(tree, target, source, stamp_ns[0], path, &mixed)
    if not found:
        status = _reference_walk(tree, target, source, stamp_ns[0], path)
        if status.code != STATUS_OK:
            return status
    return _compose(tree, path, stamp_ns[0], out)
