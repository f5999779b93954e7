"""Owns changing the history of one frame: insert, prune, replace."""

from libc.math cimport fabs, isfinite
from libc.stdint cimport INT64_MAX, INT64_MIN, int64_t, uint32_t
from libc.string cimport memset

from tf2_py._core.cache cimport (
    CACHE_DYNAMIC,
    CACHE_NONE,
    CACHE_STATIC,
    Cache,
    CacheKind,
    cache_bytes,
    cache_parent_of,
    cache_slot,
)
from tf2_py._core.cache_find cimport cache_first_after
from tf2_py._core.cache_memory cimport (
    CACHE_DUPLICATE,
    CACHE_FULL,
    CACHE_INSERTED,
    CACHE_TOO_OLD,
    FIRST_CAPACITY,
    CacheInsert,
    cache_free,
    cache_is_pinned,
    cache_move,
    cache_reserve_one,
    cache_shrink,
)
from tf2_py._core.geometry cimport quaternion_canonicalise
from tf2_py._core.types cimport MAX_STAMP_NS, NO_FRAME, FrameId, Sample, Transform

cdef enum:
    MAX_PER_STAMP = 64      # samples; of more, the last is replaced


cdef inline uint32_t _differ(const Cache* cache, uint32_t index, FrameId parent) noexcept nogil:
    # How many of the neighbours of a sample have another parent.
    cdef uint32_t count = 0
    if index > 0:
        count += cache_parent_of(cache, index - 1) != parent
    if index + 1 < cache.count:
        count += cache_parent_of(cache, index + 1) != parent
    return count


cdef inline void _clear_change(CacheChange* change) noexcept nogil:
    change.covered.first = change.lost.first = change.relinked.first = INT64_MAX
    change.covered.last = change.lost.last = change.relinked.last = INT64_MIN
    change.moved = 0


cdef inline void _set_range(TimeRange* times_ns, int64_t first, int64_t last) noexcept nogil:
    times_ns.first = first
    times_ns.last = last


cdef CacheInsert _change_kind(Cache* cache, CacheKind kind, uint32_t capacity,
                              size_t growth_limit) noexcept nogil:
    # A frame that turns from dynamic to static or back loses its history, but only once there is memory.
    cdef Cache fresh
    cdef CacheInsert outcome
    memset(&fresh, 0, sizeof(Cache))
    fresh.kind = kind
    fresh.authority = cache.authority
    fresh.is_parent = cache.is_parent
    fresh.arena = cache.arena
    fresh.appended = cache.appended
    fresh.disturbed = cache.disturbed
    outcome = cache_move(&fresh, capacity, cache_bytes(cache) + growth_limit)
    if outcome == CACHE_INSERTED:
        cache_free(cache)
        cache[0] = fresh
    return outcome


cdef void _prune(Cache* cache, int64_t horizon_ns, CacheChange* change) noexcept nogil:
    # Drop all samples older than that, but for the newest one.
    cdef int64_t oldest_ns = cache.oldest_ns
    cdef uint32_t pruned, i
    if cache.count < 2 or oldest_ns >= horizon_ns:
        return
    pruned = min(cache_first_after(cache, horizon_ns - 1), cache.count - 1)
    for i in range(pruned if cache.parent_changes else 0):
        cache.parent_changes -= cache_parent_of(cache, i) != cache_parent_of(cache, i + 1)
    cache.head = cache_slot(cache, pruned)
    cache.count -= pruned
    cache.oldest_ns = cache.stamps[cache.head]
    # Including the new oldest stamp: from now on, the first of its samples answers.
    _set_range(&change.lost, min(change.lost.first, oldest_ns), cache.oldest_ns)


cdef inline bint _same(const Sample* a, const Sample* b) noexcept nogil:
    return (a.parent == b.parent
            and a.transform.translation[0] == b.transform.translation[0]
            and a.transform.translation[1] == b.transform.translation[1]
            and a.transform.translation[2] == b.transform.translation[2]
            and a.transform.rotation[0] == b.transform.rotation[0]
            and a.transform.rotation[1] == b.transform.rotation[1]
            and a.transform.rotation[2] == b.transform.rotation[2]
            and a.transform.rotation[3] == b.transform.rotation[3])


cdef void _make_slot(Cache* cache, uint32_t index) noexcept nogil:
    # Free the slot of `index` by moving the shorter side one slot outwards.
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
    if index == cache.count:
        cache.appended += 1
    else:
        cache.disturbed += 1
    cache.count += 1


