"""Owns the memory of one frame's samples."""

from libc.stdint cimport int64_t, uint32_t
from libc.stdlib cimport free
from libc.string cimport memcpy

from tf2_py._core.cache cimport CACHE_NONE, LINE_BYTES, Cache, Ring, cache_bytes
from tf2_py._core.types cimport Sample

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


cdef inline void _release(Ring* ring) noexcept nogil:
    if ring != NULL and _add(&ring.owners, <uint32_t>-1) == 0:
        free(ring)


cdef bint cache_is_pinned(const Cache* cache) noexcept nogil:
    return cache.ring != NULL and _load(&cache.ring.owners) > 1


cdef void cache_pin(const Cache* cache, Cache* copy) noexcept nogil:
    copy[0] = cache[0]
    # Of several that pin between the same two writes each finds the same head.
    if cache.ring != NULL and _add(&cache.ring.owners, 1) == 2:
        _store(&cache.ring.pinned_from, cache.head)


cdef void cache_unpin(Cache* copy) noexcept nogil:
    _release(copy.ring)


cdef uint32_t _pinned_before_head(const Cache* cache) noexcept nogil:
    # How many slots before the head hold samples that have been pruned here and are still read by a copy.
    cdef uint32_t pinned_from
    if not cache_is_pinned(cache):
        return 0
    pinned_from = _load(&cache.ring.pinned_from)
    if cache.head >= pinned_from:
        return cache.head - pinned_from
    return cache.head + cache.capacity - pinned_from


cdef int _resize(Cache* cache, uint32_t capacity) noexcept nogil:
    # -1: no memory, and nothing has changed.
    cdef Ring* ring
    cdef int64_t* stamps
    cdef Sample* samples
    cdef uint32_t first
    if posix_memalign(<void**>&ring, LINE_BYTES, _ring_bytes(capacity)) != 0:
        return -1
    ring.owners = 1
    ring.bytes = _ring_bytes(capacity)
    stamps = <int64_t*>(<char*>ring + _whole_lines(sizeof(Ring)))
    samples = <Sample*>(<char*>stamps + _whole_lines(capacity * sizeof(int64_t)))
    if cache.count:
        first = min(cache.count, cache.capacity - cache.head)
        memcpy(stamps, cache.stamps + cache.head, first * sizeof(int64_t))
        memcpy(stamps + first, cache.stamps, (cache.count - first) * sizeof(int64_t))
        memcpy(samples, cache.samples + cache.head, first * sizeof(Sample))
        memcpy(samples + first, cache.samples, (cache.count - first) * sizeof(Sample))
    _release(cache.ring)
    cache.ring = ring
    cache.stamps = stamps
    cache.samples = samples
    cache.capacity = capacity
    cache.head = 0
    return 0


cdef CacheInsert cache_move(Cache* cache, uint32_t capacity, size_t growth_limit) noexcept nogil:
    if _ring_bytes(capacity) > cache_bytes(cache) + growth_limit:
        return CACHE_FULL
    return CACHE_INSERTED if _resize(cache, capacity) == 0 else CACHE_NO_MEMORY


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
    _release(cache.ring)
    cache.ring = NULL
    cache.stamps = NULL
    cache.samples = NULL
    cache.capacity = 0


cdef inline void _drop_samples(Cache* cache) noexcept nogil:
    cache.head = cache.count = cache.parent_changes = 0
    cache.newest_ns = cache.oldest_ns = 0


cdef void cache_free(Cache* cache) noexcept nogil:
    _drop_memory(cache)
    _drop_samples(cache)
    cache.mostly_empty_for = 0
    cache.kind = CACHE_NONE


cdef void cache_clear(Cache* cache) noexcept nogil:
    if cache_is_pinned(cache):
        _drop_memory(cache)
    _drop_samples(cache)
