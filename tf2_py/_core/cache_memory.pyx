"""Owns the memory of one frame's samples."""

from libc.stdint cimport int64_t, uint32_t
from libc.stdlib cimport free
from libc.string cimport memcpy

from tf2_py._core.arena cimport Arena, arena_give, arena_take
from tf2_py._core.cache cimport CACHE_NONE, Cache, Ring, cache_bytes
from tf2_py._core.types cimport LINE_BYTES, Sample

cdef extern from "<stdlib.h>" nogil:
    int posix_memalign(void** out, size_t alignment, size_t size)

cdef extern from *:
    """
    #define TF2_ADD(where, what) __atomic_add_fetch(where, what, __ATOMIC_ACQ_REL)
    #define TF2_LOAD(where) __atomic_load_n(where, __ATOMIC_ACQUIRE)
    #define TF2_STORE(where, what) __atomic_store_n(where, what, __ATOMIC_RELAXED)
    """
    uint32_t _add "TF2_ADD"(uint32_t* where, uint32_t what) nogil
    uint32_t _load "TF2_LOAD"(const uint32_t* where) nogil
    void _store "TF2_STORE"(uint32_t* where, uint32_t what) nogil


cdef enum:
    SHRINK_ABOVE = 64               # samples; smaller rings are not worth shrinking


cdef inline size_t _whole_lines(size_t size) noexcept nogil:
    # In bytes, as `size`.
    return (size + LINE_BYTES - 1) // LINE_BYTES * LINE_BYTES


cdef inline size_t _ring_bytes(uint32_t capacity) noexcept nogil:
    return (_whole_lines(sizeof(Ring)) + _whole_lines(capacity * sizeof(int64_t))
            + capacity * sizeof(Sample))


cdef inline void _release(const Cache* cache) noexcept nogil:
    # Nothing that decides where memory goes is read from memory that others map.
    if cache.ring == NULL or _add(&cache.ring.owners, <uint32_t>-1) != 0:
        return
    if cache.arena != NULL:
        arena_give(cache.arena, cache.ring, _ring_bytes(cache.capacity))
    else:
        free(cache.ring)


cdef bint cache_is_pinned(const Cache* cache) noexcept nogil:
    return cache.ring != NULL and _load(&cache.ring.owners) > 1


cdef void cache_pin(const Cache* cache, Cache* copy) noexcept nogil:
    copy[0] = cache[0]
    # Of several that pin between the same two writes each finds the same head.
    if cache.ring != NULL and _add(&cache.ring.owners, 1) == 2:
        _store(&cache.ring.pinned_from, cache.head)


cdef void cache_unpin(Cache* copy) noexcept nogil:
    _release(copy)


cdef uint32_t _pinned_before_head(const Cache* cache) noexcept nogil:
    # How many slots before the head hold samples that have been pruned here and are still read by a copy.
    cdef uint32_t pinned_from
    if not cache_is_pinned(cache):
        return 0
    pinned_from = _load(&cache.ring.pinned_from)
    if cache.head >= pinned_from:
        return cache.head - pinned_from
    return cache.head + cache.capacity - pinned_from


cdef inline Ring* _new_ring(Arena* arena, size_t bytes) noexcept nogil:
    # NULL: no memory.
    cdef Ring* ring = NULL
    if arena != NULL:
        ring = <Ring*>arena_take(arena, bytes)
    elif posix_memalign(<void**>&ring, LINE_BYTES, bytes) != 0:
        return NULL
    if ring != NULL:
        ring.owners = 1
        ring.bytes = bytes
    return ring


cdef inline void _lay_out(Cache* cache, Ring* ring, uint32_t capacity) noexcept nogil:
    cache.stamps = <int64_t*>(<char*>ring + _whole_lines(sizeof(Ring)))
    cache.samples = <Sample*>(<char*>cache.stamps + _whole_lines(capacity * sizeof(int64_t)))
    cache.capacity = capacity


cdef size_t cache_ring_bytes(uint32_t capacity) noexcept nogil:
    return _ring_bytes(capacity)


cdef void cache_read_from(Cache* cache, char* ring, uint32_t capacity) noexcept nogil:
    cache.ring = NULL
    _lay_out(cache, <Ring*>ring, capacity)


