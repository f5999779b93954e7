"""
The memory of a frame's samples: growing, shrinking, pinning.

A lookup may read samples without the lock. It pins the ring first: then no sample that the copy refers to is
written over. The next write that would do so moves the samples to other memory, and the last owner of the old
memory frees it.
"""

from libc.stdint cimport uint32_t

from tf2_py._core.arena cimport Arena
from tf2_py._core.cache cimport Cache

cdef enum CacheInsert:
    CACHE_INSERTED
    CACHE_DUPLICATE
    CACHE_TOO_OLD
    CACHE_NO_MEMORY
    CACHE_FULL              # the memory would have to grow by more than the limit allows

cdef enum:
    FIRST_CAPACITY = 8              # samples, of a dynamic cache
    LAST_CAPACITY = 0x7FFFFFFF      # likewise

# Zero a Cache before its first use, but for `arena`; cache_free leaves it zeroed again but for arena,
# authority, is_parent, and what tells that it was disturbed.
cdef void cache_free(Cache* cache) noexcept nogil
# Drops all samples and keeps the memory. Not for static caches.
cdef void cache_clear(Cache* cache) noexcept nogil
# Pin with the lock held, for reading at least. `copy` may be read without the lock until it is unpinned.
cdef void cache_pin(const Cache* cache, Cache* copy) noexcept nogil
cdef void cache_unpin(Cache* copy) noexcept nogil
cdef bint cache_is_pinned(const Cache* cache) noexcept nogil
# Both return CACHE_INSERTED, CACHE_FULL or CACHE_NO_MEMORY; but for the first, nothing has changed.
# `growth_limit`: by how many bytes the memory may grow.
# Moves the samples to fresh memory for `capacity` of them, `count` at least.
cdef CacheInsert cache_move(Cache* cache, uint32_t capacity, size_t growth_limit) noexcept nogil
# Makes sure of a free slot behind the newest sample, or, not `at_the_end`, of one that may lie anywhere.
cdef CacheInsert cache_reserve_one(Cache* cache, bint at_the_end, size_t growth_limit) noexcept nogil
# Halves a ring that has been mostly empty for long. Call it after each insert.
cdef void cache_shrink(Cache* cache) noexcept nogil
# The bytes of a ring, and reading samples out of one that belongs to another process. Such a cache owns no
# memory: a pinned copy of it is a copy of the struct alone, and cache_move gives it samples of its own.
cdef size_t cache_ring_bytes(uint32_t capacity) noexcept nogil
cdef void cache_read_from(Cache* cache, char* ring, uint32_t capacity) noexcept nogil
# Moves the samples to memory of another arena; NULL: malloc's. 0; -1: there is none, and nothing has changed.
cdef int cache_change_arena(Cache* cache, Arena* arena) noexcept nogil
