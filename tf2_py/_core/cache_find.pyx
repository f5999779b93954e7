"""Owns finding a time in the history of one frame, and interpolating there."""

from libc.stdint cimport INT64_MAX, int64_t, uint32_t

from tf2_py._core.cache cimport CACHE_STATIC, NEWEST_HINT, Cache, cache_parent_of, cache_slot
from tf2_py._core.geometry cimport quaternion_slerp
from tf2_py._core.types cimport (
    GAP_EMPTY,
    GAP_FUTURE,
    GAP_NONE,
    GAP_PAST,
    GAP_SINGLE,
    NO_FRAME,
    FrameId,
    Gap,
    Transform,
)

cdef enum:
    MAX_PARENTS_READ = 64   # samples that cache_parent_until looks at


cdef uint32_t cache_first_after(const Cache* cache, int64_t time_ns) noexcept nogil:
    # Most stamps arrive at a steady rate: guess the index from the ends, step away from the guess in doubling
    # strides, halve the rest. O(log n) whatever the stamps, a few probes where they are even.
    cdef uint32_t count = cache.count
    cdef uint32_t low, high, stride, middle
    if count == 0 or cache.newest_ns <= time_ns:
        return count
    if cache.oldest_ns > time_ns:
        return 0
    # From here on: stamp(low) <= time_ns < stamp(high).
    low = 0
    high = count - 1
    middle = cache_guess(cache, time_ns)
    stride = 1
    if cache.stamps[cache_slot(cache, middle)] <= time_ns:
        low = middle
        while high - low > stride and cache.stamps[cache_slot(cache, low + stride)] <= time_ns:
            low += stride
            stride *= 2
        if high - low > stride:
            high = low + stride
    else:
        high = middle
        while high - low > stride and cache.stamps[cache_slot(cache, high - stride)] > time_ns:
            high -= stride
            stride *= 2
        if high - low > stride:
            low = high - stride
    while high - low > 1:
        middle = low + (high - low) // 2
        if cache.stamps[cache_slot(cache, middle)] <= time_ns:
            low = middle
        else:
            high = middle
    return high


cdef Gap _find(const Cache* cache, int64_t time_ns, uint32_t* hint, uint32_t* older,
               uint32_t* newer) noexcept nogil:
    # As cache_neighbours, but slots. Of equal stamps the last arrival answers; where they are the oldest
    # of several, the first. `hint` is the index of the newer sample.
    cdef uint32_t count = cache.count
    cdef uint32_t index
    if count == 0:
        return GAP_EMPTY
    if cache.kind == CACHE_STATIC:
        older[0] = newer[0] = cache.head
        return GAP_NONE
    if time_ns == 0 or time_ns == cache.newest_ns:
        older[0] = newer[0] = cache_slot(cache, count - 1)
        return GAP_NONE
    if count == 1:
        return GAP_SINGLE
    if time_ns > cache.newest_ns:
        return GAP_FUTURE
    if time_ns == cache.oldest_ns:
        older[0] = newer[0] = cache.head
        return GAP_NONE
    if time_ns < cache.oldest_ns:
        return GAP_PAST
    index = min(hint[0], count - 1)
    if cache.stamps[cache_slot(cache, index)] <= time_ns:
        # A series asks for its times in order: the next interval is as likely as this one.
        index += 1
        if cache.stamps[cache_slot(cache, index)] <= time_ns:
            index = cache_first_after(cache, time_ns)
    elif cache.stamps[cache_slot(cache, index - 1)] > time_ns:
        index = max(index - 1, <uint32_t>1)
        if cache.stamps[cache_slot(cache, index - 1)] > time_ns:
            index = cache_first_after(cache, time_ns)
    # Stamps that another process is changing may be in any order.
    index = max(index, <uint32_t>1)
    hint[0] = index
    older[0] = cache_slot(cache, index - 1)
    newer[0] = cache_slot(cache, index)
    if cache.stamps[older[0]] == time_ns or cache.samples[older[0]].parent != cache.samples[newer[0]].parent:
        newer[0] = older[0]
    return GAP_NONE


cdef Gap cache_gap(const Cache* cache, int64_t time_ns) noexcept nogil:
    cdef uint32_t older, newer
    cdef uint32_t hint = NEWEST_HINT
    return _find(cache, time_ns, &hint, &older, &newer)


cdef Gap cache_neighbours(const Cache* cache, int64_t time_ns, uint32_t* hint, const Transform** older,
                          const Transform** newer, double* ratio) noexcept nogil:
    cdef uint32_t a, b
    cdef Gap gap = _find(cache, time_ns, hint, &a, &b)
    if gap != GAP_NONE:
        return gap
    older[0] = &cache.samples[a].transform
    newer[0] = &cache.samples[b].transform
    if a == b:
        ratio[0] = 0.0
    else:
        ratio[0] = (<double>(time_ns - cache.stamps[a])) / (<double>(cache.stamps[b] - cache.stamps[a]))
    return GAP_NONE


cdef Gap cache_transform_at(const Cache* cache, int64_t time_ns, uint32_t hint,
                            Transform* out) noexcept nogil:
    cdef const Transform* a
    cdef const Transform* b
    cdef double ratio
    cdef Gap gap = cache_neighbours(cache, time_ns, &hint, &a, &b, &ratio)
    if gap != GAP_NONE:
        return gap
    if a == b:
        out[0] = a[0]
        return GAP_NONE
    out.translation[0] = (1.0 - ratio) * a.translation[0] + ratio * b.translation[0]
    out.translation[1] = (1.0 - ratio) * a.translation[1] + ratio * b.translation[1]
    out.translation[2] = (1.0 - ratio) * a.translation[2] + ratio * b.translation[2]
    quaternion_slerp(a.rotation, b.rotation, ratio, out.rotation)
    return GAP_NONE


cdef FrameId cache_parent_at(const Cache* cache, int64_t time_ns) noexcept nogil:
    cdef uint32_t older, newer
    cdef uint32_t hint = NEWEST_HINT
    if _find(cache, time_ns, &hint, &older, &newer) != GAP_NONE:
        return NO_FRAME
    return cache.samples[older].parent


cdef int64_t cache_parent_until(const Cache* cache, int64_t time_ns) noexcept nogil:
    cdef uint32_t index = cache_first_after(cache, time_ns)
    cdef uint32_t last = min(cache.count, index + MAX_PARENTS_READ)
    if index == 0:
        return cache.oldest_ns if cache.count else INT64_MAX
    if index > 1 and time_ns == cache.oldest_ns:
        return time_ns + 1  # for the oldest stamp the first of its samples answers, right after it the last
    while index < last:
        if cache_parent_of(cache, index) != cache_parent_of(cache, index - 1):
            return cache.stamps[cache_slot(cache, index)]
        index += 1
    return INT64_MAX if index == cache.count else cache.stamps[cache_slot(cache, index)]
