# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Copy the content of a tree: as Python objects for listings, as one state for pickles."""

# Each takes the lock to copy what it needs, and makes Python objects while the lock is free. `names` and
# `authorities`: those of the tree that are known so far.

cdef Limits NO_LIMITS
NO_LIMITS.frames = UINT32_MAX
NO_LIMITS.bytes = SIZE_MAX
cdef Retention KEEP_ALL
KEEP_ALL.cache_time_ns = INT64_MAX

cdef int learn_names(const Names* names, Lock* lock, list known) except -1:
    # Appends the names that `known` lacks, in the order of their ids.
    cdef uint32_t first = len(known)
    cdef uint32_t count, i
    cdef size_t start, size
    cdef uint32_t* sizes = NULL
    cdef char* text = NULL
    lock_acquire(lock)
    count = names.count - min(first, names.count)
    if count:
        start = names.names[first].start
        size = names.names[names.count - 1].start + names.names[names.count - 1].size - start
        text = <char*>malloc(size + 1)
        sizes = <uint32_t*>malloc(count * sizeof(uint32_t))
    if text != NULL and sizes != NULL:
        memcpy(text, names.text + start, size)
        for i in range(count):
            sizes[i] = names.names[first + i].size
    lock_release(lock)
    try:
        if count and (text == NULL or sizes == NULL):
            raise MemoryError
        start = 0
        for i in range(count):
            name = text[start:start + sizes[i]].decode("utf-8")
            start += sizes[i]
            # Another thread may have added it meanwhile.
            if <size_t>len(known) == first + i:
                known.append(name)
    finally:
        free(text)
        free(sizes)
    return 0


cdef inline str name_of(list known, uint32_t id):
    # An id from before the buffer was emptied may belong to no name now.
    return known[id if id < <size_t>len(known) else 0]


cdef int pin_tree(const Tree* tree, Lock* lock, Tree* view) except -1:
    # Makes `view` a copy that may be read without the lock, except for its names. Hold the GIL until these
    # are known, too, so that they are those of the same tree.
    cdef FrameId id
    lock_acquire(lock)
    view[0] = tree[0]
    view.histories = <History*>malloc(tree.names.count * sizeof(History))
    for id in range(tree.names.count if view.histories != NULL else 0):
        history_pin(&tree.histories[id], &view.histories[id])
    lock_release(lock)
    if view.histories == NULL:
        raise MemoryError
    return 0


cdef void unpin_tree(Tree* view) noexcept nogil:
    cdef FrameId id
    for id in range(view.names.count):
        history_unpin(&view.histories[id])
    free(view.histories)


cdef object _facts_of(const History* history, str name, list names, list authorities):
    parent = history_newest_parent(history)
    return listings.FrameFacts(
        name=name,
        parent=None if parent == NO_FRAME else name_of(names, parent),
        authority=name_of(authorities, history.authority),
        is_static=history.kind == HISTORY_STATIC,
        samples=history.count,
        newest_ns=history.newest_ns,
        oldest_ns=history.oldest_ns,
    )


cdef list snapshot_frames(const Tree* tree, Lock* lock, bint roots, list names, list authorities):
    # A listings.FrameFacts for every frame that was ever a child, with `roots` also for those that were only
    # ever parents, in the order in which their names were first used, all at one moment.
    cdef Tree view
    cdef FrameId id
    pin_tree(tree, lock, &view)
    try:
        learn_names(&tree.names, lock, names)
        learn_names(&tree.authorities, lock, authorities)
        return [
            _facts_of(&view.histories[id], name_of(names, id), names, authorities)
            for id in range(1, view.names.count)
            if view.histories[id].kind != HISTORY_NONE or (roots and not view.histories[id].is_hidden)
        ]
    finally:
        with nogil:
            unpin_tree(&view)


cdef dict frame_infos(facts):
    return {one.name: listings.as_frame(one) for one in facts}


# The state in which a buffer travels: a dict of its cache time, its limits, and its samples.
#
# =================  =====================================================================================
# ``cache_time_ns``  int; so are ``max_frames`` and ``max_bytes``.
# ``frames``         a tuple for each frame with samples: its name, whether it is static, the authority of
#                    its last transform, and how many samples it has.
# ``stamps``         int64 (N,), ns: those of the samples of the first frame, in order, then of the next.
# ``transforms``     float64 (N, 7): x y z in meters, and the rotation x y z w.
# ``parents``        uint32 (N,): places in ``parent_names``.
# ``parent_names``   list of str.
# =================  =====================================================================================
#
# Names are as a message carries them: inserting removes one leading '/'.

cdef struct Text:
    const char* start       # UTF-8, not terminated
    Py_ssize_t size         # bytes


cdef struct Samples:
    # Some of the samples of a state, in its arrays.
    const int64_t* stamps
    const double* transforms
    const uint32_t* parents
    uint64_t count
    const Text* parent_names
    size_t parent_name_count


cdef str _as_sent(str name):
    return f"/{name}" if name.startswith("/") else name


