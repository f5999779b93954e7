# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Keep the history of one frame: its memory, finding a time and interpolating there, inserting, copying."""

# Memory: growing, shrinking, pinning.

cdef extern from "<stdlib.h>" nogil:
    void* aligned_alloc(size_t alignment, size_t size)     # the size is a multiple of the alignment


cdef enum:
    SHRINK_ABOVE = 64               # samples; smaller rings are not worth shrinking


cdef inline size_t _whole_lines(size_t size) noexcept nogil:
    # In bytes, as `size`.
    return (size + LINE_BYTES - 1) // LINE_BYTES * LINE_BYTES


cdef inline size_t _memory_bytes(uint32_t capacity) noexcept nogil:
    return (_whole_lines(sizeof(HistoryMemory)) + _whole_lines(capacity * sizeof(int64_t))
            + capacity * sizeof(Sample))


cdef inline int64_t* _stamps_in(HistoryMemory* memory) noexcept nogil:
    return <int64_t*>(<char*>memory + _whole_lines(sizeof(HistoryMemory)))


cdef inline Sample* _samples_in(HistoryMemory* memory, uint32_t capacity) noexcept nogil:
    return <Sample*>(<char*>_stamps_in(memory) + _whole_lines(capacity * sizeof(int64_t)))


cdef void mapping_release(FileMapping* mapping) noexcept nogil:
    if mapping != NULL and add_acq_rel(&mapping.owners, <uint32_t>-1) == 1:
        munmap(mapping.start, mapping.size)
        free(mapping)


cdef inline void _release(HistoryMemory* memory) noexcept nogil:
    if memory != NULL and add_acq_rel(&memory.owners, <uint32_t>-1) == 1:
        mapping_release(memory.mapping)
        free(memory)


cdef inline bint _is_mapped(const History* history) noexcept nogil:
    return history.memory != NULL and history.memory.mapping != NULL


cdef bint _history_is_pinned(const History* history) noexcept nogil:
    return _is_mapped(history) or (history.memory != NULL and load_acquire(&history.memory.owners) > 1)


cdef void history_pin(const History* history, History* copy) noexcept nogil:
    copy[0] = history[0]
    if history.memory != NULL and add_acq_rel(&history.memory.owners, 1) == 1:
        history.memory.pinned_from = history.head


cdef void history_unpin(History* copy) noexcept nogil:
    _release(copy.memory)


cdef uint32_t _pinned_before_head(const History* history) noexcept nogil:
    # How many slots before the head hold samples that have been pruned here and are still read by a copy.
    cdef uint32_t pinned_from
    if not _history_is_pinned(history):
        return 0
    if _is_mapped(history):
        return history.head
    pinned_from = history.memory.pinned_from
    if history.head >= pinned_from:
        return history.head - pinned_from
    return history.head + history.capacity - pinned_from


cdef HistoryInsert _move(History* history, uint32_t capacity, size_t growth_limit) noexcept nogil:
    # Moves the samples to new memory for `capacity` of them, at least `count`. HISTORY_INSERTED; or
    # HISTORY_FULL or HISTORY_NO_MEMORY, and nothing has changed. `growth_limit`: by how many bytes the memory
    # may grow.
    cdef size_t bytes = _memory_bytes(capacity)
    cdef HistoryMemory* memory
    cdef int64_t* stamps
    cdef Sample* samples
    if bytes > history_allocated(history) + growth_limit:
        return HISTORY_FULL
    memory = <HistoryMemory*>aligned_alloc(LINE_BYTES, bytes)
    if memory == NULL:
        return HISTORY_NO_MEMORY
    memory.owners = 1
    memory.bytes = bytes
    memory.mapping = NULL
    stamps, samples = _stamps_in(memory), _samples_in(memory, capacity)
    if history.count:
        history_copy_stamps(history, 0, history.count, stamps)
        history_copy_samples(history, 0, history.count, samples)
    _release(history.memory)
    history.memory = memory
    history.stamps = stamps
    history.samples = samples
    history.capacity = capacity
    history.head = 0
    return HISTORY_INSERTED


