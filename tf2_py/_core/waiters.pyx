"""Owns the waiters: filing them, and trying those that a change can help."""

from libc.stdint cimport INT64_MIN, int64_t, uint8_t, uint32_t, uint64_t
from libc.stdlib cimport free, malloc, realloc
from libc.string cimport memset

from tf2_py._core.change cimport CHANGE_DATA, CHANGE_NAME, ChangeItem, ChangeKind
from tf2_py._core.flag cimport flag_set
from tf2_py._core.forking cimport fork_generation, fork_record_thread, fork_thread_exists
from tf2_py._core.lacks cimport Lack, Lacks, lacks_find, lacks_free
from tf2_py._core.lookup cimport query_answer
from tf2_py._core.mirror cimport mirror_catch_up, mirror_is_current
from tf2_py._core.tree cimport Tree
from tf2_py._core.types cimport STATUS_OK, FrameId, Status, Transform
from tf2_py._core.watches cimport (
    Watch,
    Watches,
    watches_add,
    watches_between,
    watches_check,
    watches_from,
    watches_next,
    watches_remove,
)


cdef enum:
    WATCHES_PER_INSERT = 8      # filing so many costs about as much time as an insert


cdef inline void _link(WaiterList* list, Waiter* waiter) noexcept nogil:
    waiter.next = NULL
    waiter.previous = list.last
    if list.last != NULL:
        list.last.next = waiter
    else:
        list.first = waiter
    list.last = waiter


cdef inline void _unlink(WaiterList* list, Waiter* waiter) noexcept nogil:
    if waiter.previous != NULL:
        waiter.previous.next = waiter.next
    else:
        list.first = waiter.next
    if waiter.next != NULL:
        waiter.next.previous = waiter.previous
    else:
        list.last = waiter.previous


cdef uint32_t _random(Waiters* waiters) noexcept nogil:
    # splitmix64 (Steele, Lea, Flood 2014)
    cdef uint64_t mixed
    waiters.random_state += <uint64_t>0x9E3779B97F4A7C15
    mixed = waiters.random_state
    mixed = (mixed ^ (mixed >> 30)) * <uint64_t>0xBF58476D1CE4E5B9
    mixed = (mixed ^ (mixed >> 27)) * <uint64_t>0x94D049BB133111EB
    return <uint32_t>(mixed >> 32)


cdef inline uint8_t* _name_count(Waiters* waiters, int64_t key) noexcept nogil:
    return &waiters.names.counts[(key >> 32) & (NAME_COUNTS - 1)]


cdef void _count_name(Waiters* waiters, int64_t key, int change) noexcept nogil:
    cdef uint8_t* count = _name_count(waiters, key)
    if count[0] != UNCOUNTED:
        count[0] += change


cdef inline Watches* _watches_of(Waiters* waiters, ChangeKind kind, FrameId frame,
                                 int64_t key) noexcept nogil:
    # NULL: this was never watched.
    if kind == CHANGE_NAME:
        if waiters.names == NULL or _name_count(waiters, key)[0] == 0:
            return NULL
        return &waiters.names.sets[key & (NAME_SETS - 1)]
    if frame >= waiters.frames_capacity:
        return NULL
    return &waiters.frames[frame].data if kind == CHANGE_DATA else &waiters.frames[frame].parent


cdef void* _grown(void* items, uint32_t* capacity, uint32_t wanted, size_t item_size) noexcept nogil:
    # The array, with memory for `wanted` items; new ones are zeroed. NULL: no memory, and nothing changed.
    cdef void* grown
    if wanted <= capacity[0]:
        return items
    grown = realloc(items, wanted * item_size)
    if grown == NULL:
        return NULL
    memset(<char*>grown + capacity[0] * item_size, 0, (wanted - capacity[0]) * item_size)
    capacity[0] = wanted
    return grown


cdef int _reserve_watches(Waiters* waiters, uint32_t frames, Waiter* waiter, uint32_t count) noexcept nogil:
    # Sets for so many frames, and `count` watches of the waiter. 0; -1: no memory.
    cdef void* sets = _grown(waiters.frames, &waiters.frames_capacity, frames, sizeof(FrameWatches))
    cdef void* watches
    if sets == NULL:
        return -1
    waiters.frames = <FrameWatches*>sets
    watches = _grown(waiter.watches, &waiter.watch_capacity, count, sizeof(Watch))
    if watches == NULL:
        return -1
    waiter.watches = <Watch*>watches
    return 0


