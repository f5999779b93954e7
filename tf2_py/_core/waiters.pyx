"""Owns who waits for what, so that an insert looks only at waiters that it can help."""

from libc.stdint cimport INT64_MIN, int64_t, uint8_t, uint32_t, uint64_t
from libc.stdlib cimport free, malloc, realloc
from libc.string cimport memset

from tf2_py._core.forking cimport fork_generation, fork_is_here, fork_note
from tf2_py._core.lacks cimport Lack, Lacks, lacks_find, lacks_free
from tf2_py._core.lookup cimport query_answer
from tf2_py._core.tree cimport CHANGE_DATA, CHANGE_NAME, ChangeKind, Changed, Tree
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
    WATCHES = 8     # to file so many costs about as much as an insert


cdef inline void _link(WaiterList* list, Waiter* waiter) noexcept nogil:
    waiter.after = NULL
    waiter.before = list.last
    if list.last != NULL:
        list.last.after = waiter
    else:
        list.first = waiter
    list.last = waiter


cdef inline void _unlink(WaiterList* list, Waiter* waiter) noexcept nogil:
    if waiter.before != NULL:
        waiter.before.after = waiter.after
    else:
        list.first = waiter.after
    if waiter.after != NULL:
        waiter.after.before = waiter.before
    else:
        list.last = waiter.before


cdef uint32_t _draw(Waiters* waiters) noexcept nogil:
    # splitmix64 (Steele, Lea, Flood 2014)
    cdef uint64_t mixed
    waiters.draws += <uint64_t>0x9E3779B97F4A7C15
    mixed = waiters.draws
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
    # NULL: nobody has ever watched this.
    if kind == CHANGE_NAME:
        if waiters.names == NULL or _name_count(waiters, key)[0] == 0:
            return NULL
        return &waiters.names.sets[key & (NAME_SETS - 1)]
    if frame >= waiters.frames_capacity:
        return NULL
    return &waiters.frames[frame].data if kind == CHANGE_DATA else &waiters.frames[frame].parent


cdef int _reserve_frames(Waiters* waiters, uint32_t capacity) noexcept nogil:
    cdef void* grown
    if capacity <= waiters.frames_capacity:
        return 0
    grown = realloc(waiters.frames, capacity * sizeof(FrameWatches))
    if grown == NULL:
        return -1
    waiters.frames = <FrameWatches*>grown
    memset(&waiters.frames[waiters.frames_capacity], 0,
           (capacity - waiters.frames_capacity) * sizeof(FrameWatches))
    waiters.frames_capacity = capacity
    return 0


cdef int _reserve_names(Waiters* waiters) noexcept nogil:
    if waiters.names != NULL:
        return 0
    waiters.names = <NameWatches*>malloc(sizeof(NameWatches))
    if waiters.names == NULL:
        return -1
    # Touched here, all of it, and not page by page by the inserts to come.
    memset(waiters.names, 0, sizeof(NameWatches))
    return 0


cdef int _reserve_watches(Waiter* waiter, uint32_t capacity) noexcept nogil:
    cdef void* grown
    if capacity <= waiter.watch_capacity:
        return 0
    grown = realloc(waiter.watches, capacity * sizeof(Watch))
    if grown == NULL:
        return -1
    waiter.watches = <Watch*>grown
    waiter.watch_capacity = capacity
    return 0


cdef void _file(Waiters* waiters, const Tree* tree, Waiter* waiter, Status status) noexcept nogil:
    cdef Lacks* lacks = &waiters.lacks
    cdef Lack* lack
    cdef Watch* watch
    cdef uint32_t i
    waiters.count += 1
    waiter.filed = waiters.wakes
    lacks_find(tree, &waiter.query, status, lacks)
    if (lacks.unknown or _reserve_frames(waiters, tree.capacity) or _reserve_watches(waiter, lacks.count)
            or (lacks.items[0].kind == CHANGE_NAME and _reserve_names(waiters))):
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
        watch.priority = _draw(waiters)
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
        # In a forked child the list may have been on the stack of somebody who is not there.
        if fork_is_here(&waiter.whose):
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
        if fork_is_here(&waiter.whose):
            watches_remove(waiter.turns, &waiter.turn)
    else:
        _unlink(&waiters.any, waiter)
    waiter.place = PLACE_NONE


cdef void waiter_free(Waiter* waiter) noexcept nogil:
    free(waiter.watches)


cdef Status _attempt(Waiters* waiters, const Tree* tree, Waiter* waiter) noexcept nogil:
    cdef Status status = query_answer(tree, &waiter.query, &waiter.answer, &waiter.stamp_ns)
    if status.code == STATUS_OK:
        waiter.answered = True
    else:
        _file(waiters, tree, waiter, status)
    return status


