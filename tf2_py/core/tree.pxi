# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The tree of frames: insert transforms, and find the parents of frames."""

cdef enum:
    # Each of these costs as much time as inserting one transform.
    SAMPLES_PER_INSERT = 128        # samples moved or read
    NAME_BYTES_PER_INSERT = 256     # bytes of names hashed

cdef const char* RESERVED_NAME = "NO_PARENT"
cdef size_t RESERVED_NAME_SIZE = 9
cdef const char* TOO_MANY_AUTHORITIES = "(too many authorities)"
cdef size_t TOO_MANY_AUTHORITIES_SIZE = 22


cdef int tree_init(Tree* tree, const Retention* retention, const Limits* limits) noexcept nogil:
    cdef uint32_t refused = 0
    tree.retention = retention[0]
    tree.limits = limits[0]
    if names_init(&tree.names) != 0 or names_init(&tree.authorities) != 0:
        return -1
    # This authority and the reserved frame have the id 0.
    if names_intern(&tree.authorities, TOO_MANY_AUTHORITIES, TOO_MANY_AUTHORITIES_SIZE) == NAME_NO_MEMORY:
        return -1
    _add_frame(tree, RESERVED_NAME, RESERVED_NAME_SIZE, NULL, &refused)
    return -1 if refused else 0


cdef uint32_t tree_authority(Tree* tree, const char* name, size_t size) noexcept nogil:
    cdef uint32_t id = names_find(&tree.authorities, name, size)
    if id != NAME_UNKNOWN:
        return id
    if (tree.authorities.count > tree.limits.frames
            or names_growth(&tree.authorities, size) > tree_bytes_left(tree)):
        return 0
    return names_intern(&tree.authorities, name, size)


cdef void tree_free(Tree* tree) noexcept nogil:
    cdef uint32_t id
    for id in range(tree.names.count if tree.histories != NULL else 0):
        history_free(&tree.histories[id])
    free(tree.histories)
    free(tree.parents)
    names_free(&tree.names)
    names_free(&tree.authorities)


cdef FrameId tree_frame(const Tree* tree, const char* name, size_t size) noexcept nogil:
    cdef uint32_t id = names_find(&tree.names, name, size)
    return NO_FRAME if id == NAME_UNKNOWN or tree.histories[id].is_hidden else id


cdef inline uint32_t _capacity_for_another(const Tree* tree) noexcept nogil:
    if tree.names.count < tree.capacity:
        return tree.capacity
    return tree.capacity * 2 if tree.capacity else 32


cdef inline size_t _growth(const Tree* tree) noexcept nogil:
    # By how many bytes the arrays grow if another frame is added.
    return (_capacity_for_another(tree) - tree.capacity) * (sizeof(History) + sizeof(uint32_t))


cdef FrameId _add_frame(Tree* tree, const char* name, size_t size, Change* change,
                        uint32_t* refused) noexcept nogil:
    # A new frame, whose name must be unknown, regardless of the limits. NO_FRAME: it failed, see `refused`.
    # `change` may be NULL.
    cdef uint32_t id
    cdef uint32_t capacity = _capacity_for_another(tree)
    cdef void* grown
    if capacity > tree.capacity:
        grown = realloc(tree.histories, capacity * sizeof(History))
        if grown != NULL:
            tree.histories = <History*>grown
            grown = realloc(tree.parents, capacity * sizeof(uint32_t))
        if grown == NULL:
            refused[0] = TREE_NO_MEMORY
            return NO_FRAME
        tree.parents = <uint32_t*>grown
        tree.capacity = capacity
    id = names_intern(&tree.names, name, size)
    if id == NAME_NO_MEMORY:
        refused[0] = TREE_NO_MEMORY
        return NO_FRAME
    if change != NULL:
        change.shape = True
    memset(&tree.histories[id], 0, sizeof(History))
    tree.histories[id].authority = NAME_UNKNOWN
    tree.parents[id] = NO_FRAME
    return id


cdef FrameId tree_add_frame(Tree* tree, const char* name, size_t size) noexcept nogil:
    cdef uint32_t refused = 0
    return _add_frame(tree, name, size, NULL, &refused)


cdef void tree_put_history(Tree* tree, FrameId frame, const History* history, FrameId parent) noexcept nogil:
    tree.histories[frame] = history[0]
    tree.parents[frame] = parent | (MIXED_PARENTS if history.parent_changes else 0)
    tree.samples += history.count
    tree.history_bytes += history_allocated(history)


