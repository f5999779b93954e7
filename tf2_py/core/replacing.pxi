# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Replace samples of several frames at once: sort what is given, build the new histories, exchange them."""

# Sorting.

cdef int _compare_given(const void* a, const void* b) noexcept nogil:
    cdef const Given* first = <const Given*>a
    cdef const Given* second = <const Given*>b
    if first.which != second.which:
        return 1 if first.which > second.which else -1
    if first.stamp_ns != second.stamp_ns:
        return 1 if first.stamp_ns > second.stamp_ns else -1
    return (first.entry > second.entry) - (first.entry < second.entry)


cdef int _sort(Replacing* replacing, Batch* batch, Names* children) noexcept nogil:
    # Fills `given`; `children` gets the names of the frames in their order. -1: no memory.
    cdef Incoming* incoming
    cdef Given* one
    cdef bint is_sorted = True      # as most callers have them
    cdef uint32_t which = 0
    cdef size_t i
    for i in range(batch.count):
        incoming = &batch.entries[i].incoming
        batch.entries[i].refused = incoming_refusals(incoming)
        batch.entries[i].unnormalized = False
        which = names_find_guessed(children, incoming.child, incoming.child_size, which)
        if which == NAME_UNKNOWN:
            which = names_intern(children, incoming.child, incoming.child_size)
        if which == NAME_NO_MEMORY:
            return -1
        one = &replacing.given[i]
        one.which = which
        one.stamp_ns = 0 if batch.is_static else incoming.stamp_ns
        one.entry = i
        one.parent = NO_FRAME
        is_sorted = is_sorted and (i == 0 or _compare_given(one - 1, one) < 0)
    if not is_sorted:
        qsort(replacing.given, batch.count, sizeof(Given), _compare_given)
    return 0


cdef int _group(Replacing* replacing, const Batch* batch, uint32_t count) noexcept nogil:
    # Fills `frames`, which has `count` entries. -1: no memory.
    cdef Replacement* one
    cdef size_t i
    replacing.frames = <Replacement*>calloc(count, sizeof(Replacement))
    if replacing.frames == NULL:
        return -1
    replacing.count = count
    for i in range(batch.count):
        one = &replacing.frames[replacing.given[i].which]
        if one.end == 0:
            one.first = i
        one.end = i + 1
        if batch.entries[replacing.given[i].entry].refused:
            one.is_refused = True
    return 0


cdef int replacing_begin(Replacing* replacing, Batch* batch) noexcept nogil:
    cdef Names children
    cdef int problem = -1
    memset(replacing, 0, sizeof(Replacing))
    memset(&children, 0, sizeof(Names))
    replacing.given = <Given*>malloc(batch.count * sizeof(Given))
    if replacing.given != NULL and names_init(&children) == 0:
        problem = _sort(replacing, batch, &children)
    if problem == 0:
        problem = _group(replacing, batch, children.count)
    names_free(&children)
    return problem


cdef void replacing_free(Replacing* replacing) noexcept nogil:
    cdef uint32_t i
    for i in range(replacing.count):
        history_free(&replacing.frames[i].history)
    free(replacing.frames)
    free(replacing.given)


# Building what each frame becomes.

cdef uint32_t _intern_names(Replacing* replacing, Replacement* one, Tree* tree,
                            const Batch* batch) noexcept nogil:
    # Gives ids to the frame and its parents. 0, or why not, as of tree_insert.
    cdef const Incoming* incoming = &batch.entries[replacing.given[one.first].entry].incoming
    cdef uint32_t known = names_find(&tree.names, incoming.child, incoming.child_size)
    cdef FrameId parent
    cdef uint32_t refused = 0
    cdef size_t i
    if (known != NAME_UNKNOWN and tree.histories[known].count
            and (tree.histories[known].kind == HISTORY_STATIC) != batch.is_static):
        return REFUSED_KIND
    one.frame = tree_intern_frame(tree, incoming.child, incoming.child_size, tree.last_child + 1, NULL,
                                  &refused)
    parent = tree_newest_parent(tree, one.frame)
    for i in range(one.first, one.end if refused == 0 else one.first):
        incoming = &batch.entries[replacing.given[i].entry].incoming
        parent = tree_intern_frame(tree, incoming.parent, incoming.parent_size, parent, NULL, &refused)
        replacing.given[i].parent = parent
        if refused:
            break
    return refused