cdef void _describe_insert(const Cache* cache, uint32_t index, int64_t stamp_ns, FrameId parent,
                           CacheChange* change) noexcept nogil:
    # What a sample changes that is about to be inserted at `index`.
    cdef int64_t newest_ns = cache.newest_ns
    cdef int64_t next_ns
    if cache.count == 0:
        _set_range(&change.covered, stamp_ns, stamp_ns)
    elif index == 0:
        _set_range(&change.covered, stamp_ns, cache.oldest_ns)
        change.relinked = change.covered
    else:
        if index == cache.count:
            _set_range(&change.covered, newest_ns, stamp_ns)
            next_ns = stamp_ns
        else:
            next_ns = cache.stamps[cache_slot(cache, index)]
        if index == cache.count and newest_ns == cache.oldest_ns:
            # Of several samples of one stamp the last answers for the newest stamp, the first for the oldest.
            _set_range(&change.relinked, newest_ns, stamp_ns)
        elif cache_parent_of(cache, index - 1) != parent:
            _set_range(&change.relinked, stamp_ns, next_ns)


cdef void _replace_last_of_stamp(Cache* cache, uint32_t index, const Sample* sample,
                                 CacheChange* change) noexcept nogil:
    # Of all samples of one stamp only the first and the last answer, so the others need not be kept.
    cdef Sample* last = &cache.samples[cache_slot(cache, index)]
    cdef int64_t stamp_ns = cache.stamps[cache_slot(cache, index)]
    if last.parent != sample.parent:
        cache.parent_changes -= _differ(cache, index, last.parent)
        cache.parent_changes += _differ(cache, index, sample.parent)
        _set_range(&change.relinked, stamp_ns,
                   cache.stamps[cache_slot(cache, index + 1)] if index + 1 < cache.count else stamp_ns)
    last[0] = sample[0]
    cache.disturbed += 1


cdef CacheInsert cache_insert(Cache* cache, int64_t stamp_ns, const Sample* sample, int64_t cache_time_ns,
                              size_t growth_limit, CacheChange* change) noexcept nogil:
    # As tf2 does it: prune against the newest stamp before this insert, then refuse what is older than that.
    cdef uint32_t index, i, slot
    cdef bint was_static = cache.kind == CACHE_STATIC
    cdef CacheInsert outcome = CACHE_INSERTED
    _clear_change(change)
    if cache.kind != CACHE_DYNAMIC:
        outcome = _change_kind(cache, CACHE_DYNAMIC, FIRST_CAPACITY, growth_limit)
        if outcome != CACHE_INSERTED:
            return outcome
        if was_static:
            _set_range(&change.lost, INT64_MIN, INT64_MAX)
    _prune(cache, cache.newest_ns - cache_time_ns, change)
    if cache.count and stamp_ns < cache.newest_ns - cache_time_ns:
        return CACHE_TOO_OLD
    index = cache_first_after(cache, stamp_ns)
    i = index
    while i > 0:
        slot = cache_slot(cache, i - 1)
        if cache.stamps[slot] != stamp_ns:
            break
        if _same(&cache.samples[slot], sample):
            return CACHE_DUPLICATE
        i -= 1
    if index - i >= MAX_PER_STAMP:
        if cache_is_pinned(cache):
            outcome = cache_move(cache, cache.capacity, growth_limit)
        if outcome == CACHE_INSERTED:
            _replace_last_of_stamp(cache, index - 1, sample, change)
        return outcome
    outcome = cache_reserve_one(cache, index == cache.count, growth_limit)
    if outcome == CACHE_FULL and index == cache.count:
        # Prune now what the next insert would prune: without memory there would be no next insert.
        _prune(cache, stamp_ns - cache_time_ns, change)
        index = cache.count
        outcome = cache_reserve_one(cache, True, growth_limit)
    if outcome != CACHE_INSERTED:
        return outcome
    _describe_insert(cache, index, stamp_ns, sample.parent, change)
    if index > 0 and index < cache.count:
        # These two are no longer neighbours.
        cache.parent_changes -= cache_parent_of(cache, index - 1) != cache_parent_of(cache, index)
    change.moved = min(index, cache.count - index)
    _make_slot(cache, index)
    slot = cache_slot(cache, index)
    cache.stamps[slot] = stamp_ns
    cache.samples[slot] = sample[0]
    cache.parent_changes += _differ(cache, index, sample.parent)
    cache.newest_ns = cache.stamps[cache_slot(cache, cache.count - 1)]
    cache.oldest_ns = cache.stamps[cache.head]
    cache_shrink(cache)
    return CACHE_INSERTED