cdef dict state_of(const Tree* tree, Lock* lock, list names, list authorities):
    cdef Tree view
    cdef FrameId id
    cdef uint64_t at = 0
    cdef int64_t* stamp_at
    cdef double* transform_at
    cdef uint32_t* parent_at
    cdef const History* history
    cdef list frames = []
    cdef list parent_names = []
    pin_tree(tree, lock, &view)
    try:
        learn_names(&tree.names, lock, names)
        learn_names(&tree.authorities, lock, authorities)
        stamps = new_array((view.samples,), "int64")
        transforms = new_array((view.samples, TRANSFORM_DOUBLES), "float64")
        parents = new_array((view.samples,), "uint32")
        stamp_at, transform_at = int64s_of(stamps), doubles_of(transforms, TRANSFORM_DOUBLES)
        parent_at = uint32s_of(parents, 0)
        with nogil:
            for id in range(1, view.names.count):
                history_export(&view.histories[id], stamp_at + at, transform_at + at * TRANSFORM_DOUBLES,
                               parent_at + at)
                at += view.histories[id].count
        for id in range(view.names.count):
            history = &view.histories[id]
            if history.count:
                frames.append((_as_sent(names[id]), history.kind == HISTORY_STATIC,
                               name_of(authorities, history.authority), history.count))
            parent_names.append(_as_sent(names[id]) if history.is_parent else "")
        return {
            "cache_time_ns": view.retention.cache_time_ns,
            "max_frames": view.limits.frames,
            "max_bytes": view.limits.bytes,
            "frames": frames,
            "stamps": stamps,
            "transforms": transforms,
            "parents": parents,
            "parent_names": parent_names,
        }
    finally:
        with nogil:
            unpin_tree(&view)


cdef object _not_a_state(what):
    return ValueError(f"this is not the state of a buffer: {what}")


cdef object _number(dict state, str key, least, most):
    value = state[key]
    if type(value) is not int or not least <= value <= most:
        raise _not_a_state(f"{key}: expected an int from {least} to {most}, got {value!r}")
    return value


cdef uint32_t _insert_samples(Tree* tree, const Text* child, uint32_t authority, bint is_static,
                              const Samples* samples, uint64_t first, uint64_t end) noexcept nogil:
    # What tree_insert returns for the first one that is refused. Other threads may write into the arrays.
    cdef Incoming incoming
    cdef uint64_t i
    cdef uint32_t parent
    cdef uint32_t refused = 0
    for i in range(first, end):
        parent = samples.parents[i]
        if parent >= samples.parent_name_count:
            return REFUSED_NO_PARENT
        incoming.stamp_ns = samples.stamps[i]
        incoming.child, incoming.child_size = child.start, child.size
        incoming.parent = samples.parent_names[parent].start
        incoming.parent_size = samples.parent_names[parent].size
        memcpy(&incoming.transform, samples.transforms + TRANSFORM_DOUBLES * i, sizeof(Transform))
        refused = tree_insert(tree, &incoming, authority, is_static, NULL)
        if refused:
            break
    return refused


cdef int _insert_frames(Tree* tree, list frames, const Samples* samples) except -1:
    cdef Text child, sender
    cdef bint is_static
    cdef uint32_t sender_id, refused
    cdef uint64_t first
    cdef uint64_t end = 0
    for name, is_static, authority, count in frames:
        first = end
        if type(count) is not int or not 0 <= count <= samples.count - first:
            raise _not_a_state(f"it does not contain {count} samples of {name}")
        end = first + <uint64_t>count
        child.start = name_utf8(name, &child.size)
        sender.start = name_utf8(authority, &sender.size, "authority")
        sender_id = tree_authority(tree, sender.start, sender.size)
        if sender_id == NAME_NO_MEMORY:
            raise MemoryError
        with nogil:
            refused = _insert_samples(tree, &child, sender_id, is_static, samples, first, end)
        if refused == TREE_NO_MEMORY:
            raise MemoryError
        if refused:
            raise _not_a_state(f"a transform of {printable(name)} is refused: {log.because(refused)}")
    if end != samples.count:
        raise _not_a_state(f"its arrays contain {samples.count} samples, but its frames list {end}")
    return 0


cdef int _insert_state(Tree* tree, dict state) except -1:
    cdef Samples samples
    cdef Text* parent_names
    cdef size_t i
    # A private copy of the list: pointers refer to its elements, and its owner may change the original.
    cdef tuple names = tuple(state["parent_names"])
    stamps, transforms, parents = [
        received_array(state[key], dtype)
        for key, dtype in (("stamps", "int64"), ("transforms", "float64"), ("parents", "uint32"))
    ]
    samples.stamps, samples.count = int64s_of(stamps), len(stamps)
    samples.transforms = doubles_of(transforms, TRANSFORM_DOUBLES)
    samples.parents = uint32s_of(parents, 0)
    if not len(stamps) == len(transforms) == len(parents):
        raise _not_a_state(f"expected arrays of one length, got {len(stamps)} stamps, "
                           f"{len(transforms)} transforms and {len(parents)} parents")
    parent_names = <Text*>PyMem_Malloc(len(names) * sizeof(Text))
    if parent_names == NULL:
        raise MemoryError
    try:
        for i in range(<size_t>len(names)):
            parent_names[i].start = name_utf8(names[i], &parent_names[i].size)
        samples.parent_names, samples.parent_name_count = parent_names, len(names)
        return _insert_frames(tree, list(state["frames"]), &samples)
    finally:
        PyMem_Free(parent_names)


cdef int read_state(dict state, Tree* tree) except -1:
    # Makes a tree by inserting what such a state holds. ValueError: a transform is refused. If it raises,
    # there is no tree.
    memset(tree, 0, sizeof(Tree))
    try:
        if tree_init(tree, &KEEP_ALL, &NO_LIMITS) != 0:
            raise MemoryError
        _insert_state(tree, state)
        tree.retention.cache_time_ns = _number(state, "cache_time_ns", 0, INT64_MAX)
        tree.limits.frames = _number(state, "max_frames", 1, UINT32_MAX)
        tree.limits.bytes = _number(state, "max_bytes", 1, SIZE_MAX)
    except BaseException as error:
        tree_free(tree)
        if isinstance(error, KeyError):
            raise _not_a_state(f"it lacks {error.args[0]}") from None
        raise
    return 0