cdef Status waiters_add(Waiters* waiters, const Tree* tree, Waiter* waiter) noexcept nogil:
    waiters.arrivals += 1
    waiter.arrival = waiters.arrivals
    waiter.turn.owner = waiter
    waiter.turn.key = <int64_t>waiter.arrival
    waiter.turn.priority = _draw(waiters)
    return _attempt(waiters, tree, waiter)


cdef void _make_due(Waiters* waiters, Wake* wake, Waiter* waiter) noexcept nogil:
    waiters_remove(waiters, waiter)
    waiters.count += 1
    waiter.place = PLACE_DUE
    waiter.turns = &wake.due
    fork_note(&waiter.whose)
    _link(&waiters.due, waiter)
    watches_add(&wake.due, &waiter.turn)


cdef void _adopt(Waiters* waiters, Wake* wake) noexcept nogil:
    # In a forked child: what was under way in threads that are not here. The one that is here forks in no
    # wake.
    cdef Waiter* waiter = waiters.due.first
    if waiters.waking:
        wake.change.everything = True
        waiters.waking = 0
    cdef Waiter* after
    while waiter != NULL:
        after = waiter.after
        if not fork_is_here(&waiter.whose):
            _make_due(waiters, wake, waiter)
        waiter = after


cdef void wake_begin(Waiters* waiters, Wake* wake) noexcept nogil:
    waiters.wakes += 1
    wake.number = waiters.wakes
    wake.changed = 0
    wake.reached = INT64_MIN
    wake.due.root = NULL
    if waiters.generation != fork_generation():
        waiters.generation = fork_generation()
        _adopt(waiters, wake)
    waiters.waking += 1


cdef Waiter* _next_watcher(Waiters* waiters, Wake* wake) noexcept nogil:
    # One that was there when the wake began; who has been filed again since then has seen the change.
    cdef const Changed* changed
    cdef Watches* watches
    cdef Watch* watch
    while wake.changed < wake.change.count:
        changed = &wake.change.changed[wake.changed]
        watches = _watches_of(waiters, changed.kind, wake.change.frame, changed.first)
        # Of equal keys, whoever is filed again comes behind the others.
        watch = NULL
        if watches != NULL:
            watch = watches_between(watches, max(changed.first, wake.reached), changed.last)
        while watch != NULL and watch.key <= changed.last:
            wake.reached = watch.key
            if (<Waiter*>watch.owner).filed < wake.number:
                return <Waiter*>watch.owner
            watch = watches_next(watch)
        wake.changed += 1
        wake.reached = INT64_MIN
    if waiters.any.first != NULL and waiters.any.first.filed < wake.number:
        return waiters.any.first
    if wake.change.everything and waiters.filed.first != NULL and waiters.filed.first.filed < wake.number:
        return waiters.filed.first
    return NULL


cdef uint32_t wake_step(Waiters* waiters, const Tree* tree, Wake* wake, WaiterList* ready) noexcept nogil:
    # First all whom the change concerns become due, then they are tried in the order in which they came.
    cdef Waiter* waiter = _next_watcher(waiters, wake)
    cdef Watch* turn
    cdef uint32_t cost
    if waiter != NULL:
        cost = 1 + waiter.watch_count // WATCHES
        _make_due(waiters, wake, waiter)
        return cost
    turn = watches_from(&wake.due, INT64_MIN)
    if turn == NULL:
        waiters.waking -= 1
        return 0
    waiter = <Waiter*>turn.owner
    waiters_remove(waiters, waiter)
    if _attempt(waiters, tree, waiter).code == STATUS_OK and not waiter.deliver(waiter):
        waiter.place = PLACE_READY
        waiter.ready = ready
        fork_note(&waiter.whose)
        _link(ready, waiter)
    return 1 + waiter.watch_count // WATCHES


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
        if waiter.after != NULL and waiter.after.filed < waiter.filed:
            return "waiters out of order"
        if at_rest and query_answer(tree, &waiter.query, &answer, &stamp_ns).code == STATUS_OK:
            return "a waiter whose lookup would answer"
        count[0] += 1
        waiter = waiter.after
    return NULL


cdef const char* waiters_check(const Waiters* waiters, const Tree* tree) noexcept nogil:
    cdef uint32_t frame, i
    cdef uint32_t count = 0
    cdef const char* problem = NULL
    for i in range(NAME_SETS if waiters.names != NULL else 0):
        if problem == NULL:
            problem = watches_check(&waiters.names.sets[i])
    for frame in range(waiters.frames_capacity):
        if problem == NULL:
            problem = watches_check(&waiters.frames[frame].data)
        if problem == NULL:
            problem = watches_check(&waiters.frames[frame].parent)
    if problem == NULL:
        problem = _check_list(&waiters.filed, PLACE_FILED, tree, waiters.waking == 0, &count)
    if problem == NULL:
        problem = _check_list(&waiters.any, PLACE_ANY, tree, waiters.waking == 0, &count)
    # Those that are due have left the lists: an insert is under way.
    if problem == NULL and count > waiters.count:
        problem = "waiters miscounted"
    return problem