cdef int _resize(Cache* cache, uint32_t capacity) noexcept nogil:
    # -1: no memory, and nothing has changed.
    cdef Cache old = cache[0]
    cdef uint32_t first
    cdef Ring* ring = _new_ring(cache.arena, _ring_bytes(capacity))
    if ring == NULL:
        return -1
    _lay_out(cache, ring, capacity)
    if old.count:
        first = min(old.count, old.capacity - old.head)
        memcpy(cache.stamps, old.stamps + old.head, first * sizeof(int64_t))
        memcpy(cache.stamps + first, old.stamps, (old.count - first) * sizeof(int64_t))
        memcpy(cache.samples, old.samples + old.head, first * sizeof(Sample))
        memcpy(cache.samples + first, old.samples, (old.count - first) * sizeof(Sample))
    _release(&old)
    cache.ring = ring
    cache.head = 0
    cache.disturbed += 1
    return 0


cdef int cache_change_arena(Cache* cache, Arena* arena) noexcept nogil:
    cdef Cache moved = cache[0]
    moved.arena = arena
    moved.ring = NULL
    if moved.capacity and _resize(&moved, moved.capacity) != 0:
        return -1
    _release(cache)
    cache[0] = moved
    return 0


cdef CacheInsert cache_move(Cache* cache, uint32_t capacity, size_t growth_limit) noexcept nogil:
    if _ring_bytes(capacity) > cache_bytes(cache) + growth_limit:
        return CACHE_FULL
    if _resize(cache, capacity) == 0:
        return CACHE_INSERTED
    # Memory that is shared has an end of its own: there it is as if the limit were reached.
    return CACHE_NO_MEMORY if cache.arena == NULL else CACHE_FULL


cdef CacheInsert cache_reserve_one(Cache* cache, bint at_the_end, size_t growth_limit) noexcept nogil:
    cdef uint32_t capacity = cache.capacity
    cdef CacheInsert outcome
    if at_the_end and cache.count + _pinned_before_head(cache) < capacity:
        return CACHE_INSERTED
    if not at_the_end and cache.count < capacity and not cache_is_pinned(cache):
        return CACHE_INSERTED
    if capacity == LAST_CAPACITY and cache.count == capacity:
        return CACHE_FULL
    if cache.count >= capacity - capacity // 4:
        # By half: at worst 1.5 x 72 bytes per sample. The halves cannot overflow 32 bits, see LAST_CAPACITY.
        capacity = capacity + capacity // 2 if capacity else FIRST_CAPACITY
    outcome = cache_move(cache, min(capacity, <uint32_t>LAST_CAPACITY), growth_limit)
    if outcome == CACHE_FULL and cache.count < cache.capacity:
        outcome = cache_move(cache, cache.capacity, growth_limit)
    return outcome


cdef void cache_shrink(Cache* cache) noexcept nogil:
    # A burst leaves a large ring behind. It is halved once as many inserts have passed as it has slots, so
    # that the copy costs O(1) per insert. Without memory for the smaller copy the large ring stays.
    if cache.capacity <= SHRINK_ABOVE or cache.count >= cache.capacity // 4:
        cache.mostly_empty_for = 0
        return
    cache.mostly_empty_for += 1
    if cache.mostly_empty_for > cache.capacity:
        cache.mostly_empty_for = 0
        _resize(cache, cache.capacity // 2)


cdef inline void _drop_memory(Cache* cache) noexcept nogil:
    _release(cache)
    cache.ring = NULL
    cache.stamps = NULL
    cache.samples = NULL
    cache.capacity = 0


cdef inline void _drop_samples(Cache* cache) noexcept nogil:
    cache.head = cache.count = cache.parent_changes = 0
    cache.newest_ns = cache.oldest_ns = 0
    cache.disturbed += 1


cdef void cache_free(Cache* cache) noexcept nogil:
    _drop_memory(cache)
    _drop_samples(cache)
    cache.mostly_empty_for = 0
    cache.kind = CACHE_NONE


cdef void cache_clear(Cache* cache) noexcept nogil:
    if cache_is_pinned(cache):
        _drop_memory(cache)
    _drop_samples(cache)
