"""
Owns the question of what could help a failed lookup.

A lookup is a walk: it asks frame after frame for its parent and its data at a time. Walked again, it goes
the same way and fails at the same place until one of these frames gives another answer. So it lacks: another
parent of one of the frames that it has met, or data where it stopped for want of these. A lookup at the
latest common time also lacks another such time.
"""

from libc.stddef cimport size_t
from libc.stdint cimport INT64_MAX, int64_t, uint32_t
from libc.stdlib cimport free, realloc

from tf2_py._core.cache cimport CACHE_DYNAMIC, Cache
from tf2_py._core.cache_find cimport cache_gap, cache_parent_until
from tf2_py._core.lookup cimport Query, query_end_frames, query_fixed_frame
from tf2_py._core.names cimport name_hash
from tf2_py._core.path cimport Path
from tf2_py._core.tree cimport (
    ANY_TIME,
    CHANGE_DATA,
    CHANGE_NAME,
    CHANGE_PARENT,
    MIXED_PARENTS,
    NEWEST,
    ChangeKind,
    Tree,
    tree_parent,
)
from tf2_py._core.types cimport (
    GAP_NONE,
    HALF_SOURCE,
    HALF_TARGET,
    MAX_HOPS,
    NO_FRAME,
    STATUS_BAD_FIXED,
    STATUS_BAD_SOURCE,
    STATUS_BAD_TARGET,
    STATUS_OK,
    FrameId,
    Status,
)
from tf2_py._core.walk cimport walk_climb, walk_common_time


cdef struct Met:
    # What a walk at one time has met.
    FrameId ends[2]         # frames without data for the time
    uint32_t end_count
    int64_t same_until      # from its time until this one, all frames keep their parents


cdef void lacks_free(Lacks* lacks) noexcept nogil:
    free(lacks.items)


cdef void _add(Lacks* lacks, ChangeKind kind, FrameId frame, int64_t key) noexcept nogil:
    cdef uint32_t capacity
    cdef void* grown
    if lacks.count == lacks.capacity:
        capacity = lacks.capacity * 2 if lacks.capacity else 16
        grown = realloc(lacks.items, capacity * sizeof(Lack))
        if grown == NULL:
            lacks.unknown = True
            return
        lacks.items = <Lack*>grown
        lacks.capacity = capacity
    lacks.items[lacks.count].kind = kind
    lacks.items[lacks.count].frame = frame
    lacks.items[lacks.count].key = key
    lacks.count += 1


cdef inline void _add_name(Lacks* lacks, const char* name, Py_ssize_t size) noexcept nogil:
    _add(lacks, CHANGE_NAME, NO_FRAME, <int64_t>name_hash(name, <size_t>size))


cdef void _add_parent(const Tree* tree, FrameId frame, int64_t time_ns, int64_t key, Lacks* lacks,
                      Met* met) noexcept nogil:
    _add(lacks, CHANGE_PARENT, frame, key)
    if tree.parents[frame] & MIXED_PARENTS and time_ns != NEWEST:
        met.same_until = min(met.same_until, cache_parent_until(&tree.caches[frame], time_ns))


cdef void _climb(const Tree* tree, FrameId frame, int64_t time_ns, int64_t key, Lacks* lacks,
                 Met* met) noexcept nogil:
    # Up to the root, or where the parent is not known, or once through a loop: Brent's algorithm finds its
    # end.
    cdef FrameId marked = frame
    cdef FrameId parent
    cdef uint32_t hops = 0
    cdef uint32_t next_mark = 1
    while True:
        _add_parent(tree, frame, time_ns, key, lacks, met)
        parent = tree_parent(tree, frame, time_ns)
        if parent == NO_FRAME:
            met.ends[met.end_count] = frame
            met.end_count += 1
            return
        if parent == marked or hops > MAX_HOPS:
            return
        hops += 1
        frame = parent
        if hops == next_mark:
            marked = frame
            next_mark *= 2


cdef void _walk_again(const Tree* tree, FrameId target, FrameId source, int64_t time_ns, int64_t key,
                      Lacks* lacks, Met* met) noexcept nogil:
    # Adds another parent, by `key`, of each frame on the way.
    cdef Path path
    cdef bint mixed = False
    cdef uint32_t i
    met.end_count = 0
    met.same_until = INT64_MAX
    if tree.ever_looped or not walk_climb(tree, target, source, time_ns, &path, &mixed):
        _climb(tree, source, time_ns, key, lacks, met)
        _climb(tree, target, time_ns, key, lacks, met)
        return
    # The path is known. Of several frames without data any one will do.
    for i in range(path.target_hops):
        _add_parent(tree, path.target[i], time_ns, key, lacks, met)
        if met.end_count == 0 and cache_gap(&tree.caches[path.target[i]], time_ns) != GAP_NONE:
            met.ends[0] = path.target[i]
            met.end_count = 1
    for i in range(path.source_hops):
        _add_parent(tree, path.source[i], time_ns, key, lacks, met)
        if met.end_count == 0 and cache_gap(&tree.caches[path.source[i]], time_ns) != GAP_NONE:
            met.ends[0] = path.source[i]
            met.end_count = 1