cdef int _reserve_names(Waiters* waiters) noexcept nogil:
    if waiters.names != NULL:
        return 0
    waiters.names = <NameWatches*>malloc(sizeof(NameWatches))
    if waiters.names == NULL:
        return -1
    # Write all of it now: otherwise later inserts would wait for the system's pages, one by one.
    memset(waiters.names, 0, sizeof(NameWatches))
    return 0


cdef void _file(Waiters* waiters, const Tree* tree, Waiter* waiter) noexcept nogil:
    # Under what was found out last.
    cdef Lacks* lacks = &waiters.lacks
    cdef Lack* lack
    cdef Watch* watch
    cdef uint32_t i
    waiters.count += 1
    waiter.filed_at_wake = waiters.wakes
    if (lacks.unknown or _reserve_watches(waiters, tree.capacity, waiter, lacks.count) != 0
            or (lacks.items[0].kind == CHANGE_NAME and _reserve_names(waiters) != 0)):
        waiter.place = PLACE_ANY
        waiter.watch_count = 0
        _link(&waiters.any, waiter)
        return
    waiter.place = PLACE_FILED
    _link(&waiters.filed, waiter)
    waiter.watch_count = lacks.count
    for i in range(lacks.count):
        lack = &lacks.items[i]
        watch = &waiter.watches[i]
        watch.owner = waiter
        watch.kind = lack.kind
        watch.frame = lack.frame
        watch.key = lack.key
        watch.priority = _random(waiters)
        if lack.kind == CHANGE_NAME:
            _count_name(waiters, lack.key, 1)
        watches_add(_watches_of(waiters, lack.kind, lack.frame, lack.key), watch)


cdef void waiters_remove(Waiters* waiters, Waiter* waiter) noexcept nogil:
    cdef uint32_t i
    cdef Watch* watch
    if waiter.place == PLACE_NONE:
        return
    if waiter.place == PLACE_READY:
        waiter.place = PLACE_NONE
        # In a forked child the list may be on the stack of a thread that does not exist there.
        if fork_thread_exists(&waiter.thread):
            _unlink(waiter.ready, waiter)
        return
    waiters.count -= 1
    if waiter.place == PLACE_FILED:
        for i in range(waiter.watch_count):
            watch = &waiter.watches[i]
            watches_remove(_watches_of(waiters, <ChangeKind>watch.kind, watch.frame, watch.key), watch)
            if watch.kind == CHANGE_NAME:
                _count_name(waiters, watch.key, -1)
        _unlink(&waiters.filed, waiter)
    elif waiter.place == PLACE_DUE:
        _unlink(&waiters.due, waiter)
        if fork_thread_exists(&waiter.thread):
            watches_remove(waiter.due_set, &waiter.due_node)
    else:
        _unlink(&waiters.any, waiter)
    waiter.place = PLACE_NONE


cdef void waiter_free(Waiter* waiter) noexcept nogil:
    free(waiter.watches)


cdef Status _attempt(Waiters* waiters, const Tree* tree, Waiter* waiter) noexcept nogil:
    cdef Status status
    while True:
        status = query_answer(tree, &waiter.query, &waiter.answer, &waiter.stamp_ns)
        if status.code != STATUS_OK:
            lacks_find(tree, &waiter.query, status, &waiters.lacks)
        if tree.mirror == NULL or mirror_is_current(tree):
            break
        mirror_catch_up(<Tree*>tree)
    if status.code == STATUS_OK:
        flag_set(&waiter.answered, True)
    else:
        _file(waiters, tree, waiter)
    return status


cdef Status waiters_add(Waiters* waiters, const Tree* tree, Waiter* waiter) noexcept nogil:
    waiters.arrivals += 1
    waiter.arrival = waiters.arrivals
    waiter.due_node.owner = waiter
    waiter.due_node.key = <int64_t>waiter.arrival
    waiter.due_node.priority = _random(waiters)
    return _attempt(waiters, tree, waiter)


cdef void _make_due(Waiters* waiters, Wake* wake, Waiter* waiter) noexcept nogil:
    waiters_remove(waiters, waiter)
    waiters.count += 1
    waiter.place = PLACE_DUE
    waiter.due_set = &wake.due
    fork_record_thread(&waiter.thread)
    _link(&waiters.due, waiter)
    watches_add(&wake.due, &waiter.due_node)


cdef void _take_over_after_fork(Waiters* waiters, Wake* wake) noexcept nogil:
    # In a forked child: what was left to do in threads that do not exist there. The thread that forked was in
    # no wake.
    cdef Waiter* waiter = waiters.due.first
    cdef Waiter* next_waiter
    if waiters.wakes_running:
        wake.change.everything = True
        waiters.wakes_running = 0
    while waiter != NULL:
        next_waiter = waiter.next
        if not fork_thread_exists(&waiter.thread):
            _make_due(waiters, wake, waiter)
        waiter = next_waiter


