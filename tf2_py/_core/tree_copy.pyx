"""Owns the flat form of a tree."""

from libc.stddef cimport size_t
from libc.stdint cimport SIZE_MAX, uint32_t, uint64_t
from libc.stdlib cimport free, malloc
from libc.string cimport memchr, memcpy

from tf2_py._core.cache cimport (
    CACHE_DYNAMIC,
    CACHE_STATIC,
    Cache,
    CacheKind,
    cache_bytes,
    cache_newest_parent,
)
from tf2_py._core.cache_copy cimport TRANSFORM_DOUBLES, cache_export, cache_import
from tf2_py._core.cache_memory cimport (
    CACHE_INSERTED,
    LAST_CAPACITY,
    cache_move,
    cache_pin,
    cache_unpin,
)
from tf2_py._core.cache_insert cimport cache_mend
from tf2_py._core.lock cimport Lock
from tf2_py._core.mirror cimport mirror_holds
from tf2_py._core.mirror_state cimport Mirror
from tf2_py._core.names cimport NAME_NO_MEMORY, NAME_UNKNOWN, Names, names_find, names_intern
from tf2_py._core.reading cimport Reading, reading_begin, reading_continue
from tf2_py._core.segment cimport segment_ask_for_pause
from tf2_py._core.tree cimport (
    TREE_LACKS_MEMORY,
    Tree,
    tree_add_frame,
    tree_check,
    tree_init,
)
from tf2_py._core.types cimport MIXED_PARENTS, FrameId

cdef enum:
    TRIES = 50      # to copy another process's histories as of one moment


cdef inline size_t _terminated_size(const Names* names) noexcept nogil:
    # Of all names but that with the id 0, each with a NUL behind it.
    return names.text_size - names.names[0].size + names.count - 1


cdef void _copy_terminated(const Names* names, char* out) noexcept nogil:
    cdef uint32_t id
    cdef uint32_t size
    for id in range(1, names.count):
        size = names.names[id].size
        memcpy(out, names.text + names.names[id].start, size)
        out[size] = 0
        out += size + 1


cdef bint _pin(const Tree* tree, PinnedTree* pinned) noexcept nogil:
    cdef FrameId id
    pinned.view = tree[0]
    pinned.names_size = _terminated_size(&tree.names)
    pinned.authorities_size = _terminated_size(&tree.authorities)
    pinned.names = <char*>malloc(pinned.names_size + pinned.authorities_size + 1)
    pinned.view.caches = <Cache*>malloc(tree.names.count * sizeof(Cache))
    if pinned.names == NULL or pinned.view.caches == NULL:
        free(pinned.names)
        free(pinned.view.caches)
        return False
    for id in range(tree.names.count):
        cache_pin(&tree.caches[id], &pinned.view.caches[id])
    _copy_terminated(&tree.names, pinned.names)
    _copy_terminated(&tree.authorities, pinned.names + pinned.names_size)
    return True


