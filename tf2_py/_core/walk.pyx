"""Owns finding the path between two frames: up from both, to their lowest common ancestor."""

from libc.stdint cimport int64_t, uint32_t, uint64_t
from libc.string cimport memset

from tf2_py._core.geometry cimport transform_identity
from tf2_py._core.path cimport Path, path_common_time, path_transform
from tf2_py._core.reference_walk cimport reference_common_time, reference_walk
from tf2_py._core.tree cimport Tree, tree_parent_at
from tf2_py._core.types cimport (
    MAX_HOPS,
    MIXED_PARENTS,
    NEWEST,
    NO_FRAME,
    STATUS_OK,
    FrameId,
    Status,
    Transform,
    status_of,
)


cdef enum:
    SEEN_WORDS = 8          # 512 bits for each side


cdef extern from *:
    void __builtin_prefetch(const void* address) nogil


cdef struct Side:
    # One of the two climbs, and the frames that it has visited.
    FrameId* frames             # in the order of the visits
    uint32_t count
    FrameId top                 # the last one; NO_FRAME: it has no parent
    uint64_t bits[SEEN_WORDS]   # a Bloom filter of the frames: where its bit is set, the list is searched


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
    # The index of `wanted` among the frames; `count`: it is not among them.
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
    return tree_parent_at(tree, frame, time_ns)


cdef inline bint _step(const Tree* tree, Side* side, const Side* other, int64_t time_ns, bint* mixed,
                       uint32_t* met_at) noexcept nogil:
    # One hop up. True: that is a frame of the other side, with the index `met_at`.
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


cdef Status walk_common_time(const Tree* tree, FrameId target, FrameId source, Path* path,
                             int64_t* common_ns) noexcept nogil:
    cdef bint mixed = False
    if target == source:
        common_ns[0] = tree.caches[source].newest_ns
        return status_of(STATUS_OK)
    if not tree.ever_looped and walk_climb(tree, target, source, NEWEST, path, &mixed):
        common_ns[0] = path_common_time(tree, path)
        return status_of(STATUS_OK)
    return reference_common_time(tree, target, source, path, common_ns)


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
            stamp_ns[0] = path_common_time(tree, path)
        else:
            status = reference_common_time(tree, target, source, path, stamp_ns)
            if status.code != STATUS_OK:
                return status
        if found and mixed:
            # At the common time a frame may have another parent than at its newest stamp.
            found = walk_climb(tree, target, source, stamp_ns[0], path, &mixed)
    if not found:
        status = reference_walk(tree, target, source, stamp_ns[0], path)
        if status.code != STATUS_OK:
            return status
    return path_transform(tree, path, stamp_ns[0], out)