cdef HistoryInsert _history_reserve_one(History* history, bint at_the_end,
                                        size_t growth_limit) noexcept nogil:
    # Ensures a free slot behind the newest sample or, if not `at_the_end`, anywhere. Returns the same as
    # _move.
    cdef uint32_t capacity = history.capacity
    cdef HistoryInsert outcome
    if at_the_end and history.count + _pinned_before_head(history) < capacity:
        return HISTORY_INSERTED
    if not at_the_end and history.count < capacity and not _history_is_pinned(history):
        return HISTORY_INSERTED
    if capacity == LAST_CAPACITY and history.count == capacity:
        return HISTORY_FULL
    if history.count >= capacity - capacity // 4:
        # By half: at most 1.5 x 72 bytes per sample. This cannot overflow 32 bits, see LAST_CAPACITY.
        capacity += capacity // 2
    # One that was mapped may be smaller than that.
    capacity = max(capacity, <uint32_t>FIRST_CAPACITY)
    outcome = _move(history, min(capacity, <uint32_t>LAST_CAPACITY), growth_limit)
    capacity = max(history.capacity, <uint32_t>FIRST_CAPACITY)
    if outcome == HISTORY_FULL and history.count < capacity:
        outcome = _move(history, capacity, growth_limit)
    return outcome


