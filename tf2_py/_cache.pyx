"""Owns the history of one frame: insert, find, interpolate, prune."""

from libc.math cimport fabs
from libc.stdint cimport int64_t, uint32_t
from libc.stdlib cimport free
from libc.string cimport memcpy, memset

from tf2_py._geometry cimport quaternion_slerp
from tf2_py._types cimport (
    GAP_EMPTY,
    GAP_FUTURE,
    GAP_NONE,
    GAP_PAST,
    GAP_SINGLE,
    NO_FRAME,
    FrameId,
    Gap,
    Sample,
    Transform,
)

cdef extern from "<stdlib.h>" nogil:
    int posix_memalign(void** out, size_t alignment, size_t size)


cdef enum:
    FIRST_CAPACITY = 8
    LAST_CAPACITY = 0x7FFFFFFF
    SHRINK_ABOVE = 64       # smaller rings are not worth shrinking
    LINE = 64               # bytes of a cache line, and of a Sample


cdef int _resize(Cache* cache, uint32_t capacity) noexcept nogil:
    # Move the samples into fresh arrays; -1 and nothing changed where there is no memory.
    cdef int64_t* stamps = NULL
    cdef Sample* samples = NULL
    cdef uint32_t first
    if posix_memalign(<void**>&stamps, LINE, capacity * sizeof(int64_t)) != 0:
        return -1
    if posix_memalign(<void**>&samples, LINE, capacity * sizeof(Sample)) != 0:
        free(stamps)
        return -1
    if cache.count:
        first = min(cache.count, cache.capacity - cache.head)
        memcpy(stamps, cache.stamps + cache.head, first * sizeof(int64_t))
        memcpy(stamps + first, cache.stamps, (cache.count - first) * sizeof(int64_t))
        memcpy(samples, cache.samples + cache.head, first * sizeof(Sample))
        memcpy(samples + first, cache.samples, (cache.count - first) * sizeof(Sample))
    free(cache.stamps)
    free(cache.samples)
    cache.stamps = stamps
    cache.samples = samples
    cache.capacity = capacity
    cache.head = 0
    return 0


cdef int _reserve_one(Cache* cache) noexcept nogil:
    cdef uint32_t capacity
    if cache.count < cache.capacity:
        return 0
    if cache.capacity == LAST_CAPACITY:
        return -1
    # By half: at worst 1.5 x 72 bytes per sample. The halves cannot overflow 32 bits, see LAST_CAPACITY.
    capacity = cache.capacity + cache.capacity // 2 if cache.capacity else FIRST_CAPACITY
    return _resize(cache, min(capacity, <uint32_t>LAST_CAPACITY))


cdef void cache_free(Cache* cache) noexcept nogil:
    free(cache.stamps)
    free(cache.samples)
    cache.stamps = NULL
    cache.samples = NULL
    cache.capacity = cache.head = cache.count = cache.parent_changes = cache.sparse_inserts = 0
    cache.newest_ns = cache.oldest_ns = 0
    cache.kind = CACHE_UNBORN


cdef int _become(Cache* cache, CacheKind kind, uint32_t capacity) noexcept nogil:
    # A frame that turns from dynamic to static or back loses its history, but only once there is memory.
    cdef Cache fresh
    memset(&fresh, 0, sizeof(Cache))
    fresh.kind = kind
    fresh.authority = cache.authority
    if _resize(&fresh, capacity) != 0:
        return -1
    cache_free(cache)
    cache[0] = fresh
    return 0


cdef void cache_clear(Cache* cache) noexcept nogil:
    cache.head = cache.count = cache.parent_changes = 0
    cache.newest_ns = cache.oldest_ns = 0


cdef void _prune(Cache* cache, int64_t cache_time_ns) noexcept nogil:
    # The newest sample is never older than itself, so a sample always stays.
    cdef int64_t horizon_ns = cache.newest_ns - cache_time_ns
    cdef uint32_t next_slot
    while cache.count and cache.oldest_ns < horizon_ns:
        next_slot = cache_slot(cache, 1)
        if cache.samples[next_slot].parent != cache.samples[cache.head].parent:
            cache.parent_changes -= 1
        cache.head = next_slot
        cache.count -= 1
        cache.oldest_ns = cache.stamps[cache.head]