cdef inline bint _counts(const Replacing* replacing, const Replacement* one, size_t i) noexcept nogil:
    # Whether it is the last one of its stamp.
    return i + 1 == one.end or replacing.given[i + 1].stamp_ns != replacing.given[i].stamp_ns


cdef Sample _sample_of(const Given* given, const Batch* batch) noexcept nogil:
    cdef Sample sample
    sample.transform = batch.entries[given.entry].incoming.transform
    sample.parent = given.parent
    sample.reserved = 0
    return sample


cdef uint32_t _refuse_old(Replacing* replacing, Replacement* one, Batch* batch,
                          int64_t horizon_ns) noexcept nogil:
    # Marks the transforms that are older than that, which come first. 0, or why the others are refused then.
    cdef size_t i = one.first
    while i < one.end and replacing.given[i].stamp_ns < horizon_ns:
        batch.entries[replacing.given[i].entry].refused = REFUSED_OLD
        i += 1
    return REFUSED_TOGETHER if i > one.first else 0


cdef HistoryInsert _build_static(Replacing* replacing, Replacement* one, const History* old,
                                 const Batch* batch, size_t growth_limit) noexcept nogil:
    cdef const Given* last = &replacing.given[one.end - 1]
    cdef Sample sample = _sample_of(last, batch)
    cdef HistoryChange not_needed
    cdef HistoryInsert outcome = history_begin(old, HISTORY_STATIC, 1, growth_limit, &one.history)
    if outcome == HISTORY_INSERTED:
        outcome = history_set_static(
            &one.history, batch.entries[last.entry].incoming.stamp_ns, &sample, 0, &not_needed)
    return outcome


