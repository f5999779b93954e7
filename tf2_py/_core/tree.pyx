"""Owns the tree of frames: inserting transforms, and which frame is the parent of which."""

from libc.math cimport isfinite, isnan
from libc.stdint cimport int64_t, uint32_t, uint64_t
from libc.stdlib cimport calloc, free, malloc, realloc
from libc.string cimport memcmp, memset

from tf2_py._core.cache cimport (
    CACHE_DYNAMIC,
    CACHE_NONE,
    Cache,
    cache_bytes,
    cache_newest_parent,
    cache_parent_of,
)
from tf2_py._core.cache_insert cimport CacheChange, cache_check, cache_insert, cache_set_static
from tf2_py._core.cache_memory cimport (
    CACHE_DUPLICATE,
    CACHE_FULL,
    CACHE_INSERTED,
    CACHE_NO_MEMORY,
    CACHE_TOO_OLD,
    CacheInsert,
    cache_clear,
    cache_free,
)
from tf2_py._core.change cimport (
    CHANGE_DATA,
    CHANGE_NAME,
    Change,
    change_add,
    change_add_parents,
    change_begin,
)
from tf2_py._core.geometry cimport quaternion_canonicalise, quaternion_normalise
from tf2_py._core.names cimport (
    NAME_NO_MEMORY,
    NAME_UNKNOWN,
    name_hash,
    name_strip,
    names_check,
    names_drop,
    names_find,
    names_free,
    names_init,
    names_intern,
)
from tf2_py._core.types cimport (
    MAX_STAMP_NS,
    NO_FRAME,
    REFUSAL_KINDS,
    REFUSED_BYTES,
    REFUSED_FRAMES,
    REFUSED_INFINITE,
    REFUSED_NAN,
    REFUSED_NEGATIVE_STAMP,
    REFUSED_NO_CHILD,
    REFUSED_NO_PARENT,
    REFUSED_OLD,
    REFUSED_QUATERNION,
    REFUSED_RESERVED_NAME,
    REFUSED_SELF_TRANSFORM,
    REFUSED_STAMP_TOO_LATE,
    FrameId,
    Incoming,
    Sample,
)

cdef enum:
    # What costs as much time as inserting one transform.
    SAMPLES_PER_INSERT = 128        # samples moved or read
    HOPS_PER_INSERT = 32            # parent links followed
    NAME_BYTES_PER_INSERT = 256     # bytes of names hashed

TREE_LACKS_MEMORY = "no memory"

cdef const char* RESERVED_NAME = "NO_PARENT"
cdef size_t RESERVED_NAME_SIZE = 9
cdef const char* TOO_MANY_AUTHORITIES = "(too many authorities)"
cdef size_t TOO_MANY_AUTHORITIES_SIZE = 22


cdef int tree_init(Tree* tree, int64_t cache_time_ns, const Limits* limits) noexcept nogil:
    cdef uint32_t refused = 0
    tree.cache_time_ns = cache_time_ns
    tree.limits = limits[0]
    if names_init(&tree.names) != 0 or names_init(&tree.authorities) != 0:
        return -1
    # This authority and the reserved frame have the id 0.
    if names_intern(&tree.authorities, TOO_MANY_AUTHORITIES, TOO_MANY_AUTHORITIES_SIZE) == NAME_NO_MEMORY:
        return -1
    tree_add_frame(tree, RESERVED_NAME, RESERVED_NAME_SIZE, NULL, &refused)
    return -1 if refused else 0


cdef uint32_t tree_authority(Tree* tree, const char* name, size_t size) noexcept nogil:
    cdef uint32_t id = names_find(&tree.authorities, name, size)
    if id != NAME_UNKNOWN:
        return id
    if tree.authorities.count > tree.limits.frames or size > _bytes_left(tree):
        return 0
    return names_intern(&tree.authorities, name, size)


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


cdef inline size_t _bytes_left(const Tree* tree) noexcept nogil:
    # That may still be allocated.
    cdef size_t used = tree_bytes(tree)
    return tree.limits.bytes - used if used < tree.limits.bytes else 0


