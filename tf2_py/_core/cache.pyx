"""Owns the history of one frame: insert, find, interpolate, prune."""

from libc.math cimport fabs
from libc.stdint cimport INT64_MAX, INT64_MIN, int64_t, uint32_t
from libc.stdlib cimport free
from libc.string cimport memcpy, memset

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
    Sample,
    Transform,
)

cdef extern from "<stdlib.h>" nogil:
    int posix_memalign(void** out, size_t alignment, size_t size)


cdef enum:
    FIRST_CAPACITY = 8
    LAST_CAPACITY = 0x7FFFFFFF
    SHRINK_ABOVE = 64       # smaller rings are not worth shrinking
    MOST_OF_ONE_STAMP = 64  # samples
    LOOK_AHEAD = 64         # samples


# Samples are read by lookups that do not hold the lock, see cache_pin. So no sample is written over that
# somebody has pinned: the ring goes on in other memory instead, and the old memory goes with the last who
# reads it.

cdef extern from *:
    """
    #define TF2_ADD(where, what) __atomic_add_fetch(where, what, __ATOMIC_ACQ_REL)
    #define TF2_LOAD(where) __atomic_load_n(where, __ATOMIC_ACQUIRE)
    #define TF2_STORE(where, what) __atomic_store_n(where, what, __ATOMIC_RELAXED)
    """
    uint32_t _add "TF2_ADD"(uint32_t* where, uint32_t what) nogil
    uint32_t _load "TF2_LOAD"(const uint32_t* where) nogil
    void _store "TF2_STORE"(uint32_t* where, uint32_t what) nogil


cdef inline void _release(Ring* ring) noexcept nogil:
    if ring != NULL and _add(&ring.owners, <uint32_t>-1) == 0:
        free(ring)


cdef inline bint _is_pinned(const Cache* cache) noexcept nogil:
    return cache.ring != NULL and _load(&cache.ring.owners) > 1


cdef void cache_pin(const Cache* cache, Cache* copy) noexcept nogil:
    copy[0] = cache[0]
    # Of several who pin between the same two writes each finds the same head.
    if cache.ring != NULL and _add(&cache.ring.owners, 1) == 2:
        _store(&cache.ring.kept_from, cache.head)


cdef void cache_unpin(Cache* copy) noexcept nogil:
    _release(copy.ring)


cdef int _resize(Cache* cache, uint32_t capacity) noexcept nogil:
    # Move the samples into fresh memory; -1 and nothing changed where there is none.
    cdef Ring* ring
    cdef int64_t* stamps
    cdef Sample* samples
    cdef uint32_t first
    if posix_memalign(<void**>&ring, LINE, ring_bytes(capacity)) != 0:
        return -1
    ring.owners = 1
    ring.bytes = ring_bytes(capacity)
    stamps = <int64_t*>(<char*>ring + ring_lines(sizeof(Ring)))
    samples = <Sample*>(<char*>stamps + ring_lines(capacity * sizeof(int64_t)))
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


cdef uint32_t _kept(const Cache* cache) noexcept nogil:
    # How many samples older than the head must stay where they are.
    cdef uint32_t kept_from
    if not _is_pinned(cache):
        return 0
    kept_from = _load(&cache.ring.kept_from)
    return cache.head - kept_from if cache.head >= kept_from else cache.head + cache.capacity - kept_from


cdef CacheInsert _grow(Cache* cache, uint32_t capacity, size_t room) noexcept nogil:
    # Move the samples to fresh memory, or say why not: CACHE_INSERTED, nothing stands in the way.
    if ring_bytes(capacity) > cache_bytes(cache) + room:
        return CACHE_FULL
    return CACHE_INSERTED if _resize(cache, capacity) == 0 else CACHE_NO_MEMORY


cdef CacheInsert _reserve_one(Cache* cache, bint at_the_end, size_t room) noexcept nogil:
    # For one more sample.
    cdef uint32_t capacity = cache.capacity
    cdef CacheInsert outcome
    if at_the_end and cache.count + _kept(cache) < capacity:
        return CACHE_INSERTED
    if not at_the_end and cache.count < capacity and not _is_pinned(cache):
        return CACHE_INSERTED
    if capacity == LAST_CAPACITY and cache.count == capacity:
        return CACHE_FULL
    if cache.count >= capacity - capacity // 4:
        # By half: at worst 1.5 x 72 bytes per sample. The halves cannot overflow 32 bits, see LAST_CAPACITY.
        capacity = capacity + capacity // 2 if capacity else FIRST_CAPACITY
    outcome = _grow(cache, min(capacity, <uint32_t>LAST_CAPACITY), room)
    if outcome == CACHE_FULL and cache.count < cache.capacity:
        outcome = _grow(cache, cache.capacity, room)
    return outcome


