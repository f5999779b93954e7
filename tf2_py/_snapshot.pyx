"""Owns copies of the tree that outlive its lock, for listings and error texts."""

from libc.stdint cimport int64_t, uint32_t
from libc.stdlib cimport free, malloc
from libc.string cimport memset

from tf2_py._cache cimport CACHE_UNBORN, Cache, cache_newest_parent
from tf2_py._lock cimport Lock, lock_read, unlock
from tf2_py._names cimport Names, names_copy, names_free, names_str
from tf2_py._tree cimport Tree
from tf2_py._types cimport NO_FRAME, FrameId

from tf2_py._listings import FrameFacts


cdef struct Facts:
    # A FrameFacts before its names are Python objects.
    FrameId frame
    FrameId parent
    uint32_t authority
    uint32_t count
    int64_t newest_ns
    int64_t oldest_ns


cdef inline void _note(Facts* facts, FrameId frame, const Cache* cache) noexcept nogil:
    facts.frame = frame
    facts.parent = cache_newest_parent(cache)
    facts.authority = cache.authority
    facts.count = cache.count
    facts.newest_ns = cache.newest_ns
    facts.oldest_ns = cache.oldest_ns


cdef list snapshot_names(const Tree* tree, Lock* lock, frames):
    cdef Names names
    cdef int failed
    lock_read(lock)
    failed = names_copy(&tree.names, &names)
    unlock(lock)
    if failed:
        raise MemoryError
    try:
        if frames is None:
            frames = range(names.count)
        # Frames that were read before the buffer was emptied may be unknown by now.
        return [names_str(&names, frame if frame < names.count else NO_FRAME) for frame in frames]
    finally:
        names_free(&names)


cdef list snapshot_frames(const Tree* tree, Lock* lock):
    cdef Names names, authorities
    cdef Facts* facts
    cdef bint complete
    cdef uint32_t id, i
    cdef uint32_t count = 0
    memset(&names, 0, sizeof(Names))
    memset(&authorities, 0, sizeof(Names))
    lock_read(lock)
    facts = <Facts*>malloc(tree.names.count * sizeof(Facts))
    complete = (facts != NULL and names_copy(&tree.names, &names) == 0
                and names_copy(&tree.authorities, &authorities) == 0)
    if complete:
        for id in range(tree.names.count):
            if tree.caches[id].kind != CACHE_UNBORN:
                _note(&facts[count], id, &tree.caches[id])
                count += 1
    unlock(lock)
    try:
        if not complete:
            raise MemoryError
        return [
            FrameFacts(
                name=names_str(&names, facts[i].frame),
                parent=None if facts[i].parent == NO_FRAME else names_str(&names, facts[i].parent),
                authority=names_str(&authorities, facts[i].authority),
                samples=facts[i].count,
                newest_ns=facts[i].newest_ns,
                oldest_ns=facts[i].oldest_ns,
            )
            for i in range(count)
        ]
    finally:
        names_free(&names)
        names_free(&authorities)
        free(facts)