cdef CacheInsert cache_set_static(Cache* cache, int64_t stamp_ns, const Sample* sample, size_t growth_limit,
                                  CacheChange* change) noexcept nogil:
    cdef CacheInsert outcome = CACHE_INSERTED
    cdef bint was_static = cache.kind == CACHE_STATIC
    _clear_change(change)
    if not was_static:
        outcome = _change_kind(cache, CACHE_STATIC, 1, growth_limit)
    elif cache_is_pinned(cache):
        outcome = cache_move(cache, 1, growth_limit)
    if outcome != CACHE_INSERTED:
        return outcome
    if not was_static:
        _set_range(&change.covered, INT64_MIN, INT64_MAX)
        change.relinked = change.covered
    cache.count = 1
    cache.disturbed += 1
    cache.stamps[0] = stamp_ns
    cache.samples[0] = sample[0]
    return CACHE_INSERTED


cdef const char* _transform_check(const Transform* transform) noexcept nogil:
    cdef const double* t = transform.translation
    cdef const double* q = transform.rotation
    cdef Transform copy = transform[0]
    cdef int i
    if not (isfinite(t[0]) and isfinite(t[1]) and isfinite(t[2])):
        return "a translation that is not finite"
    # Not "> 1e-12": that is false for NaN.
    if not fabs(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3] - 1.0) <= 1e-12:
        return "a rotation that is not normalised"
    quaternion_canonicalise(copy.rotation)
    for i in range(4):
        if copy.rotation[i] != q[i]:
            return "a rotation without the canonical sign"
    return NULL


cdef const char* cache_check(const Cache* cache) noexcept nogil:
    cdef uint32_t i, slot, previous
    cdef uint32_t changes = 0
    cdef uint32_t same_stamp = 1
    cdef const char* problem
    if cache.count > cache.capacity or (cache.capacity and cache.head >= cache.capacity):
        return "count or head beyond capacity"
    if cache.kind == CACHE_NONE and cache.capacity:
        return "a frame that was never a child owns memory"
    # A smaller one would not grow by half.
    if cache.kind == CACHE_DYNAMIC and cache.capacity and cache.capacity < FIRST_CAPACITY:
        return "a dynamic cache of less than the first capacity"
    if cache.kind == CACHE_STATIC and (cache.count != 1 or cache.newest_ns != 0):
        return "a static cache without its one sample"
    for i in range(cache.count):
        slot = cache_slot(cache, i)
        if cache.stamps[slot] < 0 or cache.stamps[slot] > MAX_STAMP_NS:
            return "a sample with a stamp that no message holds"
        if cache.samples[slot].parent == NO_FRAME:
            return "a sample without parent"
        problem = _transform_check(&cache.samples[slot].transform)
        if problem != NULL:
            return problem
        if i:
            previous = cache_slot(cache, i - 1)
            if cache.stamps[previous] > cache.stamps[slot]:
                return "stamps out of order"
            same_stamp = same_stamp + 1 if cache.stamps[previous] == cache.stamps[slot] else 1
            if same_stamp > MAX_PER_STAMP:
                return "too many samples of one stamp"
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


cdef inline bint _is_sound(const Cache* cache, uint32_t slot, FrameId child, uint32_t frames) noexcept nogil:
    cdef int64_t stamp_ns = cache.stamps[slot]
    cdef FrameId parent = cache.samples[slot].parent
    return (0 <= stamp_ns <= MAX_STAMP_NS and parent != NO_FRAME and parent != child and parent < frames
            and _transform_check(&cache.samples[slot].transform) == NULL)


cdef void cache_mend(Cache* cache, FrameId child, uint32_t frames) noexcept nogil:
    cdef uint32_t count = cache.count
    cdef uint32_t i, slot
    cdef uint32_t same_stamp = 0
    cdef uint32_t last = 0
    cdef int64_t stamp_ns
    cdef Sample sample
    cache.count = cache.parent_changes = 0
    cache.newest_ns = cache.oldest_ns = 0
    for i in range(count):
        slot = cache_slot(cache, i)
        if not _is_sound(cache, slot, child, frames):
            continue
        stamp_ns = cache.stamps[slot]
        sample = cache.samples[slot]
        if cache.count and cache.stamps[last] > stamp_ns:
            continue
        same_stamp = same_stamp + 1 if cache.count and cache.stamps[last] == stamp_ns else 1
        if same_stamp > MAX_PER_STAMP or (cache.kind == CACHE_STATIC and cache.count):
            continue
        if cache.count:
            cache.parent_changes += cache.samples[last].parent != sample.parent
        last = cache_slot(cache, cache.count)
        cache.stamps[last] = stamp_ns
        cache.samples[last] = sample
        cache.count += 1
    if cache.count == 0 and cache.kind == CACHE_STATIC or cache.capacity < FIRST_CAPACITY and (
            cache.kind == CACHE_DYNAMIC):
        cache_free(cache)
    elif cache.count and cache.kind == CACHE_DYNAMIC:
        cache.newest_ns = cache.stamps[last]
        cache.oldest_ns = cache.stamps[cache.head]