cdef void cache_free(Cache* cache) noexcept nogil:
    _release(cache.ring)
    cache.ring = NULL
    cache.stamps = NULL
    cache.samples = NULL
    cache.capacity = cache.head = cache.count = cache.parent_changes = cache.sparse_inserts = 0
    cache.newest_ns = cache.oldest_ns = 0
    cache.kind = CACHE_UNBORN


cdef CacheInsert _become(Cache* cache, CacheKind kind, uint32_t capacity, size_t room) noexcept nogil:
    # A frame that turns from dynamic to static or back loses its history, but only once there is memory.
    cdef Cache fresh
    cdef CacheInsert outcome
    memset(&fresh, 0, sizeof(Cache))
    fresh.kind = kind
    fresh.authority = cache.authority
    fresh.is_parent = cache.is_parent
    outcome = _grow(&fresh, capacity, cache_bytes(cache) + room)
    if outcome == CACHE_INSERTED:
        cache_free(cache)
        cache[0] = fresh
    return outcome


cdef void cache_clear(Cache* cache) noexcept nogil:
    if _is_pinned(cache):
        _release(cache.ring)
        cache.ring = NULL
        cache.stamps = NULL
        cache.samples = NULL
        cache.capacity = 0
    cache.head = cache.count = cache.parent_changes = 0
    cache.newest_ns = cache.oldest_ns = 0


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
    # The index of the first sample with stamp > time_ns; count where there is none. Stamps come at
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


cdef inline uint32_t _differ(const Cache* cache, uint32_t index, FrameId parent) noexcept nogil:
    # How many of the neighbours of a sample have another parent.
    cdef uint32_t count = 0
    if index > 0:
        count += cache_parent_of(cache, index - 1) != parent
    if index + 1 < cache.count:
        count += cache_parent_of(cache, index + 1) != parent
    return count


cdef inline void _no_change(CacheChange* change) noexcept nogil:
    change.covered.first = change.lost.first = change.relinked.first = INT64_MAX
    change.covered.last = change.lost.last = change.relinked.last = INT64_MIN
    change.moved = 0


cdef inline void _set(Times* times, int64_t first, int64_t last) noexcept nogil:
    times.first = first
    times.last = last


cdef void _prune(Cache* cache, int64_t horizon_ns, CacheChange* change) noexcept nogil:
    # All that is older, but for the newest sample.
    cdef int64_t oldest_ns = cache.oldest_ns
    cdef uint32_t gone, i
    if cache.count < 2 or oldest_ns >= horizon_ns:
        return
    gone = min(_first_after(cache, horizon_ns - 1), cache.count - 1)
    for i in range(gone if cache.parent_changes else 0):
        cache.parent_changes -= cache_parent_of(cache, i) != cache_parent_of(cache, i + 1)
    cache.head = cache_slot(cache, gone)
    cache.count -= gone
    cache.oldest_ns = cache.stamps[cache.head]
    # With the new oldest stamp, of which the first sample answers from now on.
    _set(&change.lost, min(change.lost.first, oldest_ns), cache.oldest_ns)


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
    # Make room at `index` by moving the shorter side one place outwards.
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


cdef void _note_insert(const Cache* cache, uint32_t index, int64_t stamp_ns, FrameId parent,
                       CacheChange* change) noexcept nogil:
    # What a sample will change that is about to go to `index`.
    cdef int64_t newest_ns = cache.newest_ns
    cdef int64_t next_ns
    if cache.count == 0:
        _set(&change.covered, stamp_ns, stamp_ns)
    elif index == 0:
        _set(&change.covered, stamp_ns, cache.oldest_ns)
        change.relinked = change.covered
    else:
        if index == cache.count:
            _set(&change.covered, newest_ns, stamp_ns)
            next_ns = stamp_ns
        else:
            next_ns = cache.stamps[cache_slot(cache, index)]
        if index == cache.count and newest_ns == cache.oldest_ns:
            # Of several samples of one stamp the last answers for the newest stamp, the first for the oldest.
            _set(&change.relinked, newest_ns, stamp_ns)
        elif cache_parent_of(cache, index - 1) != parent:
            _set(&change.relinked, stamp_ns, next_ns)


cdef void _replace_last_of_stamp(Cache* cache, uint32_t index, const Sample* sample,
                                 CacheChange* change) noexcept nogil:
    # Of all samples of one stamp only the first and the last answer: so the rest can be few, however many
    # come.
    cdef Sample* last = &cache.samples[cache_slot(cache, index)]
    cdef int64_t stamp_ns = cache.stamps[cache_slot(cache, index)]
    if last.parent != sample.parent:
        cache.parent_changes -= _differ(cache, index, last.parent)
        cache.parent_changes += _differ(cache, index, sample.parent)
        _set(&change.relinked, stamp_ns,
             cache.stamps[cache_slot(cache, index + 1)] if index + 1 < cache.count else stamp_ns)
    last[0] = sample[0]