cdef void _shrink_if_long_sparse(Cache* cache) noexcept nogil:
    # A burst leaves a large ring behind; it goes once as many inserts have passed as it has places, so
    # that the copy costs O(1) per insert. Without memory for the smaller copy the large ring stays.
    if cache.capacity <= SHRINK_ABOVE or cache.count >= cache.capacity // 4:
        cache.sparse_inserts = 0
        return
    cache.sparse_inserts += 1
    if cache.sparse_inserts > cache.capacity:
        cache.sparse_inserts = 0
        _resize(cache, cache.capacity // 2)


cdef uint32_t _first_after(const Cache* cache, int64_t time_ns) noexcept nogil:
    # The logical index of the first sample with stamp > time_ns; count where there is none. Stamps come at
    # steady rates: guess the place from the ends, step away from the guess in doubling strides, halve the
    # rest. O(log n) whatever the stamps, a few probes where they are even.
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


cdef inline bint _same(const Sample* a, const Sample* b) noexcept nogil:
    return (a.parent == b.parent
            and a.transform.translation[0] == b.transform.translation[0]
            and a.transform.translation[1] == b.transform.translation[1]
            and a.transform.translation[2] == b.transform.translation[2]
            and a.transform.rotation[0] == b.transform.rotation[0]
            and a.transform.rotation[1] == b.transform.rotation[1]
            and a.transform.rotation[2] == b.transform.rotation[2]
            and a.transform.rotation[3] == b.transform.rotation[3])


cdef void _open_gap(Cache* cache, uint32_t index) noexcept nogil:
    # Make room at logical `index` by moving the shorter side one place outwards.
    cdef uint32_t i, source, target
    if index < cache.count - index:
        cache.head = (cache.head if cache.head else cache.capacity) - 1
        for i in range(index):
            target = cache_slot(cache, i)
            source = cache_slot(cache, i + 1)
            cache.stamps[target] = cache.stamps[source]
            cache.samples[target] = cache.samples[source]
    else:
        i = cache.count
        while i > index:
            target = cache_slot(cache, i)
            source = cache_slot(cache, i - 1)
            cache.stamps[target] = cache.stamps[source]
            cache.samples[target] = cache.samples[source]
            i -= 1
    cache.count += 1


cdef CacheInsert cache_insert(Cache* cache, int64_t stamp_ns, const Sample* sample,
                              int64_t cache_time_ns) noexcept nogil:
    # As tf2 does it: prune against the newest stamp before this insert, then refuse what is older than that.
    cdef uint32_t index, i, slot
    cdef FrameId before = sample.parent
    cdef FrameId after = sample.parent
    if cache.kind != CACHE_DYNAMIC and _become(cache, CACHE_DYNAMIC, FIRST_CAPACITY) != 0:
        return CACHE_NO_MEMORY
    _prune(cache, cache_time_ns)
    if cache.count and stamp_ns < cache.newest_ns - cache_time_ns:
        return CACHE_TOO_OLD
    index = _first_after(cache, stamp_ns)
    i = index
    while i > 0:
        slot = cache_slot(cache, i - 1)
        if cache.stamps[slot] != stamp_ns:
            break
        if _same(&cache.samples[slot], sample):
            return CACHE_DUPLICATE
        i -= 1
    if _reserve_one(cache) != 0:
        return CACHE_NO_MEMORY
    if index > 0:
        before = cache.samples[cache_slot(cache, index - 1)].parent
    if index < cache.count:
        after = cache.samples[cache_slot(cache, index)].parent
    cache.parent_changes += (before != sample.parent) + (sample.parent != after)
    if index > 0 and index < cache.count and before != after:
        cache.parent_changes -= 1
    _open_gap(cache, index)
    slot = cache_slot(cache, index)
    cache.stamps[slot] = stamp_ns
    cache.samples[slot] = sample[0]
    cache.newest_ns = cache.stamps[cache_slot(cache, cache.count - 1)]
    cache.oldest_ns = cache.stamps[cache.head]
    _shrink_if_long_sparse(cache)
    return CACHE_INSERTED


cdef CacheInsert cache_set_static(Cache* cache, int64_t stamp_ns, const Sample* sample) noexcept nogil:
    if cache.kind != CACHE_STATIC and _become(cache, CACHE_STATIC, 1) != 0:
        return CACHE_NO_MEMORY
    cache.count = 1
    cache.stamps[0] = stamp_ns
    cache.samples[0] = sample[0]
    return CACHE_INSERTED


cdef Gap cache_find(const Cache* cache, int64_t time_ns, uint32_t* hint, uint32_t* older,
                    uint32_t* newer) noexcept nogil:
    # Time 0 asks for the newest. At the oldest of several stamps the first arrival answers, at every
    # other stamp the last one.
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
        # A call of many times asks in order: the next gap is as likely as this one.
        index += 1
        if cache.stamps[cache_slot(cache, index)] <= time_ns:
            index = _first_after(cache, time_ns)
    elif cache.stamps[cache_slot(cache, index - 1)] > time_ns:
        index -= 1
        if cache.stamps[cache_slot(cache, index - 1)] > time_ns:
            index = _first_after(cache, time_ns)
    hint[0] = index
    older[0] = cache_slot(cache, index - 1)
    newer[0] = cache_slot(cache, index)
    if cache.stamps[older[0]] == time_ns or cache.samples[older[0]].parent != cache.samples[newer[0]].parent:
        newer[0] = older[0]
    return GAP_NONE


cdef Gap cache_transform_at(const Cache* cache, int64_t time_ns, uint32_t hint,
                            Transform* out) noexcept nogil:
    # Linear translation, slerp between the two neighbours of time_ns.
    cdef uint32_t older, newer
    cdef Gap gap = cache_find(cache, time_ns, &hint, &older, &newer)
    cdef const Transform* a
    cdef const Transform* b
    cdef double ratio
    if gap != GAP_NONE:
        return gap
    a = &cache.samples[older].transform
    if older == newer:
        out[0] = a[0]
        return GAP_NONE
    b = &cache.samples[newer].transform
    ratio = (<double>(time_ns - cache.stamps[older])) / (<double>(cache.stamps[newer] - cache.stamps[older]))
    out.translation[0] = (1.0 - ratio) * a.translation[0] + ratio * b.translation[0]
    out.translation[1] = (1.0 - ratio) * a.translation[1] + ratio * b.translation[1]
    out.translation[2] = (1.0 - ratio) * a.translation[2] + ratio * b.translation[2]
    quaternion_slerp(a.rotation, b.rotation, ratio, out.rotation)
    return GAP_NONE


cdef FrameId cache_parent_at(const Cache* cache, int64_t time_ns) noexcept nogil:
    # NO_FRAME where the history does not answer.
    cdef uint32_t older, newer
    cdef uint32_t hint = NEWEST_HINT
    if cache_find(cache, time_ns, &hint, &older, &newer) != GAP_NONE:
        return NO_FRAME
    return cache.samples[older].parent


cdef FrameId cache_newest_parent(const Cache* cache) noexcept nogil:
    if cache.count == 0:
        return NO_FRAME
    return cache.samples[cache_slot(cache, cache.count - 1)].parent


cdef size_t cache_bytes(const Cache* cache) noexcept nogil:
    return cache.capacity * (sizeof(int64_t) + sizeof(Sample))


cdef const char* cache_check(const Cache* cache) noexcept nogil:
    cdef uint32_t i, slot, previous
    cdef uint32_t changes = 0
    cdef const double* q
    if cache.count > cache.capacity or (cache.capacity and cache.head >= cache.capacity):
        return "count or head beyond capacity"
    if cache.kind == CACHE_UNBORN and cache.capacity:
        return "an unborn cache owns memory"
    if cache.kind == CACHE_STATIC and (cache.count != 1 or cache.newest_ns != 0):
        return "a static cache without its one sample"
    for i in range(cache.count):
        slot = cache_slot(cache, i)
        q = cache.samples[slot].transform.rotation
        if cache.stamps[slot] < 0 or cache.samples[slot].parent == NO_FRAME:
            return "a sample with a negative stamp or without parent"
        if fabs(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3] - 1.0) > 1e-12:
            return "a rotation that is not normalised"
        if i:
            previous = cache_slot(cache, i - 1)
            if cache.stamps[previous] > cache.stamps[slot]:
                return "stamps out of order"
            changes += cache.samples[previous].parent != cache.samples[slot].parent
    if changes != cache.parent_changes:
        return "parent_changes miscounted"
    if cache.kind == CACHE_DYNAMIC and cache.count:
        if cache.newest_ns != cache.stamps[cache_slot(cache, cache.count - 1)]:
            return "newest_ns is not the newest stamp"
        if cache.oldest_ns != cache.stamps[cache.head]:
            return "oldest_ns is not the oldest stamp"
    elif cache.newest_ns != 0 or cache.oldest_ns != 0:
        return "a stamp without a sample"
    return NULL
