"""One frame's history: a ring of samples sorted by stamp."""

from libc.stdint cimport int64_t, uint32_t

from tf2_py._types cimport FrameId, Gap, Sample, Transform

cdef enum CacheKind:
    CACHE_UNBORN            # the frame was never a child
    CACHE_DYNAMIC
    CACHE_STATIC            # one sample, for every time


cdef struct Cache:
    # Logical index 0 is the oldest sample; it lies at `head`, the ring goes on at 0 after `capacity - 1`.
    # Two parallel arrays, so that a search touches few cache lines. Equal stamps lie in order of arrival.
    int64_t* stamps             # ns
    Sample* samples             # 64-byte lines
    uint32_t capacity           # samples allocated
    uint32_t head
    uint32_t count
    uint32_t parent_changes     # how many neighbours have different parents; 0: one parent at all times
    int64_t newest_ns           # stamp of the newest sample; 0 where there is none, and in a static cache
    int64_t oldest_ns           # likewise, of the oldest sample
    uint32_t authority          # id of who sent last, NAME_UNKNOWN: nobody
    uint32_t sparse_inserts     # inserts since the ring was last a quarter full
    CacheKind kind


cdef enum:
    NEWEST_HINT = 0x7FFFFFFF    # most lookups ask for a moment ago
    AIM_FROM = 16               # samples; in a shorter history any search is as quick


cdef enum CacheInsert:
    CACHE_INSERTED
    CACHE_DUPLICATE
    CACHE_TOO_OLD
    CACHE_NO_MEMORY         # nothing has changed


cdef inline uint32_t cache_slot(const Cache* cache, uint32_t index) noexcept nogil:
    # Where the sample of logical `index` lies. The sum cannot wrap: capacities stay below 2^31.
    cdef uint32_t slot = cache.head + index
    return slot if slot < cache.capacity else slot - cache.capacity


cdef extern from *:
    void __builtin_prefetch(const void* address) nogil


cdef inline uint32_t cache_guess(const Cache* cache, int64_t time_ns) noexcept nogil:
    # Where time_ns would lie if the stamps were even: a logical index below the newest one, for a dynamic
    # cache of two samples or more and oldest stamp <= time_ns < newest_ns.
    cdef uint32_t last = cache.count - 1
    cdef double part = <double>(time_ns - cache.oldest_ns) / <double>(cache.newest_ns - cache.oldest_ns)
    return min(<uint32_t>(part * <double>last), last - 1)


cdef inline uint32_t cache_aim(const Cache* cache, int64_t time_ns) noexcept nogil:
    # The hint to find a time with. Also asks for the memory that will be wanted there: where many samples are
    # kept, the waits of several frames or times for it then pass at the same time.
    cdef uint32_t guess, slot
    if cache.count < AIM_FROM or time_ns >= cache.newest_ns or time_ns < cache.oldest_ns:
        return NEWEST_HINT
    guess = cache_guess(cache, time_ns)
    slot = cache_slot(cache, guess)
    __builtin_prefetch(&cache.stamps[slot])
    __builtin_prefetch(&cache.samples[slot])
    if slot + 1 < cache.capacity:
        __builtin_prefetch(&cache.samples[slot + 1])
    return guess + 1


# Zero a Cache before its first use; cache_free leaves it zeroed again but for its authority.
cdef void cache_free(Cache* cache) noexcept nogil
cdef void cache_clear(Cache* cache) noexcept nogil      # drops samples, keeps memory; not for static ones
cdef CacheInsert cache_insert(Cache* cache, int64_t stamp_ns, const Sample* sample,
                              int64_t cache_time_ns) noexcept nogil
cdef CacheInsert cache_set_static(Cache* cache, int64_t stamp_ns, const Sample* sample) noexcept nogil
# The slots of the samples on both sides of a time; equal where one of them answers alone. `hint` is where to
# look first, and afterwards where the answer was: the logical index of the newer sample.
cdef Gap cache_find(const Cache* cache, int64_t time_ns, uint32_t* hint, uint32_t* older,
                    uint32_t* newer) noexcept nogil
cdef Gap cache_transform_at(const Cache* cache, int64_t time_ns, uint32_t hint, Transform* out) noexcept nogil
cdef FrameId cache_parent_at(const Cache* cache, int64_t time_ns) noexcept nogil
cdef FrameId cache_newest_parent(const Cache* cache) noexcept nogil
cdef size_t cache_bytes(const Cache* cache) noexcept nogil
cdef const char* cache_check(const Cache* cache) noexcept nogil     # NULL, or which invariant does not hold
