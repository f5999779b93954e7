"""
Owns finding out which changes could help a failed lookup.

A lookup is a walk: it reads the parent and the data of frame after frame at a time. Repeated, it follows the
same path and fails at the same frame until one of these frames gives another answer. So it lacks: another
parent of one of the frames visited, or data of the frame that had none for the time. A lookup at the latest
common time may also be helped by another common time.
"""

from libc.stddef cimport size_t
from libc.stdint cimport INT64_MAX, int64_t, uint32_t
from libc.stdlib cimport free, realloc

from tf2_py._core.cache cimport CACHE_DYNAMIC, Cache
from tf2_py._core.cache_find cimport cache_gap, cache_parent_until
from tf2_py._core.change cimport ANY_TIME, CHANGE_DATA, CHANGE_NAME, CHANGE_PARENT, ChangeKind
from tf2_py._core.lookup cimport Query, query_end_frames, query_fixed_frame
from tf2_py._core.names cimport name_hash
from tf2_py._core.path cimport Path
from tf2_py._core.tree cimport Tree, tree_parent
from tf2_py._core.types cimport (
    GAP_NONE,
    HALF_SOURCE,
    HALF_TARGET,
    MAX_HOPS,
    MIXED_PARENTS,
    NEWEST,
    NO_FRAME,
    STATUS_BAD_FIXED,
    STATUS_BAD_SOURCE,
    STATUS_BAD_TARGET,
    STATUS_OK,
    FrameId,
    Status,
)
from tf2_py._core.walk cimport walk_climb, walk_common_time


cdef struct Visit:
    # What a walk at one time has found.
    FrameId ends[2]         # frames without data for the time
    uint32_t end_count      # of `ends`
    int64_t same_until      # ns; from the walk's time until this one, all frames visited keep their parents


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


cdef void _add_other_parent(const Tree* tree, FrameId frame, int64_t time_ns, int64_t key, Lacks* lacks,
                            Visit* visit) noexcept nogil:
    _add(lacks, CHANGE_PARENT, frame, key)
    if tree.parents[frame] & MIXED_PARENTS and time_ns != NEWEST:
        visit.same_until = min(visit.same_until, cache_parent_until(&tree.caches[frame], time_ns))


cdef void _climb(const Tree* tree, FrameId frame, int64_t time_ns, int64_t key, Lacks* lacks,
                 Visit* visit) noexcept nogil:
    # Up to the root, or to a frame whose parent is not known, or once through a loop, which Brent's algorithm
    # detects.
    cdef FrameId marked = frame
    cdef FrameId parent
    cdef uint32_t hops = 0
    cdef uint32_t next_mark = 1
    while True:
        _add_other_parent(tree, frame, time_ns, key, lacks, visit)
        parent = tree_parent(tree, frame, time_ns)
        if parent == NO_FRAME:
            visit.ends[visit.end_count] = frame
            visit.end_count += 1
            return
        if parent == marked or hops > MAX_HOPS:
            return
        hops += 1
        frame = parent
        if hops == next_mark:
            marked = frame
            next_mark *= 2


cdef void _add_walk(const Tree* tree, FrameId target, FrameId source, int64_t time_ns, int64_t key,
                    Lacks* lacks, Visit* visit) noexcept nogil:
    # Walks as the lookup did, and adds another parent, by `key`, of each frame visited.
    cdef Path path
    cdef bint mixed = False
    cdef uint32_t i
    visit.end_count = 0
    visit.same_until = INT64_MAX
    if tree.ever_looped or not walk_climb(tree, target, source, time_ns, &path, &mixed):
        _climb(tree, source, time_ns, key, lacks, visit)
        _climb(tree, target, time_ns, key, lacks, visit)
        return
    # The path is known. Of several frames without data, to watch one is enough.
    for i in range(path.target_hops):
        _add_other_parent(tree, path.target[i], time_ns, key, lacks, visit)
        if visit.end_count == 0 and cache_gap(&tree.caches[path.target[i]], time_ns) != GAP_NONE:
            visit.ends[0] = path.target[i]
            visit.end_count = 1
    for i in range(path.source_hops):
        _add_other_parent(tree, path.source[i], time_ns, key, lacks, visit)
        if visit.end_count == 0 and cache_gap(&tree.caches[path.source[i]], time_ns) != GAP_NONE:
            visit.ends[0] = path.source[i]
            visit.end_count = 1


