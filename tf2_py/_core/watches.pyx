"""Owns sorted sets of watches: treaps, search trees that random priorities keep shallow."""

from libc.stdint cimport INT64_MIN, int64_t


cdef inline void _replace(Watches* watches, Watch* watch, Watch* other) noexcept nogil:
    # `other`, or NULL, becomes the child of the watch's parent.
    if watch.parent == NULL:
        watches.root = other
    elif watch.parent.left == watch:
        watch.parent.left = other
    else:
        watch.parent.right = other
    if other != NULL:
        other.parent = watch.parent


cdef void _rotate_up(Watches* watches, Watch* watch) noexcept nogil:
    # To its parent's place; the parent becomes its child.
    cdef Watch* parent = watch.parent
    _replace(watches, parent, watch)
    if parent.left == watch:
        parent.left = watch.right
        if watch.right != NULL:
            watch.right.parent = parent
        watch.right = parent
    else:
        parent.right = watch.left
        if watch.left != NULL:
            watch.left.parent = parent
        watch.left = parent
    parent.parent = watch


cdef void watches_add(Watches* watches, Watch* watch) noexcept nogil:
    cdef Watch* parent = NULL
    cdef Watch* below = watches.root
    if below == NULL:
        watches.lowest = watches.highest = watch.key
    watches.lowest = min(watches.lowest, watch.key)
    watches.highest = max(watches.highest, watch.key)
    while below != NULL:
        parent = below
        below = below.left if watch.key < below.key else below.right
    watch.parent = parent
    watch.left = watch.right = NULL
    if parent == NULL:
        watches.root = watch
    elif watch.key < parent.key:
        parent.left = watch
    else:
        parent.right = watch
    while watch.parent != NULL and watch.parent.priority < watch.priority:
        _rotate_up(watches, watch)


cdef void watches_remove(Watches* watches, Watch* watch) noexcept nogil:
    while watch.left != NULL and watch.right != NULL:
        _rotate_up(watches, watch.left if watch.left.priority > watch.right.priority else watch.right)
    _replace(watches, watch, watch.left if watch.left != NULL else watch.right)


cdef Watch* watches_between(Watches* watches, int64_t first, int64_t last) noexcept nogil:
    cdef Watch* found
    if watches.root == NULL or last < watches.lowest or first > watches.highest:
        return NULL
    found = watches_from(watches, first)
    if found == NULL:
        watches.highest = first - 1
    elif first <= watches.lowest:
        watches.lowest = found.key
    return found if found != NULL and found.key <= last else NULL


cdef Watch* watches_from(const Watches* watches, int64_t key) noexcept nogil:
    cdef Watch* found = NULL
    cdef Watch* watch = watches.root
    while watch != NULL:
        if watch.key >= key:
            found = watch
            watch = watch.left
        else:
            watch = watch.right
    return found


cdef Watch* watches_next(const Watch* watch) noexcept nogil:
    cdef Watch* up
    if watch.right != NULL:
        up = watch.right
        while up.left != NULL:
            up = up.left
        return up
    up = watch.parent
    while up != NULL and up.right == watch:
        watch = up
        up = up.parent
    return up


cdef const char* watches_check(const Watches* watches) noexcept nogil:
    cdef const Watch* watch
    if watches.root != NULL and watches.root.parent != NULL:
        return "a root of watches that has a parent"
    watch = watches_from(watches, INT64_MIN)
    while watch != NULL:
        if not watches.lowest <= watch.key <= watches.highest:
            return "a watch beyond the bounds of its set"
        if watch.left != NULL and (watch.left.parent != watch or watch.left.key > watch.key):
            return "watches out of order"
        if watch.right != NULL and (watch.right.parent != watch or watch.right.key < watch.key):
            return "watches out of order"
        if watch.parent != NULL and watch.parent.priority < watch.priority:
            return "a watch of larger priority than its parent"
        watch = watches_next(watch)
    return NULL