cdef void _find_at(const Tree* tree, FrameId target, FrameId source, int64_t time_ns,
                   Lacks* lacks) noexcept nogil:
    cdef Met met
    cdef uint32_t i
    _walk_again(tree, target, source, time_ns, time_ns, lacks, &met)
    for i in range(met.end_count):
        _add(lacks, CHANGE_DATA, met.ends[i], time_ns)


cdef FrameId _slowest(const Tree* tree, const FrameId* frames, uint32_t count,
                      int64_t newest_ns) noexcept nogil:
    cdef uint32_t i
    for i in range(count):
        if tree.caches[frames[i]].newest_ns == newest_ns:
            return frames[i]
    return NO_FRAME


cdef void _find_latest(const Tree* tree, FrameId target, FrameId source, Lacks* lacks) noexcept nogil:
    cdef Path path
    cdef Met met
    cdef int64_t common_ns = 0
    cdef int64_t until_ns, middle_ns
    cdef uint32_t i
    cdef FrameId slowest
    cdef const Cache* cache
    if walk_common_time(tree, target, source, &path, &common_ns).code != STATUS_OK:
        met.end_count = 0
        _climb(tree, source, NEWEST, NEWEST, lacks, &met)
        _climb(tree, target, NEWEST, NEWEST, lacks, &met)
        return
    slowest = _slowest(tree, path.source, path.source_hops, common_ns)
    if slowest == NO_FRAME:
        slowest = _slowest(tree, path.target, path.target_hops, common_ns)
    if common_ns == 0 or slowest == NO_FRAME:
        lacks.unknown = True
        return
    if tree.ever_looped:
        # There, what lies above decides as well.
        met.end_count = 0
        _climb(tree, source, NEWEST, ANY_TIME, lacks, &met)
        _climb(tree, target, NEWEST, ANY_TIME, lacks, &met)
    for i in range(path.source_hops):
        _add(lacks, CHANGE_PARENT, path.source[i], ANY_TIME)
    for i in range(path.target_hops):
        _add(lacks, CHANGE_PARENT, path.target[i], ANY_TIME)
    # At the common time the way may be another one. Nothing but the common time itself moves with each
    # insert: until it comes to a time at which something may be different, there is no answer.
    _walk_again(tree, target, source, common_ns, ANY_TIME, lacks, &met)
    until_ns = met.same_until
    for i in range(met.end_count):
        cache = &tree.caches[met.ends[i]]
        if cache.kind == CACHE_DYNAMIC and cache.count and cache.oldest_ns > common_ns:
            until_ns = min(until_ns, cache.oldest_ns)
    if tree.ever_looped:
        until_ns = common_ns + 1
    # Two histories may grow towards each other: one of them must come to the middle first. So each wait looks
    # again a few dozen times at the most, however many samples come in.
    middle_ns = common_ns + (until_ns - common_ns + 1) // 2
    # Also that the slowest frame becomes static shows in all of its times.
    _add(lacks, CHANGE_DATA, slowest, middle_ns)
    for i in range(met.end_count):
        cache = &tree.caches[met.ends[i]]
        if cache.kind != CACHE_DYNAMIC or cache.count == 0:
            continue
        if cache.oldest_ns > common_ns:
            _add(lacks, CHANGE_DATA, met.ends[i], middle_ns)
        elif cache.newest_ns < common_ns:
            # A history of stamp 0 alone has no say in the common time, and has one with the next sample.
            _add(lacks, CHANGE_DATA, met.ends[i], common_ns if cache.newest_ns else 1)


cdef void lacks_find(const Tree* tree, const Query* query, Status status, Lacks* lacks) noexcept nogil:
    cdef FrameId target, source
    cdef int64_t time_ns = query.source_ns
    lacks.count = 0
    lacks.unknown = False
    if status.code == STATUS_BAD_TARGET:
        _add_name(lacks, query.target, query.target_size)
    elif status.code == STATUS_BAD_SOURCE:
        _add_name(lacks, query.source, query.source_size)
    elif status.code == STATUS_BAD_FIXED:
        _add_name(lacks, query.fixed, query.fixed_size)
    else:
        # Of a lookup at two times, the half that failed.
        query_end_frames(tree, query, &target, &source)
        if query.fixed != NULL and status.half == HALF_SOURCE:
            target = query_fixed_frame(tree, query)
        elif query.fixed != NULL and status.half == HALF_TARGET:
            source = query_fixed_frame(tree, query)
            time_ns = query.target_ns
        if time_ns == 0:
            _find_latest(tree, target, source, lacks)
        else:
            _find_at(tree, target, source, time_ns, lacks)
    lacks.unknown = lacks.unknown or lacks.count == 0
