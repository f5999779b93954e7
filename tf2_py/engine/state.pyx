"""Copy the content of a tree: as Python objects for listings, as one state for pickles and files."""

cdef struct Facts:
    # A FrameFacts before its names are Python objects.
    FrameId frame
    FrameId parent
    uint32_t authority
    bint is_static
    uint32_t count
    int64_t newest_ns
    int64_t oldest_ns


cdef int learn_names(const Names* names, Lock* lock, list known) except -1:
    cdef uint32_t sizes[SLICE_FRAMES]
    cdef uint32_t first, count, i
    cdef size_t start, size
    cdef char* text
    while True:
        first = len(known)
        text = NULL
        lock_acquire(lock)
        count = min(names.count - min(first, names.count), <uint32_t>SLICE_FRAMES)
        if count:
            start = names.names[first].start
            size = names.names[first + count - 1].start + names.names[first + count - 1].size - start
            text = <char*>malloc(size + 1)
        if text != NULL:
            memcpy(text, names.text + start, size)
            for i in range(count):
                sizes[i] = names.names[first + i].size
        lock_release(lock)
        if count == 0:
            return 0
        if text == NULL:
            raise MemoryError
        try:
            start = 0
            for i in range(count):
                name = text[start:start + sizes[i]].decode("utf-8")
                start += sizes[i]
                # Another thread may have added it meanwhile.
                if <size_t>len(known) == first + i:
                    known.append(name)
        finally:
            free(text)


cdef inline str name_of(list known, uint32_t id):
    # An id from before the buffer was emptied may belong to no name now.
    return known[id if id < <size_t>len(known) else 0]


cdef inline void _copy_facts(Facts* facts, const Tree* tree, FrameId frame) noexcept nogil:
    cdef const History* history = &tree.histories[frame]
    facts.frame = frame
    facts.parent = tree_newest_parent(tree, frame)
    facts.authority = history.authority
    facts.is_static = history.kind == HISTORY_STATIC
    facts.count = history.count
    facts.newest_ns = history.newest_ns
    facts.oldest_ns = history.oldest_ns


cdef uint32_t _copy_frames(const Tree* tree, bint roots, FrameId* first, Facts* facts) noexcept nogil:
    # With the lock held: the facts of a slice that begins with `first`, which is moved behind it.
    cdef uint32_t end = min(first[0] + SLICE_FRAMES, tree.names.count)
    cdef uint32_t count = 0
    cdef uint32_t id
    for id in range(first[0], end):
        if tree.histories[id].kind != HISTORY_NONE or (roots and not tree.histories[id].is_hidden):
            _copy_facts(&facts[count], tree, id)
            count += 1
    first[0] = end
    return count


cdef object _as_object(const Facts* facts, list names, list authorities):
    return listings.FrameFacts(
        name=name_of(names, facts.frame),
        parent=None if facts.parent == NO_FRAME else name_of(names, facts.parent),
        authority=name_of(authorities, facts.authority),
        is_static=bool(facts.is_static),
        samples=facts.count,
        newest_ns=facts.newest_ns,
        oldest_ns=facts.oldest_ns,
    )


cdef list snapshot_frames(const Tree* tree, Lock* lock, bint roots, list names, list authorities):
    cdef list frames = []
    cdef FrameId first = NO_FRAME + 1
    cdef bint is_last = False
    cdef uint32_t count, i
    cdef Facts* facts = <Facts*>PyMem_Malloc(SLICE_FRAMES * sizeof(Facts))
    if facts == NULL:
        raise MemoryError
    try:
        while not is_last:
            lock_acquire(lock)
            count = _copy_frames(tree, roots, &first, facts)
            is_last = first >= tree.names.count
            lock_release(lock)
            learn_names(&tree.names, lock, names)
            learn_names(&tree.authorities, lock, authorities)
            frames += [_as_object(&facts[i], names, authorities) for i in range(count)]
        return frames
    finally:
        PyMem_Free(facts)


