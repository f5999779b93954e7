"""Owns the tree of frames: what is taken into it, and which frame hangs below which."""

from libc.math cimport isfinite, isnan
from libc.stdint cimport int64_t, uint32_t, uint64_t
from libc.stdlib cimport calloc, free, malloc, realloc
from libc.string cimport memcmp, memset

from tf2_py._cache cimport (
    CACHE_DYNAMIC,
    CACHE_NO_MEMORY,
    CACHE_TOO_OLD,
    CACHE_UNBORN,
    Cache,
    CacheInsert,
    CacheKind,
    cache_bytes,
    cache_check,
    cache_clear,
    cache_free,
    cache_insert,
    cache_newest_parent,
    cache_set_static,
    cache_slot,
)
from tf2_py._geometry cimport quaternion_canonicalise, quaternion_normalise
from tf2_py._names cimport (
    NAME_NO_MEMORY,
    NAME_UNKNOWN,
    names_find,
    names_free,
    names_init,
    names_intern,
)
from tf2_py._types cimport (
    NO_FRAME,
    REFUSAL_KINDS,
    REFUSED_INFINITE,
    REFUSED_NAN,
    REFUSED_NEGATIVE_STAMP,
    REFUSED_NO_CHILD,
    REFUSED_NO_PARENT,
    REFUSED_OLD,
    REFUSED_QUATERNION,
    REFUSED_RESERVED_NAME,
    REFUSED_SELF_TRANSFORM,
    FrameId,
    Incoming,
    Sample,
)

cdef const char* RESERVED_NAME = "NO_PARENT"
cdef size_t RESERVED_SIZE = 9


cdef int tree_init(Tree* tree, int64_t cache_time_ns) noexcept nogil:
    tree.cache_time_ns = cache_time_ns
    if names_init(&tree.names) != 0 or names_init(&tree.authorities) != 0:
        return -1
    if _frame(tree, RESERVED_NAME, RESERVED_SIZE) == NAME_NO_MEMORY:
        return -1
    return 0


cdef void tree_free(Tree* tree) noexcept nogil:
    cdef uint32_t id
    for id in range(tree.names.count if tree.caches != NULL else 0):
        cache_free(&tree.caches[id])
    free(tree.caches)
    free(tree.parents)
    names_free(&tree.names)
    names_free(&tree.authorities)


cdef FrameId tree_frame(const Tree* tree, const char* name, size_t size) noexcept nogil:
    cdef uint32_t id = names_find(&tree.names, name, size)
    return NO_FRAME if id == NAME_UNKNOWN else id


cdef uint32_t _frame(Tree* tree, const char* name, size_t size) noexcept nogil:
    # The frame's id, made where it is new; NAME_NO_MEMORY and no new frame where that fails.
    cdef uint32_t id = names_find(&tree.names, name, size)
    cdef uint32_t capacity
    cdef void* grown
    if id != NAME_UNKNOWN:
        return id
    if tree.names.count == tree.capacity:
        capacity = tree.capacity * 2 if tree.capacity else 32
        grown = realloc(tree.caches, capacity * sizeof(Cache))
        if grown == NULL:
            return NAME_NO_MEMORY
        tree.caches = <Cache*>grown
        grown = realloc(tree.parents, capacity * sizeof(uint32_t))
        if grown == NULL:
            return NAME_NO_MEMORY
        tree.parents = <uint32_t*>grown
        tree.capacity = capacity
    id = names_intern(&tree.names, name, size)
    if id != NAME_NO_MEMORY:
        tree.changes += 1
        memset(&tree.caches[id], 0, sizeof(Cache))
        tree.caches[id].authority = NAME_UNKNOWN
        tree.parents[id] = NO_FRAME
    return id


cdef inline bint _is_reserved(const char* name, size_t size) noexcept nogil:
    return size == RESERVED_SIZE and memcmp(name, RESERVED_NAME, RESERVED_SIZE) == 0


cdef uint32_t _check(Incoming* incoming) noexcept nogil:
    # Every reason that applies, and the two changes that tf2 makes on the way in.
    cdef double* t = incoming.transform.translation
    cdef double* q = incoming.transform.rotation
    cdef uint32_t refused = 0
    if incoming.parent_size and incoming.parent[0] == b"/":
        incoming.parent += 1
        incoming.parent_size -= 1
    if incoming.child_size and incoming.child[0] == b"/":
        incoming.child += 1
        incoming.child_size -= 1
    if incoming.parent_size == incoming.child_size \
            and memcmp(incoming.parent, incoming.child, incoming.child_size) == 0:
        refused |= REFUSED_SELF_TRANSFORM
    if incoming.parent_size == 0:
        refused |= REFUSED_NO_PARENT
    if incoming.child_size == 0:
        refused |= REFUSED_NO_CHILD
    if _is_reserved(incoming.parent, incoming.parent_size) \
            or _is_reserved(incoming.child, incoming.child_size):
        refused |= REFUSED_RESERVED_NAME
    if isnan(t[0]) or isnan(t[1]) or isnan(t[2]) or isnan(q[0]) or isnan(q[1]) or isnan(q[2]) or isnan(q[3]):
        refused |= REFUSED_NAN
    elif not (isfinite(t[0]) and isfinite(t[1]) and isfinite(t[2])):
        refused |= REFUSED_INFINITE
    if incoming.stamp_ns < 0:
        refused |= REFUSED_NEGATIVE_STAMP
    if quaternion_normalise(q):
        quaternion_canonicalise(q)
    else:
        refused |= REFUSED_QUATERNION
    return refused