cdef void _history_shrink(History* history) noexcept nogil:
    # Called after each insert. A burst leaves a large ring behind. It is halved after as many inserts as it
    # has slots, so that the copy costs O(1) per insert. Without memory for the smaller copy, the large ring
    # stays.
    if history.capacity <= SHRINK_ABOVE or history.count >= history.capacity // 4:
        history.mostly_empty_for = 0
        return
    history.mostly_empty_for += 1
    if history.mostly_empty_for > history.capacity:
        history.mostly_empty_for = 0
        _move(history, history.capacity // 2, 0)


cdef int history_map(History* history, FileMapping* mapping, const int64_t* stamps, const Sample* samples,
                     uint32_t count) noexcept nogil:
    cdef size_t bytes = _whole_lines(sizeof(HistoryMemory))
    cdef HistoryMemory* memory = <HistoryMemory*>aligned_alloc(LINE_BYTES, bytes)
    if memory == NULL:
        return -1
    memory.owners = 1
    memory.pinned_from = 0
    # Shared mappings do not count as memory of this process.
    memory.bytes = bytes
    memory.mapping = mapping
    add_acq_rel(&mapping.owners, 1)
    history.memory = memory
    history.stamps = <int64_t*>stamps       # a write moves both elsewhere first, because they are pinned
    history.samples = <Sample*>samples
    history.capacity = history.count = count
    return 0


cdef int history_import(History* history, const int64_t* stamps, const Sample* samples,
                        uint32_t count) noexcept nogil:
    # The same capacity as after inserting them one by one, so that a copy does not reach max_bytes earlier.
    cdef uint32_t capacity = FIRST_CAPACITY if history.kind == HISTORY_DYNAMIC else 1
    while capacity < count:
        capacity += capacity // 2
    # As if they were in a ring that is full.
    history.stamps = <int64_t*>stamps
    history.samples = <Sample*>samples
    history.capacity = history.count = count
    capacity = min(capacity, <uint32_t>LAST_CAPACITY)
    return 0 if _move(history, capacity, UINT64_MAX) == HISTORY_INSERTED else -1


cdef inline void _drop_memory(History* history) noexcept nogil:
    _release(history.memory)
    history.memory = NULL
    history.stamps = NULL
    history.samples = NULL
    history.capacity = 0


cdef inline void _drop_samples(History* history) noexcept nogil:
    history.head = history.count = history.parent_changes = 0
    history.newest_ns = history.oldest_ns = 0


cdef void history_free(History* history) noexcept nogil:
    _drop_memory(history)
    _drop_samples(history)
    history.mostly_empty_for = 0
    history.kind = HISTORY_NONE


cdef void history_clear(History* history) noexcept nogil:
    if _history_is_pinned(history):
        _drop_memory(history)
    _drop_samples(history)


# Finding a time, and interpolating there.

cdef uint32_t history_first_after(const History* history, int64_t time_ns) noexcept nogil:
    # The index of the first sample with a later stamp; `count`: there is none.
    # Most stamps arrive at a steady rate: guess the index from the ends, step away from the guess in doubling
    # strides, halve the rest. O(log n) for any stamps, a few probes for even ones.
    cdef uint32_t count = history.count
    cdef uint32_t low, high, stride, middle
    if count == 0 or history.newest_ns <= time_ns:
        return count
    if history.oldest_ns > time_ns:
        return 0
    # From here on: stamp(low) <= time_ns < stamp(high).
    low = 0
    high = count - 1
    middle = _history_guess(history, time_ns)
    stride = 1
    if history_stamp_of(history, middle) <= time_ns:
        low = middle
        while high - low > stride and history_stamp_of(history, low + stride) <= time_ns:
            low += stride
            stride *= 2
        if high - low > stride:
            high = low + stride
    else:
        high = middle
        while high - low > stride and history_stamp_of(history, high - stride) > time_ns:
            high -= stride
            stride *= 2
        if high - low > stride:
            low = high - stride
    while high - low > 1:
        middle = low + (high - low) // 2
        if history_stamp_of(history, middle) <= time_ns:
            low = middle
        else:
            high = middle
    return high


cdef inline Gap _find_slots(const History* history, int64_t time_ns, uint32_t* hint, uint32_t* older,
                            uint32_t* newer) noexcept nogil:
    # As history_neighbors, but slots. Of equal stamps the last arrival answers; where they are the oldest
    # of several, the first. `hint` is the index of the newer sample.
    cdef uint32_t count = history.count
    cdef uint32_t index
    if count == 0:
        return GAP_EMPTY
    if history.kind == HISTORY_STATIC:
        older[0] = newer[0] = history.head
        return GAP_NONE
    if time_ns == 0 or time_ns == history.newest_ns:
        older[0] = newer[0] = _history_slot(history, count - 1)
        return GAP_NONE
    if count == 1:
        return GAP_SINGLE
    if time_ns > history.newest_ns:
        return GAP_FUTURE
    if time_ns == history.oldest_ns:
        older[0] = newer[0] = history.head
        return GAP_NONE
    if time_ns < history.oldest_ns:
        return GAP_PAST
    index = min(hint[0], count - 1)
    if history_stamp_of(history, index) <= time_ns:
        # A series looks up its times in order, so the next interval is as likely as this one.
        index += 1
        if history_stamp_of(history, index) <= time_ns:
            index = history_first_after(history, time_ns)
    elif history_stamp_of(history, index - 1) > time_ns:
        index -= 1
        if history_stamp_of(history, index - 1) > time_ns:
            index = history_first_after(history, time_ns)
    hint[0] = index
    older[0] = _history_slot(history, index - 1)
    newer[0] = _history_slot(history, index)
    if (history.stamps[older[0]] == time_ns
            or history.samples[older[0]].parent != history.samples[newer[0]].parent):
        newer[0] = older[0]
    return GAP_NONE


cdef Gap history_gap(const History* history, int64_t time_ns) noexcept nogil:
    cdef uint32_t older, newer
    cdef uint32_t hint = NEWEST_HINT
    return _find_slots(history, time_ns, &hint, &older, &newer)


cdef Gap history_neighbors(const History* history, int64_t time_ns, uint32_t* hint,
                           Neighbors* out) noexcept nogil:
    cdef uint32_t a, b
    cdef Gap gap = _find_slots(history, time_ns, hint, &a, &b)
    if gap != GAP_NONE:
        return gap
    out.older = &history.samples[a].transform
    out.newer = &history.samples[b].transform
    out.older_ns = history.stamps[a]
    out.newer_ns = history.stamps[b]
    return GAP_NONE


cdef Gap history_transform_at(const History* history, int64_t time_ns, uint32_t hint,
                              Transform* out) noexcept nogil:
    cdef Neighbors around
    cdef const Transform* a
    cdef const Transform* b
    cdef double ratio
    cdef Gap gap = history_neighbors(history, time_ns, &hint, &around)
    if gap != GAP_NONE:
        return gap
    a = around.older
    b = around.newer
    if a == b:
        out[0] = a[0]
        return GAP_NONE
    ratio = neighbors_ratio(&around, time_ns)
    out.translation[0] = (1.0 - ratio) * a.translation[0] + ratio * b.translation[0]
    out.translation[1] = (1.0 - ratio) * a.translation[1] + ratio * b.translation[1]
    out.translation[2] = (1.0 - ratio) * a.translation[2] + ratio * b.translation[2]
    quaternion_interpolate(a.rotation, b.rotation, ratio, out.rotation)
    return GAP_NONE


cdef void _extrapolate(const History* history, int64_t time_ns, Transform* out) noexcept nogil:
    # After the newest sample, at the velocity between it and the one before. Without a velocity, it stays.
    cdef const Transform* newest = history_newest_transform(history)
    cdef const Transform* before
    cdef double ratio
    cdef double turned[3]
    cdef int64_t before_ns
    cdef int i
    out[0] = newest[0]
    if not history_has_velocity(history):
        return
    before = history_transform_of(history, history.count - 2)
    before_ns = history_stamp_of(history, history.count - 2)
    ratio = <double>(time_ns - history.newest_ns) / <double>(history.newest_ns - before_ns)
    for i in range(3):
        out.translation[i] += ratio * (newest.translation[i] - before.translation[i])
    rotation_vector_between(before.rotation, newest.rotation, turned)
    quaternion_turn(newest.rotation, turned, ratio, out.rotation)


cdef Gap history_transform_under(const History* history, int64_t time_ns, const Policy* policy,
                                 int64_t tolerance_ns, Transform* out, int64_t* used_ns) noexcept nogil:
    cdef int64_t older_ns, newer_ns
    cdef int64_t found_ns = time_ns
    if history_beyond(history, policy, tolerance_ns, &found_ns) == HOP_EXTRAPOLATED:
        used_ns[0] = time_ns
        _extrapolate(history, time_ns, out)
        return GAP_NONE
    used_ns[0] = found_ns
    if policy.max_gap_ns != INT64_MAX and history_stamps_around(history, found_ns, &older_ns, &newer_ns):
        if newer_ns - older_ns > policy.max_gap_ns:
            return GAP_LONG
    return history_transform_at(history, found_ns, NEWEST_HINT, out)


cdef bint history_stamps_around(const History* history, int64_t time_ns, int64_t* older_ns,
                                int64_t* newer_ns) noexcept nogil:
    # Not by _find_slots, for which the older sample is on both sides where the parent changes.
    cdef uint32_t newer = history_first_after(history, time_ns)
    if newer == 0 or newer == history.count:
        return False
    older_ns[0] = history_stamp_of(history, newer - 1)
    newer_ns[0] = history_stamp_of(history, newer)
    return older_ns[0] != time_ns


cdef FrameId history_parent_at(const History* history, int64_t time_ns) noexcept nogil:
    cdef uint32_t older, newer
    cdef uint32_t hint = NEWEST_HINT
    if _find_slots(history, time_ns, &hint, &older, &newer) != GAP_NONE:
        return NO_FRAME
    return history.samples[older].parent


cdef int64_t history_unchanged_since(const History* history, int64_t time_ns) noexcept nogil:
    cdef FrameId parent
    cdef int64_t stamp_ns
    cdef uint32_t i
    if history.kind == HISTORY_STATIC or history.count == 0 or time_ns < history.oldest_ns:
        return INT64_MIN
    if time_ns > history.newest_ns:
        return history.newest_ns + 1
    if history.parent_changes == 0 or time_ns == history.oldest_ns:
        return history.oldest_ns
    i = history_first_after(history, time_ns) - 1
    parent = history_parent_of(history, i)
    while True:
        # Of equal stamps the last arrival counts, except at the oldest stamp itself, see _find_slots.
        stamp_ns = history_stamp_of(history, i)
        while i > 0 and history_stamp_of(history, i - 1) == stamp_ns:
            i -= 1
        if i == 0:
            return stamp_ns if history_parent_of(history, 0) == parent else stamp_ns + 1
        if history_parent_of(history, i - 1) != parent:
            return stamp_ns
        i -= 1


# Inserting, pruning, replacing.

cdef enum:
    MAX_PER_STAMP = 64      # samples; of more, the last is replaced


cdef inline uint32_t _differ(const History* history, uint32_t index, FrameId parent) noexcept nogil:
    # How many of the neighbors of a sample have another parent.
    cdef uint32_t count = 0
    if index > 0:
        count += history_parent_of(history, index - 1) != parent
    if index + 1 < history.count:
        count += history_parent_of(history, index + 1) != parent
    return count


cdef inline void _clear_change(HistoryChange* change) noexcept nogil:
    change.covered.first = INT64_MAX
    change.covered.last = INT64_MIN
    change.moved = 0
    change.displaced = False


cdef HistoryInsert history_begin(const History* old, HistoryKind kind, uint32_t capacity, size_t growth_limit,
                                 History* fresh) noexcept nogil:
    memset(fresh, 0, sizeof(History))
    fresh.kind = kind
    fresh.authority = old.authority
    fresh.is_parent = old.is_parent
    fresh.is_hidden = old.is_hidden
    fresh.was_unnormalized = old.was_unnormalized
    return _move(fresh, capacity, history_allocated(old) + growth_limit)


cdef void history_append(History* history, int64_t stamp_ns, const Sample* sample) noexcept nogil:
    cdef uint32_t slot = _history_slot(history, history.count)
    history.parent_changes += history.count > 0 and history_newest_parent(history) != sample.parent
    history.stamps[slot] = stamp_ns
    history.samples[slot] = sample[0]
    history.count += 1
    history.newest_ns = stamp_ns
    history.oldest_ns = history.stamps[history.head]


cdef HistoryInsert _change_kind(History* history, HistoryKind kind, uint32_t capacity,
                                size_t growth_limit) noexcept nogil:
    # A frame that changes from dynamic to static or back loses its history, but only when there is memory.
    cdef History fresh
    cdef HistoryInsert outcome = history_begin(history, kind, capacity, growth_limit, &fresh)
    if outcome == HISTORY_INSERTED:
        history_free(history)
        history[0] = fresh
    return outcome


cdef inline void _drop_oldest(History* history, uint32_t dropped) noexcept nogil:
    # Fewer than there are.
    cdef uint32_t i
    for i in range(dropped if history.parent_changes else 0):
        history.parent_changes -= history_parent_of(history, i) != history_parent_of(history, i + 1)
    history.head = _history_slot(history, dropped)
    history.count -= dropped
    history.oldest_ns = history.stamps[history.head]


cdef void _prune(History* history, int64_t horizon_ns) noexcept nogil:
    # Drop all samples older than that, except for the newest one.
    cdef uint32_t pruned
    if history.count < 2 or history.oldest_ns >= horizon_ns:
        return
    pruned = 1      # which is what most inserts leave behind
    if history_stamp_of(history, 1) < horizon_ns:
        pruned = min(history_first_after(history, horizon_ns - 1), history.count - 1)
    _drop_oldest(history, pruned)


cdef HistoryInsert _displace_oldest(History* history, size_t growth_limit) noexcept nogil:
    # Makes room in a full ring that cannot grow. Returns the same as _move.
    cdef HistoryInsert outcome = HISTORY_INSERTED
    if _history_is_pinned(history):
        outcome = _move(history, max(history.capacity, <uint32_t>FIRST_CAPACITY), growth_limit)
    if outcome == HISTORY_INSERTED:
        _drop_oldest(history, 1)
    return outcome


cdef inline bint _same(const Sample* a, const Sample* b) noexcept nogil:
    return (a.parent == b.parent
            and a.transform.translation[0] == b.transform.translation[0]
            and a.transform.translation[1] == b.transform.translation[1]
            and a.transform.translation[2] == b.transform.translation[2]
            and a.transform.rotation[0] == b.transform.rotation[0]
            and a.transform.rotation[1] == b.transform.rotation[1]
            and a.transform.rotation[2] == b.transform.rotation[2]
            and a.transform.rotation[3] == b.transform.rotation[3])


cdef void _make_slot(History* history, uint32_t index) noexcept nogil:
    # Free the slot of `index` by moving the shorter side one slot outwards.
    cdef uint32_t i, source, target
    if index < history.count - index:
        history.head = (history.head if history.head else history.capacity) - 1
        for i in range(index):
            target = _history_slot(history, i)
            source = _history_slot(history, i + 1)
            history.stamps[target] = history.stamps[source]
            history.samples[target] = history.samples[source]
    else:
        i = history.count
        while i > index:
            target = _history_slot(history, i)
            source = _history_slot(history, i - 1)
            history.stamps[target] = history.stamps[source]
            history.samples[target] = history.samples[source]
            i -= 1
    history.count += 1


cdef void _replace_last_of_stamp(History* history, uint32_t index, const Sample* sample) noexcept nogil:
    # Of all samples of one stamp only the first and the last answer, so the others need not be kept.
    cdef Sample* last = &history.samples[_history_slot(history, index)]
    history.parent_changes -= _differ(history, index, last.parent)
    history.parent_changes += _differ(history, index, sample.parent)
    last[0] = sample[0]


cdef HistoryInsert history_insert(History* history, int64_t stamp_ns, const Sample* sample,
                                  const Retention* retention, size_t growth_limit,
                                  HistoryChange* change) noexcept nogil:
    # As in tf2: prune against the newest stamp before this insert, then refuse what is older than that.
    cdef uint32_t index, i, slot
    cdef int64_t horizon_ns
    cdef HistoryInsert outcome = HISTORY_INSERTED
    _clear_change(change)
    if history.kind != HISTORY_DYNAMIC:
        outcome = _change_kind(history, HISTORY_DYNAMIC, FIRST_CAPACITY, growth_limit)
        if outcome != HISTORY_INSERTED:
            return outcome
    horizon_ns = history_horizon(history, retention, history.newest_ns)
    _prune(history, horizon_ns)
    if stamp_ns < horizon_ns:
        return HISTORY_TOO_OLD
    index = history_first_after(history, stamp_ns)
    i = index
    while i > 0:
        slot = _history_slot(history, i - 1)
        if history.stamps[slot] != stamp_ns:
            break
        if _same(&history.samples[slot], sample):
            return HISTORY_DUPLICATE
        i -= 1
    if index - i >= MAX_PER_STAMP:
        if _history_is_pinned(history):
            outcome = _move(history, history.capacity, growth_limit)
        if outcome == HISTORY_INSERTED:
            _replace_last_of_stamp(history, index - 1, sample)
        return outcome
    outcome = _history_reserve_one(history, index == history.count, growth_limit)
    if outcome == HISTORY_FULL and index > 0:
        # The frame stays current. One that is older than all others would itself be the oldest.
        change.displaced = True
        outcome = _displace_oldest(history, growth_limit)
        index -= 1
    if outcome != HISTORY_INSERTED:
        return outcome
    if index == 0 or index == history.count:
        change.covered.first = history.newest_ns if index else stamp_ns
        change.covered.last = stamp_ns if index or history.count == 0 else history.oldest_ns
    if index > 0 and index < history.count:
        # These two are no longer neighbors.
        history.parent_changes -= history_parent_of(history, index - 1) != history_parent_of(history, index)
    change.moved = min(index, history.count - index)
    _make_slot(history, index)
    slot = _history_slot(history, index)
    history.stamps[slot] = stamp_ns
    history.samples[slot] = sample[0]
    history.parent_changes += _differ(history, index, sample.parent)
    history.newest_ns = history_stamp_of(history, history.count - 1)
    history.oldest_ns = history.stamps[history.head]
    _history_shrink(history)
    # Where the next sample goes: that memory has not been used for the whole cache time.
    __builtin_prefetch(&history.samples[_history_slot(history, history.count)])
    return HISTORY_INSERTED


cdef HistoryInsert history_set_static(History* history, int64_t stamp_ns, const Sample* sample,
                                      size_t growth_limit, HistoryChange* change) noexcept nogil:
    cdef HistoryInsert outcome = HISTORY_INSERTED
    cdef bint was_static = history.kind == HISTORY_STATIC
    _clear_change(change)
    if not was_static:
        outcome = _change_kind(history, HISTORY_STATIC, 1, growth_limit)
    elif _history_is_pinned(history):
        outcome = _move(history, 1, growth_limit)
    if outcome != HISTORY_INSERTED:
        return outcome
    if not was_static or memcmp(&history.samples[0], sample, sizeof(Sample)) != 0:
        change.covered.first = INT64_MIN
        change.covered.last = INT64_MAX
    history.count = 1
    history.stamps[0] = stamp_ns
    history.samples[0] = sample[0]
    return HISTORY_INSERTED


cdef const char* _transform_check(const Transform* transform) noexcept nogil:
    cdef const double* t = transform.translation
    cdef const double* q = transform.rotation
    if not (isfinite(t[0]) and isfinite(t[1]) and isfinite(t[2])):
        return "its translation is not finite"
    # Not "> 1e-12": that is false for NaN.
    if not fabs(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3] - 1.0) <= 1e-12:
        return "its rotation is not normalized"
    if quaternion_lead(q) < 0.0:
        return "its rotation has the wrong sign"
    return NULL