cdef FrameId tree_intern_frame(Tree* tree, const char* name, size_t size, FrameId guess, Change* change,
                               uint32_t* refused) noexcept nogil:
    cdef uint32_t id = names_find_guessed(&tree.names, name, size, guess)
    if id != NAME_UNKNOWN:
        return id
    # The reserved name is not counted.
    if tree.names.count > tree.limits.frames:
        refused[0] = REFUSED_FRAMES
    elif names_growth(&tree.names, size) + _growth(tree) > tree_bytes_left(tree):
        refused[0] = REFUSED_BYTES
    else:
        return _add_frame(tree, name, size, change, refused)
    return NO_FRAME


cdef inline bint _is_reserved(const char* name, size_t size) noexcept nogil:
    return size == RESERVED_NAME_SIZE and memcmp(name, RESERVED_NAME, RESERVED_NAME_SIZE) == 0


cdef uint32_t incoming_refusals(Incoming* incoming) noexcept nogil:
    cdef double* t = incoming.transform.translation
    cdef double* q = incoming.transform.rotation
    cdef uint32_t refused = 0
    name_strip(&incoming.parent, &incoming.parent_size)
    name_strip(&incoming.child, &incoming.child_size)
    if incoming.parent_size == incoming.child_size \
            and memcmp(incoming.parent, incoming.child, incoming.child_size) == 0:
        refused |= REFUSED_SELF_TRANSFORM
    if incoming.parent_size == 0:
        refused |= REFUSED_NO_PARENT
    if incoming.child_size == 0:
        refused |= REFUSED_NO_CHILD
    if _is_reserved(incoming.parent, incoming.parent_size) \
            or _is_reserved(incoming.child, incoming.child_size):
        refused |= REFUSED_RESERVED_NAME
    if isnan(t[0]) or isnan(t[1]) or isnan(t[2]) or isnan(q[0]) or isnan(q[1]) or isnan(q[2]) or isnan(q[3]):
        refused |= REFUSED_NAN
    elif not (isfinite(t[0]) and isfinite(t[1]) and isfinite(t[2])):
        refused |= REFUSED_INFINITE
    if incoming.stamp_ns < 0:
        refused |= REFUSED_NEGATIVE_STAMP
    elif incoming.stamp_ns > MAX_STAMP_NS:
        refused |= REFUSED_STAMP_TOO_LATE
    if quaternion_normalize_once(q, &incoming.squared_length):
        quaternion_canonicalize(q)
    else:
        refused |= REFUSED_QUATERNION
    return refused


cdef uint32_t tree_insert(Tree* tree, Incoming* incoming, uint32_t authority, bint is_static,
                          Change* change) noexcept nogil:
    cdef uint32_t refused = incoming_refusals(incoming)
    cdef FrameId child = NO_FRAME
    cdef FrameId parent = NO_FRAME
    cdef uint32_t known = tree.names.count
    cdef uint32_t bit
    tree.work += (incoming.child_size + incoming.parent_size) // NAME_BYTES_PER_INSERT
    if change != NULL:
        change_begin(change, False)
    # As in tf2: the child gets its id first, and both keep theirs even if the sample is too old. A message
    # names its children in the same order as the first time, and nearly every child keeps its parent.
    if refused == 0:
        child = tree_intern_frame(tree, incoming.child, incoming.child_size, tree.last_child + 1, change,
                                  &refused)
    if refused == 0:
        parent = tree_intern_frame(tree, incoming.parent, incoming.parent_size,
                                   tree_newest_parent(tree, child), change, &refused)
    if refused == 0:
        tree.last_child = child
        refused = _insert(tree, child, parent, incoming, authority, is_static, change)
    if refused == TREE_NO_MEMORY:
        # No other thread has seen them.
        names_drop(&tree.names, known)
        return refused
    tree_unhide(tree, child, change)
    tree_unhide(tree, parent, change)
    for bit in range(<uint32_t>REFUSAL_KINDS if refused else 0):
        tree.refused[bit] += (refused >> bit) & 1
    return refused


