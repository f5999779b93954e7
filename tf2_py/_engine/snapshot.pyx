"""Owns copies of the tree that outlive its lock, for listings and error texts."""

from cpython.mem cimport PyMem_Free, PyMem_Malloc, PyMem_Realloc
from libc.stddef cimport size_t
from libc.stdint cimport INT64_MAX, INT64_MIN, int64_t, uint32_t
from libc.string cimport memcpy

from tf2_py._core.cache cimport CACHE_DYNAMIC, CACHE_NONE, CACHE_STATIC, Cache
from tf2_py._core.lock cimport Lock
from tf2_py._core.names cimport Name, Names
from tf2_py._core.reading cimport Reading, reading_begin, reading_continue
from tf2_py._core.tree cimport Tree, tree_newest_parent
from tf2_py._core.types cimport NO_FRAME, FrameId

from tf2_py._objects.listings import FrameFacts

cdef enum:
    SLICE_BYTES = 65536     # of names, copied under the lock at once; a longer name is copied alone


cdef struct Facts:
    # A FrameFacts before its names are Python objects.
    FrameId frame
    FrameId parent
    uint32_t authority
    bint is_static
    uint32_t count
    int64_t newest_ns
    int64_t oldest_ns


cdef struct NameSlice:
    uint32_t ids[SLICE_FRAMES]
    uint32_t sizes[SLICE_FRAMES]    # bytes
    uint32_t count                  # of the ids; after copying, of the names in `text`
    char* text                      # the names, one after the other
    size_t capacity                 # bytes allocated for it
    size_t wanted                   # bytes, where not even the first name fits


cdef void _copy_slice(const Names* names, NameSlice* copies) noexcept nogil:
    # With the lock held.
    cdef size_t used = 0
    cdef uint32_t i, id
    cdef const Name* name
    for i in range(copies.count):
        copies.sizes[i] = 0
        if names.count == 0:
            continue
        # An id from before the buffer was emptied may belong to no frame now.
        id = copies.ids[i] if copies.ids[i] < names.count else NO_FRAME
        name = &names.names[id]
        if name.size > copies.capacity - used:
            copies.count = i
            copies.wanted = name.size
            return
        memcpy(copies.text + used, names.text + name.start, name.size)
        copies.sizes[i] = name.size
        used += name.size


cdef list _names_of(const Tree* tree, const Names* names, Lock* lock, list ids):
    cdef NameSlice copies
    cdef Reading reading
    cdef uint32_t wanted
    cdef list found = []
    cdef size_t start
    cdef uint32_t i
    cdef char* grown
    copies.capacity = SLICE_BYTES
    copies.wanted = 0
    copies.text = <char*>PyMem_Malloc(SLICE_BYTES)
    if copies.text == NULL:
        raise MemoryError
    try:
        while len(found) < len(ids):
            copies.count = 0
            for id in ids[len(found):len(found) + SLICE_FRAMES]:
                copies.ids[copies.count] = id
                copies.count += 1
            reading_begin(&reading, tree, lock)
            wanted = copies.count
            while reading_continue(&reading):
                copies.count = wanted
                _copy_slice(names, &copies)
            if copies.count == 0:
                grown = <char*>PyMem_Realloc(copies.text, copies.wanted)
                if grown == NULL:
                    raise MemoryError
                copies.text = grown
                copies.capacity = copies.wanted
            start = 0
            for i in range(copies.count):
                found.append(copies.text[start:start + copies.sizes[i]].decode("utf-8"))
                start += copies.sizes[i]
        return found
    finally:
        PyMem_Free(copies.text)


cdef list snapshot_names(const Tree* tree, Lock* lock, frames):
    cdef Reading reading
    cdef uint32_t count = 0
    if frames is None:
        reading_begin(&reading, tree, lock)
        while reading_continue(&reading):
            count = tree.names.count
        frames = range(count)
    return _names_of(tree, &tree.names, lock, list(frames))


cdef inline void _copy_facts(Facts* facts, const Tree* tree, FrameId frame) noexcept nogil:
    cdef const Cache* cache = &tree.caches[frame]
    facts.frame = frame
    facts.parent = tree_newest_parent(tree, frame)
    facts.authority = cache.authority
    facts.is_static = cache.kind == CACHE_STATIC
    facts.count = cache.count
    facts.newest_ns = cache.newest_ns
    facts.oldest_ns = cache.oldest_ns


cdef uint32_t _copy_frames(const Tree* tree, bint roots, FrameId* first, Facts* facts) noexcept nogil:
    # With the lock held: the facts of a slice that begins with `first`, which is moved behind it.
    cdef uint32_t end = min(first[0] + SLICE_FRAMES, tree.names.count)
    cdef uint32_t count = 0
    cdef uint32_t id
    for id in range(first[0], end):
        if roots or tree.caches[id].kind != CACHE_NONE:
            _copy_facts(&facts[count], tree, id)
            count += 1
    first[0] = end
    return count


cdef list _as_objects(const Tree* tree, Lock* lock, const Facts* facts, uint32_t count):
    cdef uint32_t i
    names = _names_of(tree, &tree.names, lock, [facts[i].frame for i in range(count)])
    parents = _names_of(tree, &tree.names, lock, [facts[i].parent for i in range(count)])
    authorities = _names_of(tree, &tree.authorities, lock, [facts[i].authority for i in range(count)])
    return [
        FrameFacts(
            name=names[i],
            parent=None if facts[i].parent == NO_FRAME else parents[i],
            authority=authorities[i],
            is_static=bool(facts[i].is_static),
            samples=facts[i].count,
            newest_ns=facts[i].newest_ns,
            oldest_ns=facts[i].oldest_ns,
        )
        for i in range(count)
    ]


cdef list snapshot_frames(const Tree* tree, Lock* lock, bint roots):
    cdef list frames = []
    cdef FrameId first = NO_FRAME + 1
    cdef FrameId last = first
    cdef bint is_last = False
    cdef uint32_t count = 0
    cdef Reading reading
    cdef Facts* facts = <Facts*>PyMem_Malloc(SLICE_FRAMES * sizeof(Facts))
    if facts == NULL:
        raise MemoryError
    try:
        while not is_last:
            reading_begin(&reading, tree, lock)
            while reading_continue(&reading):
                last = first
                count = _copy_frames(tree, roots, &last, facts)
                is_last = last >= tree.names.count
            first = last
            frames += _as_objects(tree, lock, facts, count)
        return frames
    finally:
        PyMem_Free(facts)


cdef bint snapshot_span(const Tree* tree, Lock* lock, int64_t* oldest_ns, int64_t* newest_ns) noexcept nogil:
    cdef FrameId id, end
    cdef FrameId first = NO_FRAME + 1
    cdef bint is_last = False
    cdef const Cache* cache
    cdef Reading reading
    cdef int64_t oldest, newest
    oldest_ns[0] = INT64_MAX
    newest_ns[0] = INT64_MIN
    while not is_last:
        reading_begin(&reading, tree, lock)
        while reading_continue(&reading):
            oldest, newest = INT64_MAX, INT64_MIN
            end = min(first + SLICE_FRAMES, tree.names.count)
            is_last = end == tree.names.count
            for id in range(first, end):
                cache = &tree.caches[id]
                if cache.kind == CACHE_DYNAMIC and cache.count:
                    oldest = min(oldest, cache.oldest_ns)
                    newest = max(newest, cache.newest_ns)
        oldest_ns[0] = min(oldest_ns[0], oldest)
        newest_ns[0] = max(newest_ns[0], newest)
        first = end
    return oldest_ns[0] <= newest_ns[0]