cdef const char* history_check(const History* history, uint32_t* where) noexcept nogil:
    cdef uint32_t i, slot
    cdef uint32_t previous = 0
    cdef uint32_t changes = 0
    cdef uint32_t same_stamp = 1
    cdef const char* problem
    where[0] = history.count
    if history.count > history.capacity or (history.capacity and history.head >= history.capacity):
        return "count or head beyond capacity"
    if history.kind == HISTORY_NONE and history.capacity:
        return "a frame that was never a child owns memory"
    # A smaller one would not grow by half.
    if (history.kind == HISTORY_DYNAMIC and history.capacity and history.capacity < FIRST_CAPACITY
            and not _is_mapped(history)):
        return "a dynamic history of less than the first capacity"
    if history.kind == HISTORY_STATIC and (history.count != 1 or history.newest_ns != 0):
        return "its static record is inconsistent"
    for i in range(history.count):
        where[0] = i
        slot = _history_slot(history, i)
        if history.stamps[slot] < 0 or history.stamps[slot] > MAX_STAMP_NS:
            return "its stamp does not fit into a message"
        if history.samples[slot].parent == NO_FRAME:
            return "it has no parent"
        problem = _transform_check(&history.samples[slot].transform)
        if problem != NULL:
            return problem
        if i:
            if history.stamps[previous] > history.stamps[slot]:
                return "its stamp is less than the stamp before it"
            same_stamp = same_stamp + 1 if history.stamps[previous] == history.stamps[slot] else 1
            if same_stamp > MAX_PER_STAMP:
                return "too many samples of one stamp"
            changes += history.samples[previous].parent != history.samples[slot].parent
        previous = slot
    where[0] = history.count
    if changes != history.parent_changes:
        return "its parent changes are miscounted"
    if history.kind == HISTORY_DYNAMIC and history.count:
        if history.newest_ns != history_stamp_of(history, history.count - 1):
            return "newest_ns is not the newest stamp"
        if history.oldest_ns != history.stamps[history.head]:
            return "oldest_ns is not the oldest stamp"
    elif history.newest_ns != 0 or history.oldest_ns != 0:
        return "a stamp without a sample"
    return NULL