cdef uint32_t _insert(Tree* tree, FrameId child, FrameId parent, const Incoming* incoming, uint32_t authority,
                      bint is_static, Change* change) noexcept nogil:
    # As tree_insert, once the names have their ids.
    cdef History* history = &tree.histories[child]
    cdef Sample sample
    cdef HistoryInsert outcome
    cdef HistoryChange changed
    cdef uint32_t before = tree.parents[child]
    cdef uint32_t count = history.count
    cdef size_t bytes_before = history_allocated(history)
    cdef size_t growth_limit = tree_bytes_left(tree)
    tree.equals_file = False    # a repeated sample, too, has another authority, and prunes
    sample.transform = incoming.transform
    sample.parent = parent
    sample.reserved = 0
    if is_static:
        outcome = history_set_static(history, incoming.stamp_ns, &sample, growth_limit, &changed)
    else:
        outcome = history_insert(history, incoming.stamp_ns, &sample, &tree.retention, growth_limit, &changed)
    tree.samples += history.count - <uint64_t>count
    tree.history_bytes += history_allocated(history) - bytes_before
    # In any case, the history may have been pruned.
    tree.parents[child] = history_newest_parent(history) | (MIXED_PARENTS if history.parent_changes else 0)
    if outcome == HISTORY_INSERTED or outcome == HISTORY_DUPLICATE:
        tree.displaced += changed.displaced
        tree.histories[parent].is_parent = True
        history.authority = authority
        tree.taken += 1
    tree.work += changed.moved // SAMPLES_PER_INSERT
    if change != NULL:
        change.frame = child
        change.covered = changed.covered
        change.horizon_ns = history_horizon(history, &tree.retention, history.newest_ns)
        change.shape = change.shape or before != tree.parents[child] or before & MIXED_PARENTS != 0
    if outcome == HISTORY_TOO_OLD:
        return REFUSED_OLD
    if outcome == HISTORY_FULL:
        return REFUSED_BYTES
    return TREE_NO_MEMORY if outcome == HISTORY_NO_MEMORY else 0


cdef bint tree_mark_unnormalized(Tree* tree) noexcept nogil:
    cdef History* history = &tree.histories[tree.last_child]
    cdef bint is_new = not history.was_unnormalized
    history.was_unnormalized = True
    return is_new


cdef bint tree_has_one_way_up(const Tree* tree, FrameId frame) noexcept nogil:
    cdef uint32_t hops
    for hops in range(MAX_HOPS + 1):
        if frame == NO_FRAME:
            return True
        if tree.parents[frame] & MIXED_PARENTS:
            return False
        frame = tree.parents[frame]
    return False


cdef void tree_clear(Tree* tree) noexcept nogil:
    cdef uint32_t id
    tree.equals_file = False
    for id in range(1, tree.names.count):
        if tree.histories[id].kind == HISTORY_DYNAMIC:
            tree.samples -= tree.histories[id].count
            tree.history_bytes -= history_allocated(&tree.histories[id])
            history_clear(&tree.histories[id])
            tree.history_bytes += history_allocated(&tree.histories[id])
            tree.parents[id] = NO_FRAME


cdef void _hide_isolated(Tree* tree) noexcept nogil:
    # Without hiding, is_parent may stay set for a frame that is no longer a parent.
    cdef const History* history
    cdef FrameId id
    cdef uint32_t i
    for id in range(tree.names.count):
        tree.histories[id].is_parent = False
    for id in range(tree.names.count):
        history = &tree.histories[id]
        for i in range(tree_links(history)):
            tree.histories[history_parent_of(history, i)].is_parent = True
    for id in range(1, tree.names.count):
        history = &tree.histories[id]
        if history.kind == HISTORY_NONE and not history.is_parent and not history.is_hidden:
            tree.histories[id].is_hidden = True
            tree.hidden += 1


cdef bint tree_forget(Tree* tree, FrameId frame) noexcept nogil:
    cdef History* history = &tree.histories[frame]
    cdef bint had_samples = history.count > 0
    tree.equals_file = False
    tree.samples -= history.count
    tree.history_bytes -= history_allocated(history)
    history_free(history)
    tree.parents[frame] = NO_FRAME
    _hide_isolated(tree)
    return had_samples


cdef void _pin_frame(const Tree* tree, FrameId frame, unsigned char* seen, PinnedTree* pinned) noexcept nogil:
    if seen[frame >> 3] >> (frame & 7) & 1:
        return
    seen[frame >> 3] |= 1 << (frame & 7)
    history_pin(&tree.histories[frame], &pinned.view.histories[frame])
    pinned.view.parents[frame] = tree.parents[frame]
    pinned.view.names.names[frame] = tree.names.names[frame]
    pinned.view.names.text_size += tree.names.names[frame].size
    pinned.frames[pinned.count] = frame
    pinned.count += 1


cdef void _pin_parents(const Tree* tree, FrameId frame, unsigned char* seen,
                       PinnedTree* pinned) noexcept nogil:
    # Newest first, until all changes of the parent are found.
    cdef const History* history = &tree.histories[frame]
    cdef uint32_t changes = history.parent_changes
    cdef uint32_t i = history.count
    cdef FrameId parent = history_newest_parent(history)
    _pin_frame(tree, parent, seen, pinned)
    while changes:
        i -= 1
        if history_parent_of(history, i) != parent:
            parent = history_parent_of(history, i)
            _pin_frame(tree, parent, seen, pinned)
            changes -= 1