cdef void _find_at(const Tree* tree, FrameId target, FrameId source, int64_t time_ns,
                   Lacks* lacks) noexcept nogil:
    cdef Visit visit
    cdef uint32_t i
    _add_walk(tree, target, source, time_ns, time_ns, lacks, &visit)
    for i in range(visit.end_count):
        _add(lacks, CHANGE_DATA, visit.ends[i], time_ns)


cdef FrameId _limiting_frame(const Tree* tree, const FrameId* frames, uint32_t count,
                             int64_t newest_ns) noexcept nogil:
    # The frame that limits the common time; NO_FRAME: none of these.
    cdef uint32_t i
    for i in range(count):
        if tree.caches[frames[i]].newest_ns == newest_ns:
            return frames[i]
    return NO_FRAME


cdef void _find_latest(const Tree* tree, FrameId target, FrameId source, Lacks* lacks) noexcept nogil:
    cdef Path path
    cdef Visit visit
    cdef int64_t common_ns = 0
    cdef int64_t until_ns, middle_ns
    cdef uint32_t i
    cdef FrameId limiting
    cdef const Cache* cache
    if walk_common_time(tree, target, source, &path, &common_ns).code != STATUS_OK:
        visit.end_count = 0
        _climb(tree, source, NEWEST, NEWEST, lacks, &visit)
        _climb(tree, target, NEWEST, NEWEST, lacks, &visit)
        return
    limiting = _limiting_frame(tree, path.source, path.source_hops, common_ns)
    if limiting == NO_FRAME:
        limiting = _limiting_frame(tree, path.target, path.target_hops, common_ns)
    if common_ns == 0 or limiting == NO_FRAME:
        lacks.unknown = True
        return
    if tree.ever_looped:
        # A walk in tf2's order depends on the frames above the common ancestor, too.
        visit.end_count = 0
        _climb(tree, source, NEWEST, ANY_TIME, lacks, &visit)
        _climb(tree, target, NEWEST, ANY_TIME, lacks, &visit)
    for i in range(path.source_hops):
        _add(lacks, CHANGE_PARENT, path.source[i], ANY_TIME)
    for i in range(path.target_hops):
        _add(lacks, CHANGE_PARENT, path.target[i], ANY_TIME)
    # At the common time the path may be another one. Of all this only the common time changes with each
    # insert: until it reaches a time at which something may be different, there is no answer.
    _add_walk(tree, target, source, common_ns, ANY_TIME, lacks, &visit)
    until_ns = visit.same_until
    for i in range(visit.end_count):
        cache = &tree.caches[visit.ends[i]]
        if cache.kind == CACHE_DYNAMIC and cache.count and cache.oldest_ns > common_ns:
            until_ns = min(until_ns, cache.oldest_ns)
    if tree.ever_looped:
        until_ns = common_ns + 1
    # Two histories may grow towards each other: one of them must reach the middle first. So each waiter is
    # tried a few dozen times at most, however many samples are inserted.
    middle_ns = common_ns + (until_ns - common_ns + 1) // 2
    # If the limiting frame becomes static, that is a change of data at all times.
    _add(lacks, CHANGE_DATA, limiting, middle_ns)
    for i in range(visit.end_count):
        cache = &tree.caches[visit.ends[i]]
        if cache.kind != CACHE_DYNAMIC or cache.count == 0:
            continue
        if cache.oldest_ns > common_ns:
            _add(lacks, CHANGE_DATA, visit.ends[i], middle_ns)
        elif cache.newest_ns < common_ns:
            # A history of stamp 0 alone does not count for the common time; with the next sample it does.
            _add(lacks, CHANGE_DATA, visit.ends[i], common_ns if cache.newest_ns else 1)


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