cdef FrameId tree_add_frame(Tree* tree, const char* name, size_t size, Change* change,
                            uint32_t* refused) noexcept nogil:
    cdef uint32_t id
    cdef uint32_t capacity
    cdef int64_t hash = <int64_t>name_hash(name, size)
    cdef void* grown
    if tree.names.count == tree.capacity:
        capacity = tree.capacity * 2 if tree.capacity else 32
        grown = realloc(tree.caches, capacity * sizeof(Cache))
        if grown != NULL:
            tree.caches = <Cache*>grown
            grown = realloc(tree.parents, capacity * sizeof(uint32_t))
        if grown == NULL:
            refused[0] = TREE_NO_MEMORY
            return NO_FRAME
        tree.parents = <uint32_t*>grown
        tree.capacity = capacity
    id = names_intern(&tree.names, name, size)
    if id == NAME_NO_MEMORY:
        refused[0] = TREE_NO_MEMORY
        return NO_FRAME
    if change != NULL:
        change_add(change, CHANGE_NAME, hash, hash)
    memset(&tree.caches[id], 0, sizeof(Cache))
    tree.caches[id].authority = NAME_UNKNOWN
    tree.caches[id].arena = tree.arena
    tree.parents[id] = NO_FRAME
    return id


cdef FrameId _frame(Tree* tree, const char* name, size_t size, Change* change,
                    uint32_t* refused) noexcept nogil:
    # The frame's id, a new one where the name is unknown; NO_FRAME: it failed, see `refused`.
    cdef uint32_t id = names_find(&tree.names, name, size)
    if id != NAME_UNKNOWN:
        return id
    # The reserved name is not counted.
    if tree.names.count > tree.limits.frames:
        refused[0] = REFUSED_FRAMES
    elif size + sizeof(Cache) > _bytes_left(tree):
        refused[0] = REFUSED_BYTES
    else:
        return tree_add_frame(tree, name, size, change, refused)
    return NO_FRAME


cdef inline bint _is_reserved(const char* name, size_t size) noexcept nogil:
    return size == RESERVED_NAME_SIZE and memcmp(name, RESERVED_NAME, RESERVED_NAME_SIZE) == 0


cdef uint32_t incoming_refusals(Incoming* incoming) noexcept nogil:
    cdef double* t = incoming.transform.translation
    cdef double* q = incoming.transform.rotation
    cdef uint32_t refused = 0
    name_strip(&incoming.parent, &incoming.parent_size)
    name_strip(&incoming.child, &incoming.child_size)
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
    elif incoming.stamp_ns > MAX_STAMP_NS:
        refused |= REFUSED_STAMP_TOO_LATE
    if quaternion_normalise(q):
        quaternion_canonicalise(q)
    else:
        refused |= REFUSED_QUATERNION
    return refused


cdef bint _can_reach(Tree* tree, FrameId start, FrameId wanted) noexcept nogil:
    # Whether parent links of any time lead from `start` up to `wanted`. Needed once per new link.
    cdef FrameId frame = start
    cdef uint32_t hops = 0
    while not tree.parents[frame] & MIXED_PARENTS:
        hops += 1
        if hops % HOPS_PER_INSERT == 0:
            tree.work += 1
        if frame == wanted:
            return True
        if frame == NO_FRAME:
            return False
        frame = tree.parents[frame]
    return _can_reach_by_any_parent(tree, frame, wanted)


cdef bint _can_reach_by_any_parent(Tree* tree, FrameId start, FrameId wanted) noexcept nogil:
    # Depth first. Without memory for that the answer is yes: that costs speed, never correctness.
    cdef size_t frames = tree.names.count
    cdef char* seen = <char*>calloc(frames, 1)
    cdef FrameId* todo = <FrameId*>malloc(frames * sizeof(FrameId))
    cdef uint32_t todo_count = 1
    cdef uint32_t i
    cdef FrameId frame, parent
    cdef const Cache* cache
    cdef bint found = False
    if seen == NULL or todo == NULL:
        free(seen)
        free(todo)
        return True
    seen[start] = 1
    todo[0] = start
    while todo_count and not found:
        todo_count -= 1
        frame = todo[todo_count]
        found = frame == wanted
        cache = &tree.caches[frame]
        tree.work += 1 + cache.count // SAMPLES_PER_INSERT
        for i in range(cache.count):
            parent = cache_parent_of(cache, i)
            if not seen[parent]:
                seen[parent] = 1
                todo[todo_count] = parent
                todo_count += 1
    free(seen)
    free(todo)
    return found


cdef bint _has_parent(Tree* tree, const Cache* cache, FrameId parent) noexcept nogil:
    # Newest first: nearly always it names the parent.
    cdef uint32_t i = cache.count
    while i:
        i -= 1
        if cache_parent_of(cache, i) == parent:
            return True
        if cache.parent_changes == 0:
            return False
    tree.work += cache.count // SAMPLES_PER_INSERT
    return False