cdef int _pin_names(const Tree* tree, PinnedTree* pinned) noexcept nogil:
    # A copy of their text, which moves as the tree grows. -1: no memory.
    cdef Name* name
    cdef size_t start = 0
    cdef uint32_t i
    pinned.view.names.text = <char*>malloc(pinned.view.names.text_size)
    if pinned.view.names.text == NULL:
        return -1
    for i in range(pinned.count):
        name = &pinned.view.names.names[pinned.frames[i]]
        memcpy(pinned.view.names.text + start, tree.names.text + name.start, name.size)
        name.start = start
        start += name.size
    return 0


cdef int tree_pin_above(const Tree* tree, const FrameId* frames, uint32_t count,
                        PinnedTree* pinned) noexcept nogil:
    # Of the large arrays only the elements of pinned frames are written, so that this costs little where a
    # tree has many others. NO_FRAME is pinned as the parent of a root.
    cdef unsigned char* seen = <unsigned char*>calloc(tree.names.count // 8 + 1, 1)
    cdef uint32_t i
    memset(pinned, 0, sizeof(PinnedTree))
    pinned.view.histories = <History*>malloc(tree.names.count * sizeof(History))
    pinned.view.parents = <uint32_t*>malloc(tree.names.count * sizeof(uint32_t))
    pinned.view.names.names = <Name*>malloc(tree.names.count * sizeof(Name))
    pinned.frames = <FrameId*>malloc(tree.names.count * sizeof(FrameId))
    if (seen == NULL or pinned.view.histories == NULL or pinned.view.parents == NULL
            or pinned.view.names.names == NULL or pinned.frames == NULL):
        free(seen)
        tree_unpin(pinned)
        return -1
    for i in range(count):
        _pin_frame(tree, frames[i], seen, pinned)
    i = 0
    while i < pinned.count:     # which grows meanwhile
        _pin_parents(tree, pinned.frames[i], seen, pinned)
        i += 1
    free(seen)
    if _pin_names(tree, pinned) != 0:
        tree_unpin(pinned)
        return -1
    return 0


cdef void tree_unpin(PinnedTree* pinned) noexcept nogil:
    cdef uint32_t i
    for i in range(pinned.count):
        history_unpin(&pinned.view.histories[pinned.frames[i]])
    free(pinned.view.histories)
    free(pinned.view.parents)
    names_free(&pinned.view.names)
    free(pinned.frames)


cdef const char* _check_parents(const Tree* tree, FrameId frame, uint32_t* where) noexcept nogil:
    cdef const History* history = &tree.histories[frame]
    cdef FrameId parent
    cdef uint32_t i
    for i in range(tree_links(history)):
        where[0] = i
        parent = history_parent_of(history, i)
        if parent >= tree.names.count:
            return "its parent is not a frame"
        if parent == frame:
            return "the frame is its own parent"
        if not tree.histories[parent].is_parent:
            return "its parent is not marked as one"
        if tree.histories[parent].is_hidden:
            return "a parent that is hidden"
    return NULL


cdef const char* tree_check_frame(const Tree* tree, FrameId frame, uint32_t* where) noexcept nogil:
    cdef const History* history = &tree.histories[frame]
    cdef const char* problem = history_check(history, where)
    cdef uint32_t expected
    if problem != NULL:
        return problem
    expected = history_newest_parent(history) | (MIXED_PARENTS if history.parent_changes else 0)
    if history.is_hidden and history.kind != HISTORY_NONE:
        return "a hidden frame that has samples"
    if tree.parents[frame] != expected:
        return "its parent differs from its newest sample"
    if history.authority != NAME_UNKNOWN and history.authority >= tree.authorities.count:
        return "an authority that is not a name"
    return _check_parents(tree, frame, where)


cdef const char* tree_check(const Tree* tree) noexcept nogil:
    cdef uint32_t id, where
    cdef uint64_t samples = 0
    cdef size_t history_bytes = 0
    cdef uint32_t hidden = 0
    cdef const char* problem
    if tree.names.count == 0 or tree.names.count > tree.capacity:
        return "frame count beyond capacity"
    problem = names_check(&tree.names)
    if problem == NULL:
        problem = names_check(&tree.authorities)
    if problem != NULL:
        return problem
    if tree.histories[0].kind != HISTORY_NONE:
        return "the reserved frame has a history"
    for id in range(tree.names.count):
        problem = tree_check_frame(tree, id, &where)
        if problem != NULL:
            return problem
        hidden += tree.histories[id].is_hidden
        samples += tree.histories[id].count
        history_bytes += history_allocated(&tree.histories[id])
    if samples != tree.samples or history_bytes != tree.history_bytes:
        return "samples or their bytes miscounted"
    if hidden != tree.hidden:
        return "hidden frames miscounted"
    if tree.displaced > tree.taken or samples > tree.taken - tree.displaced:
        return "more samples, held and displaced, than were accepted"
    return NULL
