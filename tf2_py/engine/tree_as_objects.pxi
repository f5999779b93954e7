# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Copy the content of a tree as Python objects, for listings."""

# Each takes the lock to copy what it needs, and makes Python objects while the lock is free. `names` and
# `authorities`: those of the tree that are known so far.

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


cdef dict histories_of(const Tree* tree, Lock* lock, list names):
    # A listings.History for every frame with samples, by name, as snapshot_frames; views of four arrays.
    import numpy as np
    cdef Tree view
    cdef FrameId id
    cdef int64_t* stamps_at
    cdef double* transforms_at
    cdef uint32_t* parents_at
    cdef uint64_t at = 0
    cdef dict found = {}
    pin_tree(tree, lock, &view)
    try:
        learn_names(&tree.names, lock, names)
        stamps = new_array((view.samples,), "int64")
        transforms = new_array((view.samples, TRANSFORM_DOUBLES))
        parents = new_array((view.samples,), "uint32")
        stamps_at, parents_at = int64s_of(stamps), uint32s_of(parents, 0)
        transforms_at = doubles_of(transforms, TRANSFORM_DOUBLES)
        with nogil:
            for id in range(1, view.names.count):
                history_export(&view.histories[id], stamps_at + at, transforms_at + at * TRANSFORM_DOUBLES,
                               parents_at + at)
                at += view.histories[id].count
        parents = np.array(names, object)[parents]
        at = 0
        for id in range(1, view.names.count):
            if view.histories[id].count:
                rows = slice(at, at + view.histories[id].count)
                found[names[id]] = listings.History(
                    names[id], view.histories[id].kind == HISTORY_STATIC, parents[rows], stamps[rows],
                    transforms[rows, :3], transforms[rows, 3:])
                at = rows.stop
        return found
    finally:
        with nogil:
            unpin_tree(&view)