cdef uint32_t tree_insert(Tree* tree, Incoming* incoming, uint32_t authority, bint is_static,
                          Change* change) noexcept nogil:
    cdef uint32_t refused = incoming_refusals(incoming)
    cdef FrameId child, parent
    cdef uint32_t known = tree.names.count
    tree.work += (incoming.child_size + incoming.parent_size) // NAME_BYTES_PER_INSERT
    if change != NULL:
        change_begin(change)
    # As in tf2: the child gets its id first, and both keep theirs even where the sample is too old.
    if refused == 0:
        child = _frame(tree, incoming.child, incoming.child_size, change, &refused)
    if refused == 0:
        parent = _frame(tree, incoming.parent, incoming.parent_size, change, &refused)
    if refused == 0:
        refused = _insert(tree, child, parent, incoming, authority, is_static, change)
    if refused == TREE_NO_MEMORY:
        # Nobody has seen them: neither another thread nor another process.
        names_drop(&tree.names, known)
    elif refused:
        tree_count_refused(tree, refused)
    return refused


cdef void tree_count_refused(Tree* tree, uint32_t refused) noexcept nogil:
    cdef uint32_t bit
    for bit in range(<uint32_t>REFUSAL_KINDS):
        tree.refused[bit] += (refused >> bit) & 1


cdef uint32_t _insert(Tree* tree, FrameId child, FrameId parent, const Incoming* incoming, uint32_t authority,
                      bint is_static, Change* change) noexcept nogil:
    # As tree_insert, once the names have their ids.
    cdef Cache* cache = &tree.caches[child]
    cdef Sample sample
    cdef CacheInsert outcome
    cdef CacheChange history
    cdef uint32_t before = tree.parents[child]
    cdef bint had_stamp = cache.newest_ns != 0
    cdef bint limits_common_time
    cdef bint ever_looped = tree.ever_looped
    # Only a frame that has children can close a loop.
    cdef bint may_loop = not ever_looped and cache.is_parent and not _has_parent(tree, cache, parent)
    cdef uint32_t count = cache.count
    cdef size_t bytes_before = cache_bytes(cache)
    cdef size_t growth_limit = _bytes_left(tree)
    sample.transform = incoming.transform
    sample.parent = parent
    if is_static:
        outcome = cache_set_static(cache, incoming.stamp_ns, &sample, growth_limit, &history)
    else:
        outcome = cache_insert(cache, incoming.stamp_ns, &sample, tree.cache_time_ns, growth_limit,
                               &history)
    tree.samples += cache.count - <uint64_t>count
    tree.history_bytes += cache_bytes(cache) - bytes_before
    # Whatever the outcome, the history may have been pruned.
    tree.parents[child] = cache_newest_parent(cache) | (MIXED_PARENTS if cache.parent_changes else 0)
    if outcome == CACHE_INSERTED or outcome == CACHE_DUPLICATE:
        if may_loop:
            tree.ever_looped = _can_reach(tree, parent, child)
        tree.caches[parent].is_parent = True
        cache.authority = authority
        tree.taken += 1
    tree.work += history.moved // SAMPLES_PER_INSERT
    if change != NULL:
        change.frame = child
        change.parent = parent
        # Once a link has closed a loop, all walks are made in tf2's order.
        change.everything = tree.ever_looped != ever_looped
        change_add(change, CHANGE_DATA, history.covered.first, history.covered.last)
        limits_common_time = cache.newest_ns != 0 and not had_stamp
        change_add_parents(change, before, tree.parents[child], limits_common_time, tree.ever_looped,
                           &history)
    if outcome == CACHE_TOO_OLD:
        return REFUSED_OLD
    if outcome == CACHE_FULL:
        return REFUSED_BYTES
    return TREE_NO_MEMORY if outcome == CACHE_NO_MEMORY else 0


cdef FrameId tree_parent(const Tree* tree, FrameId frame, int64_t time_ns) noexcept nogil:
    cdef uint32_t parent = tree.parents[frame]
    if time_ns == NEWEST:
        return parent & ~<uint32_t>MIXED_PARENTS
    if not parent & MIXED_PARENTS and not tree.ever_looped:
        return parent
    return tree_parent_at(tree, frame, time_ns)


cdef void tree_clear(Tree* tree) noexcept nogil:
    cdef uint32_t id
    for id in range(1, tree.names.count):
        if tree.caches[id].kind == CACHE_DYNAMIC:
            tree.samples -= tree.caches[id].count
            tree.history_bytes -= cache_bytes(&tree.caches[id])
            cache_clear(&tree.caches[id])
            tree.history_bytes += cache_bytes(&tree.caches[id])
            tree.parents[id] = NO_FRAME