cdef bint snapshot_span(const Tree* tree, Lock* lock, int64_t* oldest_ns, int64_t* newest_ns) noexcept nogil:
    cdef FrameId id, end
    cdef FrameId first = NO_FRAME + 1
    cdef bint is_last = False
    cdef const History* history
    oldest_ns[0] = INT64_MAX
    newest_ns[0] = INT64_MIN
    while not is_last:
        lock_acquire(lock)
        end = min(first + SLICE_FRAMES, tree.names.count)
        is_last = end == tree.names.count
        for id in range(first, end):
            history = &tree.histories[id]
            if history.kind == HISTORY_DYNAMIC and history.count:
                oldest_ns[0] = min(oldest_ns[0], history.oldest_ns)
                newest_ns[0] = max(newest_ns[0], history.newest_ns)
        lock_release(lock)
        first = end
    return oldest_ns[0] <= newest_ns[0]


# A tree as flat arrays.

cdef inline size_t _terminated_size(const Names* names) noexcept nogil:
    # Of all names but that with the id 0, each with a NUL behind it.
    return names.text_size - names.names[0].size + names.count - 1


cdef void _copy_terminated(const Names* names, char* out) noexcept nogil:
    cdef uint32_t id
    cdef uint32_t size
    for id in range(1, names.count):
        size = names.names[id].size
        memcpy(out, names.text + names.names[id].start, size)
        out[size] = 0
        out += size + 1


cdef bint _pin_all(const Tree* tree, PinnedTree* pinned) noexcept nogil:
    cdef FrameId id
    pinned.view = tree[0]
    pinned.names_size = _terminated_size(&tree.names)
    pinned.authorities_size = _terminated_size(&tree.authorities)
    pinned.names = <char*>malloc(pinned.names_size + pinned.authorities_size + 1)
    pinned.view.histories = <History*>malloc(tree.names.count * sizeof(History))
    if pinned.names == NULL or pinned.view.histories == NULL:
        free(pinned.names)
        free(pinned.view.histories)
        return False
    for id in range(tree.names.count):
        history_pin(&tree.histories[id], &pinned.view.histories[id])
    _copy_terminated(&tree.names, pinned.names)
    _copy_terminated(&tree.authorities, pinned.names + pinned.names_size)
    return True


cdef bint tree_pin(const Tree* tree, Lock* lock, PinnedTree* pinned) noexcept nogil:
    cdef bint is_pinned
    lock_acquire(lock)
    is_pinned = _pin_all(tree, pinned)
    lock_release(lock)
    return is_pinned


cdef void tree_unpin(PinnedTree* pinned) noexcept nogil:
    cdef FrameId id
    for id in range(pinned.view.names.count):
        history_unpin(&pinned.view.histories[id])
    free(pinned.view.histories)
    free(pinned.names)


cdef void tree_export(const PinnedTree* pinned, TreeArrays* arrays) noexcept nogil:
    cdef const Tree* view = &pinned.view
    cdef const History* history
    cdef FrameRow* row
    cdef FrameId id
    cdef uint64_t at = 0
    for id in range(1, view.names.count):
        history = &view.histories[id]
        row = &arrays.frames[id - 1]
        row.kind = history.kind
        row.count = history.count
        row.authority = history.authority
        row.flags = ((<uint32_t>ROW_IS_PARENT if history.is_parent else 0)
                     | (<uint32_t>ROW_IS_HIDDEN if history.is_hidden else 0))
        row.capacity = history.capacity
        row.mostly_empty_for = history.mostly_empty_for
        history_export(history, arrays.stamps + at, arrays.transforms + at * TRANSFORM_DOUBLES,
                       arrays.parents + at)
        at += history.count
    arrays.names = pinned.names
    arrays.names_size = pinned.names_size
    arrays.authorities = pinned.names + pinned.names_size
    arrays.authorities_size = pinned.authorities_size
    arrays.frame_count = view.names.count - 1
    arrays.sample_count = at
    arrays.cache_time_ns = view.cache_time_ns
    arrays.limits = view.limits
    arrays.ever_looped = view.ever_looped
    arrays.taken = view.taken
    memcpy(arrays.refused, view.refused, sizeof(view.refused))


