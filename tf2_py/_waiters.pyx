"""Owns who waits for what, so that an insert looks only at waiters that it can help."""

from libc.stdint cimport uint32_t
from libc.stdlib cimport free, realloc
from libc.string cimport memset

from tf2_py._cache cimport Cache
from tf2_py._query cimport Query, query_walk
from tf2_py._tree cimport Tree
from tf2_py._types cimport GAP_FUTURE, GAP_PAST, STATUS_EXTRAPOLATION, STATUS_OK, FrameId, Status


cdef inline void _link(WaiterList* list, Waiter* waiter) noexcept nogil:
    waiter.after = NULL
    waiter.before = list.last
    if list.last != NULL:
        list.last.after = waiter
    else:
        list.first = waiter
    list.last = waiter


cdef void _link_in_order(WaiterList* list, Waiter* waiter, Waiter* behind) noexcept nogil:
    # Behind those that came earlier, and behind `behind` in any case.
    cdef Waiter* before = list.last
    while before != behind and before.arrival > waiter.arrival:
        before = before.before
    waiter.before = before
    waiter.after = list.first if before == NULL else before.after
    if waiter.after == NULL:
        list.last = waiter
    else:
        waiter.after.before = waiter
    if before == NULL:
        list.first = waiter
    else:
        before.after = waiter


cdef inline void _unlink(WaiterList* list, Waiter* waiter) noexcept nogil:
    if waiter.before != NULL:
        waiter.before.after = waiter.after
    else:
        list.first = waiter.after
    if waiter.after != NULL:
        waiter.after.before = waiter.before
    else:
        list.last = waiter.before


cdef inline bint _precedes(const Waiter* a, const Waiter* b) noexcept nogil:
    if a.time_ns == b.time_ns:
        return a.arrival < b.arrival
    return (a.time_ns < b.time_ns) == (a.place == PLACE_LATER)


cdef inline void _put(WaiterHeap* heap, uint32_t position, Waiter* waiter) noexcept nogil:
    heap.items[position] = waiter
    waiter.position = position