cdef CacheInsert cache_insert(Cache* cache, int64_t stamp_ns, const Sample* sample, int64_t cache_time_ns,
                              size_t room, CacheChange* change) noexcept nogil:
    # As tf2 does it: prune against the newest stamp before this insert, then refuse what is older than that.
    cdef uint32_t index, i, slot
    cdef bint was_static = cache.kind == CACHE_STATIC
    cdef CacheInsert outcome = CACHE_INSERTED
    _no_change(change)
    if cache.kind != CACHE_DYNAMIC:
        outcome = _become(cache, CACHE_DYNAMIC, FIRST_CAPACITY, room)
        if outcome != CACHE_INSERTED:
            return outcome
        if was_static:
            _set(&change.lost, INT64_MIN, INT64_MAX)
    _prune(cache, cache.newest_ns - cache_time_ns, change)
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
    if index - i >= MOST_OF_ONE_STAMP:
        if _is_pinned(cache):
            outcome = _grow(cache, cache.capacity, room)
        if outcome == CACHE_INSERTED:
            _replace_last_of_stamp(cache, index - 1, sample, change)
        return outcome
    outcome = _reserve_one(cache, index == cache.count, room)
    if outcome == CACHE_FULL and index == cache.count:
        # What the next insert would prune goes now, for otherwise there would be no next insert.
        _prune(cache, stamp_ns - cache_time_ns, change)
        index = cache.count
        outcome = _reserve_one(cache, True, room)
    if outcome != CACHE_INSERTED:
        return outcome
    _note_insert(cache, index, stamp_ns, sample.parent, change)
    if index > 0 and index < cache.count:
        # The two that are neighbours no longer.
        cache.parent_changes -= cache_parent_of(cache, index - 1) != cache_parent_of(cache, index)
    change.moved = min(index, cache.count - index)
    _open_gap(cache, index)
    slot = cache_slot(cache, index)
    cache.stamps[slot] = stamp_ns
    cache.samples[slot] = sample[0]
    cache.parent_changes += _differ(cache, index, sample.parent)
    cache.newest_ns = cache.stamps[cache_slot(cache, cache.count - 1)]
    cache.oldest_ns = cache.stamps[cache.head]
    _shrink_if_long_sparse(cache)
    return CACHE_INSERTED


cdef CacheInsert cache_set_static(Cache* cache, int64_t stamp_ns, const Sample* sample, size_t room,
                                  CacheChange* change) noexcept nogil:
    cdef CacheInsert outcome = CACHE_INSERTED
    cdef bint was_static = cache.kind == CACHE_STATIC
    _no_change(change)
    if not was_static:
        outcome = _become(cache, CACHE_STATIC, 1, room)
    elif _is_pinned(cache):
        outcome = _grow(cache, 1, room)
    if outcome != CACHE_INSERTED:
        return outcome
    if not was_static:
        _set(&change.covered, INT64_MIN, INT64_MAX)
        change.relinked = change.covered
    cache.count = 1
    cache.stamps[0] = stamp_ns
    cache.samples[0] = sample[0]
    return CACHE_INSERTED


cdef Gap _find(const Cache* cache, int64_t time_ns, uint32_t* hint, uint32_t* older,
               uint32_t* newer) noexcept nogil:
    # As cache_neighbours, but slots. Time 0 asks for the newest. At the oldest of several stamps the first arrival answers, at every
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
    # NO_FRAME where the history does not answer.
    cdef uint32_t older, newer
    cdef uint32_t hint = NEWEST_HINT
    if _find(cache, time_ns, &hint, &older, &newer) != GAP_NONE:
        return NO_FRAME
    return cache.samples[older].parent


cdef FrameId cache_newest_parent(const Cache* cache) noexcept nogil:
    if cache.count == 0:
        return NO_FRAME
    return cache_parent_of(cache, cache.count - 1)


cdef int64_t cache_parent_until(const Cache* cache, int64_t time_ns) noexcept nogil:
    cdef uint32_t index = _first_after(cache, time_ns)
    cdef uint32_t last = min(cache.count, index + LOOK_AHEAD)
    if index == 0:
        return cache.oldest_ns if cache.count else INT64_MAX
    if index > 1 and time_ns == cache.oldest_ns:
        return time_ns + 1  # for the oldest stamp the first of its samples answers, right after it the last
    while index < last:
        if cache_parent_of(cache, index) != cache_parent_of(cache, index - 1):
            return cache.stamps[cache_slot(cache, index)]
        index += 1
    return INT64_MAX if index == cache.count else cache.stamps[cache_slot(cache, index)]


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