cdef const char* _next_name(const Names* known, const char* text, size_t left, size_t* size) noexcept nogil:
    # The size of the name that `text` begins with. NULL, or why there is none.
    cdef const char* end = <const char*>memchr(<const void*>text, 0, left)
    if end == NULL:
        return "the last name does not end with a NUL"
    size[0] = end - text
    if names_find(known, text, size[0]) != NAME_UNKNOWN:
        return "a name occurs twice, or is a reserved one"
    return NULL


cdef const char* _import_frame_names(const TreeArrays* arrays, Tree* tree) noexcept nogil:
    cdef const char* text = arrays.names
    cdef const char* problem
    cdef size_t left = arrays.names_size
    cdef size_t size
    cdef uint32_t refused = 0
    while left:
        problem = _next_name(&tree.names, text, left, &size)
        if problem != NULL:
            return problem
        if size == 0:
            return "the name of a frame is empty"
        if tree.names.count > tree.limits.frames or tree.names.count > arrays.frame_count:
            return "there are more names than frames, or than the limit of frames allows"
        tree_add_frame(tree, text, size, NULL, &refused)
        if refused:
            return TREE_LACKS_MEMORY
        text += size + 1
        left -= size + 1
    if tree.names.count - 1 != arrays.frame_count:
        return "there are more frames than names"
    return NULL


cdef const char* _import_authorities(const TreeArrays* arrays, Tree* tree) noexcept nogil:
    cdef const char* text = arrays.authorities
    cdef const char* problem
    cdef size_t left = arrays.authorities_size
    cdef size_t size
    while left:
        problem = _next_name(&tree.authorities, text, left, &size)
        if problem != NULL:
            return problem
        if names_intern(&tree.authorities, text, size) == NAME_NO_MEMORY:
            return TREE_LACKS_MEMORY
        text += size + 1
        left -= size + 1
    return NULL