cdef size_t tree_bytes(const Tree* tree) noexcept nogil:
    return (tree.names.bytes + tree.authorities.bytes + tree.history_bytes
            + tree.capacity * (sizeof(Cache) + sizeof(uint32_t)))


cdef inline uint32_t _links(const Cache* cache) noexcept nogil:
    # How many samples name all parents of a frame.
    return cache.count if cache.parent_changes else min(cache.count, <uint32_t>1)


cdef const char* _check_parents(const Tree* tree, FrameId frame) noexcept nogil:
    cdef const Cache* cache = &tree.caches[frame]
    cdef FrameId parent
    cdef uint32_t i
    for i in range(_links(cache)):
        parent = cache_parent_of(cache, i)
        if parent >= tree.names.count:
            return "a parent that is no frame"
        if parent == frame:
            return "a frame that is its own parent"
        if not tree.caches[parent].is_parent:
            return "a parent that does not know of its children"
    return NULL


cdef const char* _check_loops(const Tree* tree) noexcept nogil:
    # Depth first along the parents of all times: no walk may end where it began.
    cdef size_t frames = tree.names.count
    cdef uint32_t* next_link = <uint32_t*>calloc(frames, sizeof(uint32_t))
    cdef FrameId* path = <FrameId*>malloc(frames * sizeof(FrameId))
    cdef char* state = <char*>calloc(frames, 1)     # 0: not seen; 1: on the path; 2: no loop is above it
    cdef const char* problem = NULL
    cdef FrameId frame, parent, start
    cdef uint32_t hops
    if next_link == NULL or path == NULL or state == NULL:
        problem = TREE_LACKS_MEMORY
        frames = 0
    for start in range(frames):
        hops = 0
        if state[start] == 0:
            path[0] = start
            state[start] = hops = 1
        while hops and problem == NULL:
            frame = path[hops - 1]
            if next_link[frame] == _links(&tree.caches[frame]):
                state[frame] = 2
                hops -= 1
                continue
            parent = cache_parent_of(&tree.caches[frame], next_link[frame])
            next_link[frame] += 1
            if parent >= frames:
                # Another process may have changed it since it was checked.
                problem = "a parent that is no frame"
            elif state[parent] == 1:
                problem = "a loop that is not marked"
            elif state[parent] == 0:
                state[parent] = 1
                path[hops] = parent
                hops += 1
    free(next_link)
    free(path)
    free(state)
    return problem


cdef void tree_relink(Tree* tree) noexcept nogil:
    cdef FrameId frame
    cdef const Cache* cache
    cdef uint32_t i
    tree.samples = tree.history_bytes = 0
    for frame in range(1, tree.names.count):
        cache = &tree.caches[frame]
        tree.samples += cache.count
        tree.history_bytes += cache_bytes(cache)
        tree.parents[frame] = cache_newest_parent(cache) | (MIXED_PARENTS if cache.parent_changes else 0)
        for i in range(_links(cache)):
            tree.caches[cache_parent_of(cache, i)].is_parent = True
    tree.ever_looped = tree.ever_looped or _check_loops(tree) != NULL


cdef const char* tree_check(const Tree* tree) noexcept nogil:
    cdef uint32_t id, expected
    cdef uint64_t samples = 0
    cdef size_t history_bytes = 0
    cdef const Cache* cache
    cdef const char* problem
    if tree.names.count == 0 or tree.names.count > tree.capacity:
        return "frame count beyond capacity"
    problem = names_check(&tree.names)
    if problem == NULL:
        problem = names_check(&tree.authorities)
    if problem != NULL:
        return problem
    if tree.caches[0].kind != CACHE_NONE:
        return "the reserved frame has a history"
    for id in range(tree.names.count):
        cache = &tree.caches[id]
        problem = cache_check(cache)
        if problem != NULL:
            return problem
        expected = cache_newest_parent(cache) | (MIXED_PARENTS if cache.parent_changes else 0)
        if tree.parents[id] != expected:
            return "parents disagrees with the history"
        problem = _check_parents(tree, id)
        if problem != NULL:
            return problem
        if cache.authority != NAME_UNKNOWN and cache.authority >= tree.authorities.count:
            return "an authority that is no name"
        samples += cache.count
        history_bytes += cache_bytes(cache)
    if samples != tree.samples or (history_bytes != tree.history_bytes and tree.mirror == NULL):
        return "samples or their bytes miscounted"
    return NULL if tree.ever_looped else _check_loops(tree)
