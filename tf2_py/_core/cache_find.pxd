"""What the history of one frame answers for a time."""

from libc.stdint cimport int64_t, uint32_t

from tf2_py._core.cache cimport NEWEST_HINT, PREFETCH_FROM, Cache, cache_slot
from tf2_py._core.types cimport FrameId, Gap, Transform

cdef extern from *:
    void __builtin_prefetch(const void* address) nogil


cdef inline uint32_t cache_guess(const Cache* cache, int64_t time_ns) noexcept nogil:
    # For the modules named cache_* alone. The index of the sample before time_ns, if the stamps were even;
    # below `count - 1`. For two samples or more and oldest_ns <= time_ns < newest_ns.
    cdef uint32_t last = cache.count - 1
    cdef double part = <double>(time_ns - cache.oldest_ns) / <double>(cache.newest_ns - cache.oldest_ns)
    return min(<uint32_t>(part * <double>last), last - 1)


cdef inline uint32_t cache_prefetch(const Cache* cache, int64_t time_ns) noexcept nogil:
    # The hint to find a time with. Asks for the memory that the search will need: in long histories, the
    # delays of several frames or times then overlap.
    cdef uint32_t guess, slot
    if cache.count < PREFETCH_FROM or time_ns >= cache.newest_ns or time_ns < cache.oldest_ns:
        return NEWEST_HINT
    guess = cache_guess(cache, time_ns)
    slot = cache_slot(cache, guess)
    __builtin_prefetch(&cache.stamps[slot])
    __builtin_prefetch(&cache.samples[slot])
    if slot + 1 < cache.capacity:
        __builtin_prefetch(&cache.samples[slot + 1])
    return guess + 1


# Time 0 asks for the newest sample. Why the history does not answer, GAP_NONE: it does.
cdef Gap cache_gap(const Cache* cache, int64_t time_ns) noexcept nogil
# The samples on both sides of a time, and how far between them it lies, 0 .. 1; equal, and 0, where one of
# them answers alone. `hint`: where to look first, and afterwards where the answer was.
cdef Gap cache_neighbours(const Cache* cache, int64_t time_ns, uint32_t* hint, const Transform** older,
                          const Transform** newer, double* ratio) noexcept nogil
# Interpolated between the neighbours: linear translation, slerp of the rotation.
cdef Gap cache_transform_at(const Cache* cache, int64_t time_ns, uint32_t hint, Transform* out) noexcept nogil
# NO_FRAME: the history does not answer.
cdef FrameId cache_parent_at(const Cache* cache, int64_t time_ns) noexcept nogil
# Until when, from time_ns on, the parent certainly stays the same; INT64_MAX: up to the newest sample. It may
# be an earlier time than the next change.
cdef int64_t cache_parent_until(const Cache* cache, int64_t time_ns) noexcept nogil
# The index of the first sample with a later stamp; `count`: there is none.
cdef uint32_t cache_first_after(const Cache* cache, int64_t time_ns) noexcept nogil
