"""One frame's history: a ring of samples sorted by stamp."""

from libc.stdint cimport int64_t, uint32_t

from tf2_py._core.types cimport FrameId, Gap, Sample, Transform

cdef enum CacheKind:
    CACHE_UNBORN            # the frame was never a child
    CACHE_DYNAMIC
    CACHE_STATIC            # one sample, for every time


cdef struct Ring:
    # The head of the memory that holds a frame's samples.
    uint32_t owners             # the cache, and whoever has pinned it; read and written atomically
    size_t bytes                # allocated, this head included
    uint32_t kept_from          # slot of the oldest sample that somebody has pinned; meant where owners > 1


cdef struct Cache:
    # The ring, for this module alone. Index 0 is the oldest sample; it lies in slot `head`, and slot 0 follows
    # slot `capacity - 1`. Two parallel arrays, so that a search touches few cache lines. Equal stamps lie in
    # order of arrival.
    Ring* ring                  # the memory of both arrays; NULL: capacity 0
    int64_t* stamps             # ns, by slot
    Sample* samples             # by slot; each is one 64-byte line
    uint32_t capacity           # slots allocated
    uint32_t head               # slot of the oldest sample
    # What others may read.
    uint32_t count              # samples
    uint32_t parent_changes     # how many neighbours have different parents; 0: one parent at all times
    int64_t newest_ns           # stamp of the newest sample; 0 where there is none, and in a static cache
    int64_t oldest_ns           # likewise, of the oldest sample
    uint32_t authority          # id of who sent last, NAME_UNKNOWN: nobody
    uint32_t sparse_inserts     # inserts since the ring was last a quarter full
    CacheKind kind
    bint is_parent              # a sample of some frame has named this one as its parent


cdef enum:
    NEWEST_HINT = 0x7FFFFFFF    # most lookups ask for a moment ago
    AIM_FROM = 16               # samples; in a shorter history any search is as quick
    LINE = 64                   # bytes of a cache line, and of a Sample


cdef enum CacheInsert:
    CACHE_INSERTED
    CACHE_DUPLICATE
    CACHE_TOO_OLD
    CACHE_NO_MEMORY
    CACHE_FULL              # it would have to grow by more than it may


cdef struct Times:
    # From `first` to `last`, both included; none where first > last.
    int64_t first
    int64_t last


cdef struct CacheChange:
    # What an insert has changed, maybe with some times beside these.
    Times covered           # had no sample around them before, and have now
    Times lost              # the other way round
    Times relinked          # another parent may answer for them
    uint32_t moved          # samples that had to make room


cdef inline uint32_t cache_slot(const Cache* cache, uint32_t index) noexcept nogil:
    # The slot of the sample with this index; for this module alone. The sum cannot wrap: capacities stay below 2^31.
    cdef uint32_t slot = cache.head + index
    return slot if slot < cache.capacity else slot - cache.capacity


cdef inline size_t ring_lines(size_t size) noexcept nogil:
    # In bytes, as `size`.
    return (size + LINE - 1) // LINE * LINE


cdef inline size_t ring_bytes(uint32_t capacity) noexcept nogil:
    # What the memory of a ring of so many samples takes.
    if capacity == 0:
        return 0
    return ring_lines(sizeof(Ring)) + ring_lines(capacity * sizeof(int64_t)) + capacity * sizeof(Sample)


cdef inline size_t cache_bytes(const Cache* cache) noexcept nogil:
    # Allocated for its samples.
    return 0 if cache.ring == NULL else cache.ring.bytes


cdef inline FrameId cache_parent_of(const Cache* cache, uint32_t index) noexcept nogil:
    # The parent that one sample names: the oldest has the index 0, the newest `count - 1`.
    return cache.samples[cache_slot(cache, index)].parent


cdef inline const Transform* cache_newest_transform(const Cache* cache) noexcept nogil:
    # Of a cache with samples; of a static one, its only transform.
    return &cache.samples[cache_slot(cache, cache.count - 1)].transform


cdef extern from *:
    void __builtin_prefetch(const void* address) nogil


cdef inline uint32_t cache_guess(const Cache* cache, int64_t time_ns) noexcept nogil:
    # Where time_ns would lie if the stamps were even; for this module alone. An index below the newest one, for a dynamic
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
# A copy that can be read without the lock, at any length, until it is unpinned: what it refers to is not
# written to meanwhile. Pin with the lock held, for reading at least.
cdef void cache_pin(const Cache* cache, Cache* copy) noexcept nogil
cdef void cache_unpin(Cache* copy) noexcept nogil
# `room`: bytes that it may grow by. `change` is told in any case: pruning comes before all that may fail.
cdef CacheInsert cache_insert(Cache* cache, int64_t stamp_ns, const Sample* sample, int64_t cache_time_ns,
                              size_t room, CacheChange* change) noexcept nogil
cdef CacheInsert cache_set_static(Cache* cache, int64_t stamp_ns, const Sample* sample, size_t room,
                                  CacheChange* change) noexcept nogil
cdef Gap cache_gap(const Cache* cache, int64_t time_ns) noexcept nogil
# The samples on both sides of a time, and how far between them it lies, 0 .. 1; equal, and 0, where one of
# them answers alone. `hint` is where to look first, and afterwards where the answer was.
cdef Gap cache_neighbours(const Cache* cache, int64_t time_ns, uint32_t* hint, const Transform** older,
                          const Transform** newer, double* ratio) noexcept nogil
# Between the neighbours: linear translation, slerp.
cdef Gap cache_transform_at(const Cache* cache, int64_t time_ns, uint32_t hint, Transform* out) noexcept nogil
cdef FrameId cache_parent_at(const Cache* cache, int64_t time_ns) noexcept nogil
cdef FrameId cache_newest_parent(const Cache* cache) noexcept nogil
# Until when, from time_ns on, the parent stays the same; INT64_MAX: up to the newest sample. It may give up
# early.
cdef int64_t cache_parent_until(const Cache* cache, int64_t time_ns) noexcept nogil
cdef const char* cache_check(const Cache* cache) noexcept nogil     # NULL, or which invariant does not hold