# Copying into flat arrays.

cdef inline void _export_run(const History* history, uint32_t slot, uint32_t count, int64_t* stamps,
                             double* transforms, uint32_t* parents) noexcept nogil:
    # Samples that lie in one piece.
    cdef const Sample* sample = history.samples + slot
    cdef uint32_t i
    memcpy(stamps, history.stamps + slot, count * sizeof(int64_t))
    for i in range(count):
        memcpy(transforms + <size_t>i * TRANSFORM_DOUBLES, &sample[i].transform, sizeof(Transform))
        parents[i] = sample[i].parent


cdef void history_export(const History* history, int64_t* stamps, double* transforms,
                         uint32_t* parents) noexcept nogil:
    cdef uint32_t first = min(history.count, history.capacity - history.head)
    if history.count == 0:
        return
    _export_run(history, history.head, first, stamps, transforms, parents)
    _export_run(history, 0, history.count - first, stamps + first,
                transforms + <size_t>first * TRANSFORM_DOUBLES, parents + first)


cdef void history_copy_stamps(const History* history, uint32_t first, uint32_t count,
                              int64_t* stamps) noexcept nogil:
    cdef uint32_t slot = _history_slot(history, first)
    cdef uint32_t to_the_end = min(count, history.capacity - slot)
    memcpy(stamps, history.stamps + slot, to_the_end * sizeof(int64_t))
    memcpy(stamps + to_the_end, history.stamps, (count - to_the_end) * sizeof(int64_t))


cdef void history_copy_samples(const History* history, uint32_t first, uint32_t count,
                               Sample* samples) noexcept nogil:
    cdef uint32_t slot = _history_slot(history, first)
    cdef uint32_t to_the_end = min(count, history.capacity - slot)
    memcpy(samples, history.samples + slot, to_the_end * sizeof(Sample))
    memcpy(samples + to_the_end, history.samples, (count - to_the_end) * sizeof(Sample))