cdef bint _copy_pinned(PinnedTree* pinned, const Mirror* mirror, bint must_hold, bint* holds) noexcept nogil:
    # Of a tree that mirrors another process's: histories of its own. False: no memory.
    cdef Cache* cache
    cdef Cache noted
    cdef FrameId id
    holds[0] = True
    for id in range(pinned.view.names.count):
        cache = &pinned.view.caches[id]
        noted = cache[0]
        if cache.capacity and cache_move(cache, cache.capacity, SIZE_MAX // 2) != CACHE_INSERTED:
            return False
        if mirror_holds(mirror, &id, &noted, 1):
            continue
        if must_hold:
            holds[0] = False
            return True
        # Of the last copy, what is sound is kept.
        pinned.view.samples -= cache.count
        cache_mend(cache, id, pinned.view.names.count)
        pinned.view.samples += cache.count
    return True


cdef bint tree_pin(const Tree* tree, Lock* lock, PinnedTree* pinned) noexcept nogil:
    cdef Reading reading
    cdef Mirror* mirror = NULL
    cdef bint is_pinned = False
    cdef bint holds = False
    cdef uint32_t tries = 0
    while not holds:
        if is_pinned:
            tree_unpin(pinned)
            is_pinned = False
        reading_begin(&reading, tree, lock)
        while reading_continue(&reading):
            if is_pinned:
                tree_unpin(pinned)
            mirror = tree.mirror
            is_pinned = _pin(tree, pinned)
        if not is_pinned:
            return False
        if mirror == NULL:
            return True
        if tries:
            segment_ask_for_pause(mirror.segment, tries)
        if not _copy_pinned(pinned, mirror, tries < TRIES, &holds):
            tree_unpin(pinned)
            return False
        tries += 1
    return True


cdef void tree_unpin(PinnedTree* pinned) noexcept nogil:
    cdef FrameId id
    for id in range(pinned.view.names.count):
        cache_unpin(&pinned.view.caches[id])
    free(pinned.view.caches)
    free(pinned.names)


cdef void tree_export(const PinnedTree* pinned, TreeArrays* arrays) noexcept nogil:
    cdef const Tree* view = &pinned.view
    cdef const Cache* cache
    cdef FrameRow* row
    cdef FrameId id
    cdef uint64_t at = 0
    for id in range(1, view.names.count):
        cache = &view.caches[id]
        row = &arrays.frames[id - 1]
        row.kind = cache.kind
        row.count = cache.count
        row.authority = cache.authority
        row.is_parent = cache.is_parent
        row.capacity = cache.capacity
        row.mostly_empty_for = cache.mostly_empty_for
        cache_export(cache, arrays.stamps + at, arrays.transforms + at * TRANSFORM_DOUBLES,
                     arrays.parents + at)
        at += cache.count
    arrays.names = pinned.names
    arrays.names_size = pinned.names_size
    arrays.authorities = pinned.names + pinned.names_size
    arrays.authorities_size = pinned.authorities_size
    arrays.frame_count = view.names.count - 1
    arrays.sample_count = at
    arrays.cache_time_ns = view.cache_time_ns
    arrays.limits = view.limits
    arrays.ever_looped = view.ever_looped
    arrays.taken = view.taken
    memcpy(arrays.refused, view.refused, sizeof(view.refused))


cdef const char* _next_name(const Names* known, const char* text, size_t left, size_t* size) noexcept nogil:
    # The size of the name that `text` begins with. NULL, or why there is none.
    cdef const char* end = <const char*>memchr(<const void*>text, 0, left)
    if end == NULL:
        return "the last name does not end with a NUL"
    size[0] = end - text
    if names_find(known, text, size[0]) != NAME_UNKNOWN:
        return "a name occurs twice, or is a reserved one"
    return NULL


cdef const char* _import_frame_names(const TreeArrays* arrays, Tree* tree) noexcept nogil:
    cdef const char* text = arrays.names
    cdef const char* problem
    cdef size_t left = arrays.names_size
    cdef size_t size
    cdef uint32_t refused = 0
    while left:
        problem = _next_name(&tree.names, text, left, &size)
        if problem != NULL:
            return problem
        if size == 0:
            return "the name of a frame is empty"
        if tree.names.count > tree.limits.frames or tree.names.count > arrays.frame_count:
            return "there are more names than frames, or than the limit of frames allows"
        tree_add_frame(tree, text, size, NULL, &refused)
        if refused:
            return TREE_LACKS_MEMORY
        text += size + 1
        left -= size + 1
    if tree.names.count - 1 != arrays.frame_count:
        return "there are more frames than names"
    return NULL


cdef const char* _import_authorities(const TreeArrays* arrays, Tree* tree) noexcept nogil:
    cdef const char* text = arrays.authorities
    cdef const char* problem
    cdef size_t left = arrays.authorities_size
    cdef size_t size
    while left:
        problem = _next_name(&tree.authorities, text, left, &size)
        if problem != NULL:
            return problem
        if names_intern(&tree.authorities, text, size) == NAME_NO_MEMORY:
            return TREE_LACKS_MEMORY
        text += size + 1
        left -= size + 1
    return NULL


cdef const char* _import_history(const TreeArrays* arrays, FrameId id, uint64_t* at,
                                 Tree* tree) noexcept nogil:
    # The history of one frame, whose samples begin at `at`, which is moved behind them.
    cdef Cache* cache = &tree.caches[id]
    cdef FrameRow row = arrays.frames[id - 1]       # once: see tree_import
    if row.kind > CACHE_STATIC or row.is_parent > 1:
        return "the row of a frame holds a value that has no meaning"
    if row.count > row.capacity or row.capacity > LAST_CAPACITY:
        return "a frame has more samples than its capacity, or one that is too large"
    if row.kind != CACHE_DYNAMIC and row.capacity != <uint32_t>(row.kind == CACHE_STATIC):
        return "a frame has a capacity that is none of its kind"
    if row.count > arrays.sample_count - at[0]:
        return "the frames have more samples than there are stamps"
    if row.capacity and cache_move(cache, row.capacity, SIZE_MAX // 2) != CACHE_INSERTED:
        return TREE_LACKS_MEMORY
    cache.kind = <CacheKind>row.kind
    cache.authority = row.authority
    cache.is_parent = row.is_parent
    cache.mostly_empty_for = row.mostly_empty_for
    cache_import(cache, row.count, arrays.stamps + at[0], arrays.transforms + at[0] * TRANSFORM_DOUBLES,
                 arrays.parents + at[0])
    at[0] += row.count
    tree.parents[id] = cache_newest_parent(cache) | (MIXED_PARENTS if cache.parent_changes else 0)
    tree.samples += cache.count
    tree.history_bytes += cache_bytes(cache)
    return NULL


cdef const char* tree_import(const TreeArrays* arrays, Tree* tree) noexcept nogil:
    cdef const char* problem
    cdef uint64_t at = 0
    cdef FrameId id
    if tree_init(tree, arrays.cache_time_ns, &arrays.limits) != 0:
        return TREE_LACKS_MEMORY
    problem = _import_frame_names(arrays, tree)
    if problem == NULL:
        problem = _import_authorities(arrays, tree)
    if problem != NULL:
        return problem
    for id in range(1, tree.names.count):
        problem = _import_history(arrays, id, &at, tree)
        if problem != NULL:
            return problem
    if at != arrays.sample_count:
        return "there are more stamps than samples of frames"
    tree.ever_looped = arrays.ever_looped
    tree.taken = arrays.taken
    memcpy(tree.refused, arrays.refused, sizeof(tree.refused))
    return tree_check(tree)