cdef const char* _import_history(const TreeArrays* arrays, FrameId id, uint64_t* at,
                                 Tree* tree) noexcept nogil:
    # The history of one frame, whose samples begin at `at`, which is moved behind them.
    cdef History* history = &tree.histories[id]
    cdef FrameRow row = arrays.frames[id - 1]       # once: see tree_import
    if row.kind > HISTORY_STATIC or row.flags > ROW_IS_PARENT + ROW_IS_HIDDEN:
        return "the row of a frame holds a value that has no meaning"
    if row.count > row.capacity or row.capacity > LAST_CAPACITY:
        return "a frame has more samples than its capacity, or one that is too large"
    if row.kind != HISTORY_DYNAMIC and row.capacity != <uint32_t>(row.kind == HISTORY_STATIC):
        return "a frame has a capacity that is none of its kind"
    if row.count > arrays.sample_count - at[0]:
        return "the frames have more samples than there are stamps"
    if row.capacity and history_move(history, row.capacity, SIZE_MAX // 2) != HISTORY_INSERTED:
        return TREE_LACKS_MEMORY
    history.kind = <HistoryKind>row.kind
    history.authority = row.authority
    history.is_parent = row.flags & ROW_IS_PARENT != 0
    history.is_hidden = row.flags & ROW_IS_HIDDEN != 0
    tree.hidden += history.is_hidden
    history.mostly_empty_for = row.mostly_empty_for
    history_import(history, row.count, arrays.stamps + at[0], arrays.transforms + at[0] * TRANSFORM_DOUBLES,
                   arrays.parents + at[0])
    at[0] += row.count
    tree.parents[id] = history_newest_parent(history) | (MIXED_PARENTS if history.parent_changes else 0)
    tree.samples += history.count
    tree.history_bytes += history_allocated(history)
    return NULL


cdef const char* tree_import(const TreeArrays* arrays, Tree* tree) noexcept nogil:
    cdef const char* problem
    cdef uint64_t at = 0
    cdef FrameId id
    if tree_init(tree, arrays.cache_time_ns, &arrays.limits) != 0:
        return TREE_LACKS_MEMORY
    problem = _import_frame_names(arrays, tree)
    if problem == NULL:
        problem = _import_authorities(arrays, tree)
    if problem != NULL:
        return problem
    for id in range(1, tree.names.count):
        problem = _import_history(arrays, id, &at, tree)
        if problem != NULL:
            return problem
    if at != arrays.sample_count:
        return "there are more stamps than samples of frames"
    tree.ever_looped = arrays.ever_looped
    tree.taken = arrays.taken
    memcpy(tree.refused, arrays.refused, sizeof(tree.refused))
    return tree_check(tree)


# The state in which a buffer travels: a dict of numbers, names, and arrays.
#
# =================  =====================================================================================
# ``version``        VERSION; a buffer reads no other.
# ``cache_time_ns``  int
# ``max_frames``     int; so are ``max_bytes`` and ``max_waiters``.
# ``ever_looped``    bool: whether the parents of the frames ever formed a loop.
# ``taken``          int: transforms accepted. ``refused``: a tuple of ints, by reason.
# ``malformed``      int: messages.
# ``names``          bytes: the frames' names in the order of their ids, UTF-8, each followed by a NUL.
# ``authorities``    bytes, likewise.
# ``frames``         uint32 (F, FRAME_ROW_COLUMNS): a FrameRow for each name.
# ``stamps``         int64 (N,), ns: those of the samples of the first frame, oldest first, then of the next.
# ``transforms``     float64 (N, 7): x y z in metres, and the rotation x y z w.
# ``parents``        uint32 (N,): places of names, from 1.
# =================  =====================================================================================

cdef enum:
    VERSION = 1

cdef frozenset KEYS = frozenset({
    "version", "cache_time_ns", "max_frames", "max_bytes", "max_waiters", "ever_looped", "taken", "refused",
    "malformed", "names", "authorities", "frames", "stamps", "transforms", "parents",
})


cdef dict state_of(const Tree* tree, Lock* lock, unsigned long long malformed):
    cdef PinnedTree pinned
    cdef TreeArrays arrays
    cdef bint is_pinned
    cdef uint32_t kind
    with nogil:
        is_pinned = tree_pin(tree, lock, &pinned)
    if not is_pinned:
        raise MemoryError
    try:
        frames = new_array((pinned.view.names.count - 1, FRAME_ROW_COLUMNS), "uint32")
        stamps = new_array((pinned.view.samples,), "int64")
        transforms = new_array((pinned.view.samples, TRANSFORM_DOUBLES), "float64")
        parents = new_array((pinned.view.samples,), "uint32")
        arrays.frames = <FrameRow*>uint32s_of(frames, FRAME_ROW_COLUMNS)
        arrays.stamps = int64s_of(stamps)
        arrays.transforms = doubles_of(transforms, TRANSFORM_DOUBLES)
        arrays.parents = uint32s_of(parents, 0)
        with nogil:
            tree_export(&pinned, &arrays)
        return {
            "version": VERSION,
            "cache_time_ns": arrays.cache_time_ns,
            "max_frames": arrays.limits.frames,
            "max_bytes": arrays.limits.bytes,
            "max_waiters": arrays.limits.waiters,
            "ever_looped": bool(arrays.ever_looped),
            "taken": arrays.taken,
            "refused": tuple([arrays.refused[kind] for kind in range(<uint32_t>REFUSAL_KINDS)]),
            "malformed": malformed,
            "names": arrays.names[:arrays.names_size],
            "authorities": arrays.authorities[:arrays.authorities_size],
            "frames": frames,
            "stamps": stamps,
            "transforms": transforms,
            "parents": parents,
        }
    finally:
        with nogil:
            tree_unpin(&pinned)


cdef object _not_a_state(what):
    return ValueError(f"not the state of a buffer: {what}")


cdef object _number(value, what, most, least=0):
    # Within `least` and `most`; a bool does not count as a number.
    if type(value) is not int:
        raise _not_a_state(f"{what} is not an int but {type(value).__name__}")
    if not least <= value <= most:
        shown = value if value.bit_length() < 128 else "too large"
        raise _not_a_state(f"{what} is {shown}, not within {least} and {most}")
    return value


cdef bytes _state_names(dict state, str key):
    text = state[key]
    if type(text) is not bytes:
        raise _not_a_state(f"{key} is not bytes but {type(text).__name__}")
    try:
        text.decode("utf-8")
    except UnicodeDecodeError as error:
        raise _not_a_state(f"{key} is not UTF-8: {error.reason} at byte {error.start}") from None
    return text


cdef object _array(dict state, str key, tuple shape, str dtype):
    try:
        return received_array(state[key], shape, dtype)
    except ValueError as error:
        raise _not_a_state(f"{key} {error}") from None


cdef int read_state(dict state, Tree* tree, unsigned long long* malformed) except -1:
    cdef TreeArrays arrays
    cdef const char* problem
    cdef bytes names, authorities
    cdef uint32_t kind
    version = _number(state.get("version"), "version", UINT32_MAX)
    if version != VERSION:
        raise _not_a_state(f"it is of version {version}; this one reads version {VERSION}")
    if state.keys() != KEYS:
        wrong = sorted(map(repr, state.keys() ^ KEYS))
        raise _not_a_state(f"it lacks, or has too many: {printable(', '.join(wrong))}")
    memset(&arrays, 0, sizeof(TreeArrays))
    arrays.cache_time_ns = _number(state["cache_time_ns"], "cache_time_ns", INT64_MAX)
    arrays.limits.frames = _number(state["max_frames"], "max_frames", UINT32_MAX, 1)
    arrays.limits.bytes = _number(state["max_bytes"], "max_bytes", SIZE_MAX, 1)
    arrays.limits.waiters = _number(state["max_waiters"], "max_waiters", UINT32_MAX, 1)
    arrays.taken = _number(state["taken"], "taken", UINT64_MAX)
    malformed[0] = _number(state["malformed"], "malformed", UINT64_MAX)
    if type(state["ever_looped"]) is not bool:
        raise _not_a_state("ever_looped is not a bool")
    arrays.ever_looped = state["ever_looped"]
    refused = state["refused"]
    if type(refused) is not tuple or len(refused) != REFUSAL_KINDS:
        raise _not_a_state(f"refused is not a tuple of {REFUSAL_KINDS} ints")
    for kind in range(<uint32_t>REFUSAL_KINDS):
        arrays.refused[kind] = _number(refused[kind], "refused", UINT64_MAX)
    names, authorities = _state_names(state, "names"), _state_names(state, "authorities")
    # A copy, because it decides how much is read of the others, and another thread may write into it.
    frames = _array(state, "frames", (None, FRAME_ROW_COLUMNS), "uint32").copy()
    stamps = _array(state, "stamps", (None,), "int64")
    transforms = _array(state, "transforms", (len(stamps), TRANSFORM_DOUBLES), "float64")
    parents = _array(state, "parents", (len(stamps),), "uint32")
    if len(frames) >= UINT32_MAX:
        raise _not_a_state("there are too many frames")
    arrays.names, arrays.names_size = names, len(names)
    arrays.authorities, arrays.authorities_size = authorities, len(authorities)
    arrays.frames, arrays.frame_count = <FrameRow*>uint32s_of(frames, FRAME_ROW_COLUMNS), len(frames)
    arrays.stamps, arrays.sample_count = int64s_of(stamps), len(stamps)
    arrays.transforms = doubles_of(transforms, TRANSFORM_DOUBLES)
    arrays.parents = uint32s_of(parents, 0)
    memset(tree, 0, sizeof(Tree))
    with nogil:
        problem = tree_import(&arrays, tree)
        if problem != NULL:
            tree_free(tree)
    if problem == TREE_LACKS_MEMORY:
        raise MemoryError
    if problem != NULL:
        raise _not_a_state(problem.decode())
    return 0


# The samples of histories as serialised TFMessages, without checks or normalisation.

def serialize_samples(list names, rows, children, parents, stamps, transforms):
    """
    The ``tf2_msgs/TFMessage`` of some samples as plain CDR.

    :param names: bytes, by id from 1; the first element is not used.
    :param rows: which samples, in this order: indices into the other arrays, which have one element for each
        sample: the ids of its frame and of its parent, its stamp in ns, and its transform as in Transform.
    """
    cdef Writer writer
    cdef Incoming incoming
    cdef const int64_t* row_at = int64s_of(rows)
    cdef const uint32_t* child_at = uint32s_of(children, 0)
    cdef const uint32_t* parent_at = uint32s_of(parents, 0)
    cdef const int64_t* stamp_at = int64s_of(stamps)
    cdef const double* transform_at = doubles_of(transforms, TRANSFORM_DOUBLES)
    cdef uint32_t count = len(rows)
    cdef uint32_t i
    cdef int64_t row
    cdef bytes data = None
    cdef bytes name
    writer_init(&writer, NULL, count)
    # Once to count the bytes, once to write them.
    while True:
        for i in range(count):
            row = row_at[i]
            incoming.stamp_ns = stamp_at[row]
            name = names[child_at[row]]
            incoming.child, incoming.child_size = PyBytes_AS_STRING(name), PyBytes_GET_SIZE(name)
            name = names[parent_at[row]]
            incoming.parent, incoming.parent_size = PyBytes_AS_STRING(name), PyBytes_GET_SIZE(name)
            memcpy(&incoming.transform, transform_at + TRANSFORM_DOUBLES * row, sizeof(Transform))
            writer_transform(&writer, &incoming)
        if data is not None:
            return data
        data = PyBytes_FromStringAndSize(NULL, writer.position)
        writer_init(&writer, <unsigned char*>PyBytes_AS_STRING(data), count)


# The attributes that subclasses add to a buffer, which travel with it.

cdef set _slots_of(thing):
    return set(copyreg._slotnames(type(thing)))


cdef dict attributes_of(thing):
    # What is in its __dict__ and in the slots of its classes.
    cdef dict attributes = dict(getattr(thing, "__dict__", {}))
    for name in _slots_of(thing):
        if hasattr(thing, name):
            attributes[name] = getattr(thing, name)
    return attributes


cdef int check_attributes(thing, attributes) except -1:
    # ValueError: the buffer cannot have these attributes.
    if type(attributes) is not dict or not all([type(name) is str for name in attributes]):
        raise _not_a_state("its attributes are not a dict with names as keys")
    if not hasattr(thing, "__dict__") and attributes.keys() - _slots_of(thing):
        raise _not_a_state(f"a {type(thing).__name__} has no attributes of its own")
    return 0


cdef int set_attributes(thing, dict attributes) except -1:
    # As in pickle, this bypasses a __setattr__ of the class, which may rely on what __init__ does.
    cdef set slots = _slots_of(thing)
    for name in attributes.keys() & slots:
        object.__setattr__(thing, name, attributes[name])
    if attributes.keys() - slots:
        thing.__dict__.update({name: attributes[name] for name in attributes if name not in slots})
    return 0