cdef void _sift(WaiterHeap* heap, Waiter* waiter, uint32_t position) noexcept nogil:
    # Put the waiter where it belongs, up or down from a free position.
    cdef uint32_t child
    while position > 0 and _precedes(waiter, heap.items[(position - 1) // 2]):
        _put(heap, position, heap.items[(position - 1) // 2])
        position = (position - 1) // 2
    while True:
        child = 2 * position + 1
        if child >= heap.count:
            break
        if child + 1 < heap.count and _precedes(heap.items[child + 1], heap.items[child]):
            child += 1
        if not _precedes(heap.items[child], waiter):
            break
        _put(heap, position, heap.items[child])
        position = child
    _put(heap, position, waiter)


cdef int _push(WaiterHeap* heap, Waiter* waiter) noexcept nogil:
    cdef uint32_t capacity
    cdef void* grown
    if heap.count == heap.capacity:
        capacity = heap.capacity * 2 if heap.capacity else 4
        grown = realloc(heap.items, capacity * sizeof(Waiter*))
        if grown == NULL:
            return -1
        heap.items = <Waiter**>grown
        heap.capacity = capacity
    heap.count += 1
    _sift(heap, waiter, heap.count - 1)
    return 0


cdef void _pull(WaiterHeap* heap, Waiter* waiter) noexcept nogil:
    cdef Waiter* last
    heap.count -= 1
    last = heap.items[heap.count]
    if last != waiter:
        _sift(heap, last, waiter.position)


cdef int _reserve_frame(Waiters* waiters, const Tree* tree, FrameId frame) noexcept nogil:
    cdef void* grown
    if frame < waiters.frames_capacity:
        return 0
    grown = realloc(waiters.frames, tree.capacity * sizeof(FrameWaiters))
    if grown == NULL:
        return -1
    waiters.frames = <FrameWaiters*>grown
    memset(&waiters.frames[waiters.frames_capacity], 0,
           (tree.capacity - waiters.frames_capacity) * sizeof(FrameWaiters))
    waiters.frames_capacity = tree.capacity
    return 0


cdef Place _place(const Tree* tree, const Query* query, Status status) noexcept nogil:
    # What a failed attempt lacks.
    if tree.ever_looped:
        return PLACE_ANY
    if status.code != STATUS_EXTRAPOLATION:
        return PLACE_TREE
    if query.source_ns == 0 or (query.fixed != NULL and query.target_ns == 0):
        # The latest common time moves with every frame on the path.
        return PLACE_ANY
    if not status.on_path:
        # Two trees, or a frame whose parent at that time is not known: only a change of the tree joins them.
        return PLACE_TREE
    if status.gap == GAP_FUTURE:
        return PLACE_LATER
    if status.gap == GAP_PAST:
        return PLACE_EARLIER
    return PLACE_FRAME


cdef void _file(Waiters* waiters, const Tree* tree, Waiter* waiter, Status status) noexcept nogil:
    waiter.place = _place(tree, &waiter.query, status)
    waiter.frame = status.child
    waiter.time_ns = status.requested_ns
    waiters.count += 1
    if waiter.place in (PLACE_LATER, PLACE_EARLIER, PLACE_FRAME):
        # Without memory for its own place, every insert is looked at: slower, and nothing is lost.
        if _reserve_frame(waiters, tree, waiter.frame) != 0:
            waiter.place = PLACE_ANY
        elif waiter.place == PLACE_LATER and _push(&waiters.frames[waiter.frame].later, waiter) != 0:
            waiter.place = PLACE_ANY
        elif waiter.place == PLACE_EARLIER and _push(&waiters.frames[waiter.frame].earlier, waiter) != 0:
            waiter.place = PLACE_ANY
        elif waiter.place == PLACE_FRAME:
            _link(&waiters.frames[waiter.frame].any, waiter)
    if waiter.place == PLACE_TREE:
        _link(&waiters.tree, waiter)
    elif waiter.place == PLACE_ANY:
        _link(&waiters.any, waiter)


cdef void waiters_remove(Waiters* waiters, Waiter* waiter) noexcept nogil:
    if waiter.place == PLACE_NONE:
        return
    if waiter.place == PLACE_READY:
        _unlink(waiter.ready, waiter)
        waiter.place = PLACE_NONE
        return
    waiters.count -= 1
    if waiter.place == PLACE_LATER:
        _pull(&waiters.frames[waiter.frame].later, waiter)
    elif waiter.place == PLACE_EARLIER:
        _pull(&waiters.frames[waiter.frame].earlier, waiter)
    elif waiter.place == PLACE_FRAME:
        _unlink(&waiters.frames[waiter.frame].any, waiter)
    elif waiter.place == PLACE_TREE:
        _unlink(&waiters.tree, waiter)
    else:
        _unlink(&waiters.any, waiter)
    waiter.place = PLACE_NONE


cdef Status _attempt(Waiters* waiters, const Tree* tree, Waiter* waiter) noexcept nogil:
    cdef Status status = query_walk(tree, &waiter.query, &waiter.answer, &waiter.stamp_ns)
    if status.code == STATUS_OK:
        waiter.answered = True
    else:
        _file(waiters, tree, waiter, status)
    return status


cdef Status waiters_add(Waiters* waiters, const Tree* tree, Waiter* waiter) noexcept nogil:
    if waiters.count == 0:
        # Nobody has looked at the tree's changes while nobody waited.
        waiters.changes = tree.changes
    waiters.arrivals += 1
    waiter.arrival = waiters.arrivals
    return _attempt(waiters, tree, waiter)


cdef void _take_list(Waiters* waiters, WaiterList* list, WaiterList* taken) noexcept nogil:
    cdef Waiter* waiter = list.first
    while waiter != NULL:
        waiters_remove(waiters, waiter)
        _link(taken, waiter)
        waiter = list.first


cdef void _take_heap(Waiters* waiters, WaiterHeap* heap, WaiterList* taken) noexcept nogil:
    cdef Waiter* waiter
    while heap.count:
        waiter = heap.items[0]
        waiters_remove(waiters, waiter)
        _link(taken, waiter)


cdef void waiters_wake(
    Waiters* waiters, const Tree* tree, FrameId changed, WaiterList* ready
) noexcept nogil:
    # All of them are taken out before the first is tried, for one that fails again may be filed where it was.
    cdef WaiterList taken
    cdef FrameWaiters* own
    cdef const Cache* cache = &tree.caches[changed]
    cdef Waiter* waiter
    cdef Waiter* behind = ready.last    # completed by another transform of the batch
    cdef uint32_t frame
    taken.first = taken.last = NULL
    if waiters.changes != tree.changes:
        waiters.changes = tree.changes
        for frame in range(waiters.frames_capacity):
            _take_heap(waiters, &waiters.frames[frame].later, &taken)
            _take_heap(waiters, &waiters.frames[frame].earlier, &taken)
            _take_list(waiters, &waiters.frames[frame].any, &taken)
        _take_list(waiters, &waiters.tree, &taken)
    elif changed < waiters.frames_capacity:
        own = &waiters.frames[changed]
        while own.later.count and own.later.items[0].time_ns <= cache.newest_ns:
            waiter = own.later.items[0]
            waiters_remove(waiters, waiter)
            _link(&taken, waiter)
        while own.earlier.count and own.earlier.items[0].time_ns >= cache.oldest_ns:
            waiter = own.earlier.items[0]
            waiters_remove(waiters, waiter)
            _link(&taken, waiter)
        _take_list(waiters, &own.any, &taken)
    _take_list(waiters, &waiters.any, &taken)
    while taken.first != NULL:
        waiter = taken.first
        _unlink(&taken, waiter)
        if _attempt(waiters, tree, waiter).code == STATUS_OK and not waiter.deliver(waiter):
            waiter.place = PLACE_READY
            waiter.ready = ready
            _link_in_order(ready, waiter, behind)


cdef void waiters_free(Waiters* waiters) noexcept nogil:
    cdef uint32_t frame
    for frame in range(waiters.frames_capacity):
        free(waiters.frames[frame].later.items)
        free(waiters.frames[frame].earlier.items)
    free(waiters.frames)


cdef const char* waiters_check(const Waiters* waiters) noexcept nogil:
    cdef uint32_t frame, i
    cdef uint32_t count = 0
    cdef const WaiterHeap* heap
    cdef const Waiter* waiter
    cdef int k
    for frame in range(waiters.frames_capacity):
        for k in range(2):
            heap = &waiters.frames[frame].earlier if k else &waiters.frames[frame].later
            for i in range(heap.count):
                waiter = heap.items[i]
                if waiter.position != i or waiter.frame != frame or waiter.answered:
                    return "a waiter that is not where it is filed"
                if i and _precedes(waiter, heap.items[(i - 1) // 2]):
                    return "a heap of waiters out of order"
            count += heap.count
        waiter = waiters.frames[frame].any.first
        while waiter != NULL:
            count += 1
            waiter = waiter.after
    for k in range(2):
        waiter = waiters.any.first if k else waiters.tree.first
        while waiter != NULL:
            if waiter.place != (PLACE_ANY if k else PLACE_TREE):
                return "a waiter in a list that is not its own"
            count += 1
            waiter = waiter.after
    if count != waiters.count:
        return "waiters miscounted"
    return NULL