cdef HistoryInsert _build_dynamic(Replacing* replacing, Replacement* one, const History* old,
                                  const Batch* batch, int64_t horizon_ns, size_t growth_limit) noexcept nogil:
    # The old samples from `oldest` on and before `first`, and those from `after` on remain; but where memory
    # ends, the oldest of all make room, in a frame that has some.
    cdef const Given* given = replacing.given
    cdef uint32_t oldest = history_first_after(old, horizon_ns - 1)
    cdef uint32_t first = history_first_after(old, given[one.first].stamp_ns - 1)
    cdef uint32_t after = history_first_after(old, given[one.end - 1].stamp_ns)
    cdef size_t needed = first - oldest + (old.count - after)
    cdef HistoryInsert outcome
    cdef Sample sample
    # Not less than before, so that the next inserts need not move them again.
    cdef uint32_t least = max(old.capacity, <uint32_t>FIRST_CAPACITY)
    cdef uint32_t index, capacity
    cdef uint64_t skipped
    cdef size_t i
    for i in range(one.first, one.end):
        needed += _counts(replacing, one, i)
    if needed > LAST_CAPACITY:
        return HISTORY_FULL
    capacity = max(<uint32_t>needed, least)
    outcome = history_begin(old, HISTORY_DYNAMIC, capacity, growth_limit, &one.history)
    while outcome == HISTORY_FULL and old.count and capacity > least:
        capacity = max(capacity // 2, least)
        outcome = history_begin(old, HISTORY_DYNAMIC, capacity, growth_limit, &one.history)
    if outcome != HISTORY_INSERTED:
        return outcome
    skipped = one.displaced = needed - capacity if needed > capacity else 0
    for index in range(oldest, first):
        if skipped:
            skipped -= 1
        else:
            history_append(&one.history, history_stamp_of(old, index), history_sample_of(old, index))
    for i in range(one.first, one.end):
        if not _counts(replacing, one, i):
            continue
        if skipped:
            skipped -= 1
        else:
            sample = _sample_of(&given[i], batch)
            history_append(&one.history, given[i].stamp_ns, &sample)
    for index in range(after + <uint32_t>skipped, old.count):
        history_append(&one.history, history_stamp_of(old, index), history_sample_of(old, index))
    return HISTORY_INSERTED


cdef uint32_t _build(Replacing* replacing, Replacement* one, Tree* tree, Batch* batch) noexcept nogil:
    # 0, or why not, as of tree_insert.
    cdef uint32_t refused = _intern_names(replacing, one, tree, batch)
    cdef const History* old = &tree.histories[one.frame]
    cdef size_t growth_limit = tree_bytes_left(tree)
    cdef int64_t newest_ns, horizon_ns, growth
    cdef HistoryInsert outcome
    if refused:
        return refused
    if batch.is_static:
        outcome = _build_static(replacing, one, old, batch, growth_limit)
    else:
        newest_ns = max(replacing.given[one.end - 1].stamp_ns, old.newest_ns)
        horizon_ns = retention_horizon(&tree.retention, newest_ns)
        refused = _refuse_old(replacing, one, batch, horizon_ns)
        if refused:
            return refused
        outcome = _build_dynamic(replacing, one, old, batch, horizon_ns, growth_limit)
    if outcome == HISTORY_NO_MEMORY:
        return TREE_NO_MEMORY
    if outcome == HISTORY_FULL:
        return REFUSED_BYTES
    one.is_built = True
    # At once, so that the names and histories of the other frames share what is left of the limit.
    growth = <int64_t>history_allocated(&one.history) - <int64_t>history_allocated(old)
    tree.history_bytes += growth
    replacing.growth += growth
    return 0


# Exchanging them.

cdef void _exchange(Replacement* one, Tree* tree, uint32_t authority) noexcept nogil:
    cdef History* history = &tree.histories[one.frame]
    cdef History old = history[0]
    history[0] = one.history
    one.history = old
    history.authority = authority
    tree.samples += history.count - <uint64_t>old.count
    tree.displaced += one.displaced
    tree.parents[one.frame] = history_newest_parent(history)
    if history.parent_changes:
        tree.parents[one.frame] |= MIXED_PARENTS


cdef void _settle(Replacing* replacing, Replacement* one, Tree* tree, Batch* batch) noexcept nogil:
    # The outcome of each transform, and what the tree knows of their frames. After all are exchanged.
    cdef History* history = &tree.histories[one.frame]
    cdef Entry* entry
    cdef FrameId parent
    cdef uint32_t bit
    cdef size_t i
    for i in range(one.first, one.end):
        entry = &batch.entries[replacing.given[i].entry]
        parent = replacing.given[i].parent
        tree_unhide(tree, parent, NULL)
        if one.is_refused:
            entry.refused = entry.refused or REFUSED_TOGETHER
            for bit in range(REFUSAL_KINDS):
                tree.refused[bit] += (entry.refused >> bit) & 1
            batch.refused += 1
            continue
        tree.histories[parent].is_parent = True
        tree.taken += 1
        batch.taken += 1
        if is_unnormalized(entry.incoming.squared_length) and not history.was_unnormalized:
            entry.unnormalized = history.was_unnormalized = True
            batch.unnormalized += 1
    tree_unhide(tree, one.frame, NULL)


cdef bint replacing_apply(Replacing* replacing, Tree* tree, Batch* batch, uint32_t authority) noexcept nogil:
    cdef Replacement* one
    cdef Entry* entry
    cdef uint32_t known = tree.names.count
    cdef uint32_t refused, i
    cdef size_t k
    for i in range(replacing.count):
        one = &replacing.frames[i]
        if one.is_refused:
            continue
        refused = _build(replacing, one, tree, batch)
        if refused == TREE_NO_MEMORY:
            names_drop(&tree.names, known)
            tree.history_bytes -= replacing.growth
            return False
        if refused:
            one.is_refused = True
            for k in range(one.first, one.end):
                entry = &batch.entries[replacing.given[k].entry]
                entry.refused = entry.refused or refused
    for i in range(replacing.count):
        one = &replacing.frames[i]
        if one.frame != NO_FRAME:
            tree.equals_file = False
        if one.is_built:
            _exchange(one, tree, authority)
    for i in range(replacing.count):
        _settle(replacing, &replacing.frames[i], tree, batch)
    return True