cdef bint _can_reach(const Tree* tree, FrameId start, FrameId wanted) noexcept nogil:
    # Whether parent links of any time lead from `start` up to `wanted`. Asked once per new link.
    cdef FrameId frame = start
    while not tree.parents[frame] & MIXED_PARENTS:
        if frame == wanted:
            return True
        if frame == NO_FRAME:
            return False
        frame = tree.parents[frame]
    return _can_reach_by_any_parent(tree, frame, wanted)


cdef bint _can_reach_by_any_parent(const Tree* tree, FrameId start, FrameId wanted) noexcept nogil:
    # Depth first. Without memory for that the answer is yes: it costs speed, never correctness.
    cdef size_t frames = tree.names.count
    cdef char* seen = <char*>calloc(frames, 1)
    cdef FrameId* waiting = <FrameId*>malloc(frames * sizeof(FrameId))
    cdef uint32_t waiting_count = 1
    cdef uint32_t i
    cdef FrameId frame, parent
    cdef const Cache* cache
    cdef bint found = False
    if seen == NULL or waiting == NULL:
        free(seen)
        free(waiting)
        return True
    seen[start] = 1
    waiting[0] = start
    while waiting_count and not found:
        waiting_count -= 1
        frame = waiting[waiting_count]
        found = frame == wanted
        cache = &tree.caches[frame]
        for i in range(cache.count):
            parent = cache.samples[cache_slot(cache, i)].parent
            if not seen[parent]:
                seen[parent] = 1
                waiting[waiting_count] = parent
                waiting_count += 1
    free(seen)
    free(waiting)
    return found


cdef bint _has_parent(const Cache* cache, FrameId parent) noexcept nogil:
    # Newest first: it is nearly always the one.
    cdef uint32_t i = cache.count
    while i:
        i -= 1
        if cache.samples[cache_slot(cache, i)].parent == parent:
            return True
        if cache.parent_changes == 0:
            return False
    return False


cdef uint32_t tree_insert(Tree* tree, Incoming* incoming, uint32_t authority, bint is_static,
                          FrameId* changed) noexcept nogil:
    cdef uint32_t refused = _check(incoming)
    cdef uint32_t child, parent, newest, bit
    cdef CacheKind kind
    cdef Cache* cache
    cdef Sample sample
    cdef CacheInsert outcome
    cdef bint new_link
    if refused == 0:
        # The child gets its id first, and both keep theirs even if the sample turns out too old.
        child = _frame(tree, incoming.child, incoming.child_size)
        if child == NAME_NO_MEMORY:
            return TREE_NO_MEMORY
        parent = _frame(tree, incoming.parent, incoming.parent_size)
        if parent == NAME_NO_MEMORY:
            return TREE_NO_MEMORY
        changed[0] = child
        cache = &tree.caches[child]
        sample.transform = incoming.transform
        sample.parent = parent
        kind = cache.kind
        new_link = not _has_parent(cache, parent)
        if is_static:
            outcome = cache_set_static(cache, incoming.stamp_ns, &sample)
        else:
            outcome = cache_insert(cache, incoming.stamp_ns, &sample, tree.cache_time_ns)
        if outcome == CACHE_NO_MEMORY:
            return TREE_NO_MEMORY
        if outcome != CACHE_TOO_OLD:
            if new_link and not tree.ever_looped:
                tree.ever_looped = _can_reach(tree, parent, child)
            newest = cache_newest_parent(cache) | (MIXED_PARENTS if cache.parent_changes else 0)
            # A late sample between others of another parent is not told apart: any insert into such a frame
            # counts.
            if new_link or cache.kind != kind or newest != tree.parents[child] or newest & MIXED_PARENTS:
                tree.changes += 1
            tree.parents[child] = newest
            cache.authority = authority
            tree.taken += 1
            return 0
        # Pruning comes before the refusal.
        tree.parents[child] = cache_newest_parent(cache) | (MIXED_PARENTS if cache.parent_changes else 0)
        refused = REFUSED_OLD
    for bit in range(REFUSAL_KINDS):
        tree.refused[bit] += (refused >> bit) & 1
    return refused


cdef void tree_clear(Tree* tree) noexcept nogil:
    cdef uint32_t id
    for id in range(1, tree.names.count):
        if tree.caches[id].kind == CACHE_DYNAMIC:
            cache_clear(&tree.caches[id])
            tree.parents[id] = NO_FRAME


cdef size_t tree_bytes(const Tree* tree) noexcept nogil:
    cdef uint32_t id
    cdef size_t total = tree.names.bytes + tree.authorities.bytes
    total += tree.capacity * (sizeof(Cache) + sizeof(uint32_t))
    for id in range(tree.names.count):
        total += cache_bytes(&tree.caches[id])
    return total


cdef uint64_t tree_samples(const Tree* tree) noexcept nogil:
    cdef uint32_t id
    cdef uint64_t total = 0
    for id in range(tree.names.count):
        total += tree.caches[id].count
    return total


cdef const char* tree_check(const Tree* tree) noexcept nogil:
    cdef uint32_t id, expected
    cdef const Cache* cache
    cdef const char* problem
    if tree.names.count == 0 or tree.names.count > tree.capacity:
        return "frame count beyond capacity"
    if tree.caches[0].kind != CACHE_UNBORN:
        return "the reserved frame has a history"
    for id in range(tree.names.count):
        cache = &tree.caches[id]
        problem = cache_check(cache)
        if problem != NULL:
            return problem
        expected = cache_newest_parent(cache) | (MIXED_PARENTS if cache.parent_changes else 0)
        if tree.parents[id] != expected:
            return "parents disagrees with the history"
        if (expected & ~<uint32_t>MIXED_PARENTS) >= tree.names.count:
            return "a parent that is no frame"
        if cache.authority != NAME_UNKNOWN and cache.authority >= tree.authorities.count:
            return "an authority that is no name"
    return NULL