cdef void wake_begin(Waiters* waiters, Wake* wake) noexcept nogil:
    waiters.wakes += 1
    wake.number = waiters.wakes
    wake.item = 0
    wake.reached = INT64_MIN
    wake.due.root = NULL
    if waiters.generation != fork_generation():
        waiters.generation = fork_generation()
        _take_over_after_fork(waiters, wake)
    waiters.wakes_running += 1


cdef Waiter* _next_to_make_due(Waiters* waiters, Wake* wake) noexcept nogil:
    # A waiter that was filed before the wake began: one that was filed since then has seen the change.
    cdef const ChangeItem* item
    cdef Watches* watches
    cdef Watch* watch
    while wake.item < wake.change.count:
        item = &wake.change.items[wake.item]
        watches = _watches_of(waiters, item.kind, wake.change.frame, item.first)
        # A waiter that is filed again stands behind the others with the same key.
        watch = NULL
        if watches != NULL:
            watch = watches_between(watches, max(item.first, wake.reached), item.last)
        while watch != NULL and watch.key <= item.last:
            wake.reached = watch.key
            if (<Waiter*>watch.owner).filed_at_wake < wake.number:
                return <Waiter*>watch.owner
            watch = watches_next(watch)
        wake.item += 1
        wake.reached = INT64_MIN
    if waiters.any.first != NULL and waiters.any.first.filed_at_wake < wake.number:
        return waiters.any.first
    if not wake.change.everything or waiters.filed.first == NULL:
        return NULL
    return waiters.filed.first if waiters.filed.first.filed_at_wake < wake.number else NULL


cdef uint32_t wake_step(Waiters* waiters, const Tree* tree, Wake* wake, WaiterList* ready) noexcept nogil:
    cdef Waiter* waiter = _next_to_make_due(waiters, wake)
    cdef Watch* node
    cdef uint32_t cost
    if waiter != NULL:
        cost = 1 + waiter.watch_count // WATCHES_PER_INSERT
        _make_due(waiters, wake, waiter)
        return cost
    node = watches_from(&wake.due, INT64_MIN)
    if node == NULL:
        waiters.wakes_running -= 1
        return 0
    waiter = <Waiter*>node.owner
    waiters_remove(waiters, waiter)
    if _attempt(waiters, tree, waiter).code == STATUS_OK and not waiter.deliver(waiter):
        waiter.place = PLACE_READY
        waiter.ready = ready
        fork_record_thread(&waiter.thread)
        _link(ready, waiter)
    return 1 + waiter.watch_count // WATCHES_PER_INSERT


cdef void waiters_free(Waiters* waiters) noexcept nogil:
    free(waiters.frames)
    free(waiters.names)
    lacks_free(&waiters.lacks)


cdef const char* _check_list(const WaiterList* list, Place place, const Tree* tree, bint at_rest,
                             uint32_t* count) noexcept nogil:
    cdef const Waiter* waiter = list.first
    cdef Transform answer
    cdef int64_t stamp_ns
    while waiter != NULL:
        if waiter.place != place or waiter.answered:
            return "a waiter in a list that is not its own"
        if waiter.next != NULL and waiter.next.filed_at_wake < waiter.filed_at_wake:
            return "waiters out of order"
        if at_rest and query_answer(tree, &waiter.query, &answer, &stamp_ns).code == STATUS_OK:
            return "a waiter whose lookup would answer"
        count[0] += 1
        waiter = waiter.next
    return NULL


cdef const char* waiters_check(const Waiters* waiters, const Tree* tree) noexcept nogil:
    cdef uint32_t frame, i
    cdef uint32_t count = 0
    cdef const char* problem = NULL
    # What another process has inserted is told to waiters later.
    cdef bint at_rest = waiters.wakes_running == 0 and tree.mirror == NULL and not tree.is_untold
    for i in range(NAME_SETS if waiters.names != NULL else 0):
        if problem == NULL:
            problem = watches_check(&waiters.names.sets[i])
    for frame in range(waiters.frames_capacity):
        if problem == NULL:
            problem = watches_check(&waiters.frames[frame].data)
        if problem == NULL:
            problem = watches_check(&waiters.frames[frame].parent)
    if problem == NULL:
        problem = _check_list(&waiters.filed, PLACE_FILED, tree, at_rest, &count)
    if problem == NULL:
        problem = _check_list(&waiters.any, PLACE_ANY, tree, at_rest, &count)
    # While a wake is running, due waiters are counted and in none of these lists.
    if problem == NULL and count > waiters.count:
        problem = "waiters miscounted"
    return problem
