"""File waiters under what they lack, and try those that a change can help."""

# Sorted sets of watches: treaps, search trees that random priorities keep shallow.

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
    # The first watch in a range that includes both ends, or NULL. May narrow `lowest` and `highest`.
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
    # The first watch at or after a key, or NULL.
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
    # The next watch in the order of keys, or NULL.
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


# Which changes could help a failed lookup.
#
# A lookup is a walk: it reads the parent and the data of frame after frame at a time. Repeated, it follows
# the same path and fails at the same frame until one of these frames gives another answer. So it lacks a
# CHANGE_FRAME of any frame visited, or data of the frame that had none for the time. A lookup at the latest
# common time may also be helped by another common time.
#
# A wait for another answer than the latest one lacks a later sample of the frame that limits the common time,
# another static transform on the path, or a CHANGE_FRAME there. What changes an answer at the same common
# time otherwise, as a late sample between two others does, is not waited for.
#
# A frame with a single parent keeps it, whatever data is inserted. Any insert is a CHANGE_FRAME of a frame
# with several parents, because which of them answers depends on the neighbours of a sample and on what is
# pruned.
#
# In a tree with loops a walk ends where a frame has no data. So a lookup that ran into a loop may be helped
# by the loss of data anywhere; it is tried at every insert. No other lookup is helped by a loss: if the
# source's walk now ended at a frame that the target's walk reaches, the two would have met before.

cdef void lacks_free(Lacks* lacks) noexcept nogil:
    free(lacks.items)


cdef void lacks_add(Lacks* lacks, ChangeKind kind, FrameId frame, int64_t key) noexcept nogil:
    cdef uint32_t capacity
    cdef void* grown
    if lacks.count == lacks.capacity:
        capacity = lacks.capacity * 2 if lacks.capacity else 16
        grown = realloc(lacks.items, capacity * sizeof(Lack))
        if grown == NULL:
            lacks.unknown = True
            return
        lacks.items = <Lack*>grown
        lacks.capacity = capacity
    lacks.items[lacks.count].kind = kind
    lacks.items[lacks.count].frame = frame
    lacks.items[lacks.count].key = key
    lacks.count += 1


cdef inline void lacks_add_name(Lacks* lacks, const char* name, Py_ssize_t size) noexcept nogil:
    lacks_add(lacks, CHANGE_NAME, NO_FRAME, <int64_t>name_hash(name, <size_t>size))


cdef void lacks_climb(const Tree* tree, FrameId frame, int64_t time_ns, Lacks* lacks) noexcept nogil:
    # Up to the root, or to a frame without data for the time, or once through a loop, which Brent's algorithm
    # detects.
    cdef FrameId marked = frame
    cdef FrameId parent
    cdef uint32_t hops = 0
    cdef uint32_t next_mark = 1
    while True:
        lacks_add(lacks, CHANGE_FRAME, frame, 0)
        parent = tree_parent(tree, frame, time_ns)
        if parent == NO_FRAME:
            lacks_add(lacks, CHANGE_DATA, frame, time_ns)
            return
        if parent == marked or hops > MAX_HOPS:
            return
        hops += 1
        frame = parent
        if hops == next_mark:
            marked = frame
            next_mark *= 2


cdef void lacks_add_side(const Tree* tree, const FrameId* frames, uint32_t count, int64_t time_ns,
                         FrameId* gap, Lacks* lacks) noexcept nogil:
    # One side of a path. `gap`: a frame without data for the time; of several, to watch one is enough.
    cdef uint32_t i
    for i in range(count):
        lacks_add(lacks, CHANGE_FRAME, frames[i], 0)
        if gap[0] == NO_FRAME and history_gap(&tree.histories[frames[i]], time_ns) != GAP_NONE:
            gap[0] = frames[i]


cdef FrameId lacks_add_path(const Tree* tree, const Path* path, int64_t time_ns, Lacks* lacks) noexcept nogil:
    cdef FrameId gap = NO_FRAME
    lacks_add_side(tree, path.target, path.target_hops, time_ns, &gap, lacks)
    lacks_add_side(tree, path.source, path.source_hops, time_ns, &gap, lacks)
    return gap


cdef void lacks_find_at(const Tree* tree, FrameId target, FrameId source, int64_t time_ns,
                        Lacks* lacks) noexcept nogil:
    cdef Path path
    cdef FrameId gap
    cdef bint mixed = False
    if tree.ever_looped or not walk_climb(tree, target, source, time_ns, &path, &mixed):
        lacks_climb(tree, source, time_ns, lacks)
        lacks_climb(tree, target, time_ns, lacks)
        return
    gap = lacks_add_path(tree, &path, time_ns, lacks)
    if gap != NO_FRAME:
        lacks_add(lacks, CHANGE_DATA, gap, time_ns)


cdef void lacks_look_at_side(const Tree* tree, const FrameId* frames, uint32_t count, int64_t common_ns,
                             FrameId* limiting, bint* mixed) noexcept nogil:
    cdef uint32_t i
    for i in range(count):
        if tree.histories[frames[i]].newest_ns == common_ns:
            limiting[0] = frames[i]
        mixed[0] = mixed[0] or tree.parents[frames[i]] & MIXED_PARENTS


cdef void lacks_find_latest(const Tree* tree, FrameId target, FrameId source, Lacks* lacks) noexcept nogil:
    cdef Path path
    cdef int64_t common_ns = 0
    cdef int64_t oldest_ns
    cdef FrameId limiting = NO_FRAME
    cdef FrameId gap
    cdef bint mixed = tree.ever_looped
    cdef bint found = walk_common_time(tree, target, source, &path, &common_ns).code == STATUS_OK
    if tree.ever_looped or not found:
        # In tf2's order a walk depends on the frames above the common ancestor, too.
        lacks_climb(tree, source, NEWEST, lacks)
        lacks_climb(tree, target, NEWEST, lacks)
    if not found:
        return
    lacks_look_at_side(tree, path.source, path.source_hops, common_ns, &limiting, &mixed)
    lacks_look_at_side(tree, path.target, path.target_hops, common_ns, &limiting, &mixed)
    gap = lacks_add_path(tree, &path, common_ns, lacks)
    if limiting == NO_FRAME or (gap == NO_FRAME and not mixed):
        lacks.unknown = True
    elif mixed:
        # At another common time the path may be another one.
        lacks_add(lacks, CHANGE_DATA, limiting, common_ns + 1)
        lacks_find_at(tree, target, source, common_ns, lacks)
    else:
        # Two histories may grow towards each other: one up to where the other begins, or the other one down.
        oldest_ns = tree.histories[gap].oldest_ns
        lacks_add(lacks, CHANGE_DATA, limiting, oldest_ns)
        lacks_add(lacks, CHANGE_DATA, gap, max(oldest_ns - 1, common_ns))


cdef void _lacks_newer_side(const Tree* tree, const FrameId* frames, uint32_t count, int64_t common_ns,
                            bint* has_limit, Lacks* lacks) noexcept nogil:
    cdef const History* history
    cdef uint32_t i
    for i in range(count):
        history = &tree.histories[frames[i]]
        lacks_add(lacks, CHANGE_FRAME, frames[i], 0)
        # At the common time, the path may be another one.
        lacks.unknown = lacks.unknown or tree.parents[frames[i]] & MIXED_PARENTS != 0
        if history.kind == HISTORY_STATIC:
            lacks_add(lacks, CHANGE_DATA, frames[i], 0)     # replaced by another one
        elif history.newest_ns == common_ns and not has_limit[0]:
            # Of several frames that end there, to watch one is enough.
            has_limit[0] = True
            lacks_add(lacks, CHANGE_DATA, frames[i], common_ns + 1)


cdef void lacks_find_newer(const Tree* tree, FrameId target, FrameId source, Lacks* lacks) noexcept nogil:
    # The latest answer is known: another one needs a later common time, or another path or static transform.
    cdef Path path
    cdef int64_t common_ns
    cdef bint has_limit = False
    lacks.unknown = (tree.ever_looped
                     or walk_common_time(tree, target, source, &path, &common_ns).code != STATUS_OK)
    if not lacks.unknown and target != source:
        _lacks_newer_side(tree, path.source, path.source_hops, common_ns, &has_limit, lacks)
        _lacks_newer_side(tree, path.target, path.target_hops, common_ns, &has_limit, lacks)


cdef void lacks_find(const Tree* tree, const Query* query, Status status, Lacks* lacks) noexcept nogil:
    # `status` is that of the failed lookup, under the same hold of the tree's lock. The lookup has no answer
    # before one of the changes happens. One change may not be enough: then what it lacks must be found again.
    cdef FrameId target, source
    cdef int64_t time_ns = query.source_ns
    lacks.count = 0
    lacks.unknown = query.policy.is_given   # not worked out: a history may answer beyond its samples
    if lacks.unknown:
        return
    if status.code == STATUS_BAD_TARGET:
        lacks_add_name(lacks, query.target, query.target_size)
    elif status.code == STATUS_BAD_SOURCE:
        lacks_add_name(lacks, query.source, query.source_size)
    elif status.code == STATUS_BAD_FIXED:
        lacks_add_name(lacks, query.fixed, query.fixed_size)
    elif status.code == STATUS_LOOP:
        lacks.unknown = True
    elif status.code == STATUS_NOT_NEW:
        query_end_frames(tree, query, &target, &source)
        lacks_find_newer(tree, target, source, lacks)
    else:
        # Of a lookup at two times, the half that failed.
        query_end_frames(tree, query, &target, &source)
        if query.fixed != NULL and status.half == HALF_SOURCE:
            target = query_fixed_frame(tree, query)
        elif query.fixed != NULL and status.half == HALF_TARGET:
            source = query_fixed_frame(tree, query)
            time_ns = query.target_ns
        if time_ns == 0:
            lacks_find_latest(tree, target, source, lacks)
        else:
            lacks_find_at(tree, target, source, time_ns, lacks)
    lacks.unknown = lacks.unknown or lacks.count == 0


# The waiters.

cdef enum:
    WATCHES_PER_INSERT = 8      # filing this many costs about as much time as an insert


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


cdef inline Watches* _watches_of(Waiters* waiters, ChangeKind kind, FrameId frame) noexcept nogil:
    # NULL: this was never watched.
    if kind == CHANGE_NAME:
        return &waiters.names
    if frame >= waiters.frames_capacity:
        return NULL
    return &waiters.frames[frame].data if kind == CHANGE_DATA else &waiters.frames[frame].frame


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
    # Sets for `frames` frames, and `count` watches of the waiter. 0; -1: no memory.
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


cdef void _file(Waiters* waiters, const Tree* tree, Waiter* waiter, Status status) noexcept nogil:
    cdef Lacks* lacks = &waiters.lacks
    cdef Lack* lack
    cdef Watch* watch
    cdef uint32_t i
    waiters.count += 1
    waiter.filed_at_wake = waiters.wakes
    lacks_find(tree, &waiter.query, status, lacks)
    if lacks.unknown or _reserve_watches(waiters, tree.capacity, waiter, lacks.count) != 0:
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
        watches_add(_watches_of(waiters, lack.kind, lack.frame), watch)


cdef bint waiters_remove(Waiters* waiters, Waiter* waiter) noexcept nogil:
    cdef Place place = waiter.place
    cdef uint32_t i
    cdef Watch* watch
    waiter.place = PLACE_NONE
    if place == PLACE_NONE or waiter.arrival <= waiters.forgotten:
        return False
    if place == PLACE_READY:
        _unlink(waiter.ready, waiter)
        return False
    waiters.count -= 1
    if place == PLACE_FILED:
        for i in range(waiter.watch_count):
            watch = &waiter.watches[i]
            watches_remove(_watches_of(waiters, <ChangeKind>watch.kind, watch.frame), watch)
        _unlink(&waiters.filed, waiter)
    elif place == PLACE_DUE:
        watches_remove(waiter.due_set, &waiter.due_node)
        _unlink(&waiters.due, waiter)
    else:
        _unlink(&waiters.any, waiter)
    return True


cdef void waiter_free(Waiter* waiter) noexcept nogil:
    free(waiter.watches)


cdef Status _attempt(Waiters* waiters, const Tree* tree, Waiter* waiter) noexcept nogil:
    cdef Transform answer
    cdef int64_t stamp_ns
    cdef Status status = query_answer(tree, &waiter.query, &answer, &stamp_ns)
    if (status.code == STATUS_OK and waiter.only_new and stamp_ns == waiter.stamp_ns
            and memcmp(&answer, &waiter.answer, sizeof(Transform)) == 0):
        status.code = STATUS_NOT_NEW
    if status.code == STATUS_OK:
        waiter.answer = answer
        waiter.stamp_ns = stamp_ns
        flag_set(&waiter.answered, True)
    elif query_is_hopeless(tree, &waiter.query, &status):
        waiter.hopeless = status
        flag_set(&waiter.answered, True)
    else:
        _file(waiters, tree, waiter, status)
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
    _link(&waiters.due, waiter)
    watches_add(&wake.due, &waiter.due_node)


cdef void wake_begin(Waiters* waiters, Wake* wake) noexcept nogil:
    waiters.wakes += 1
    wake.number = waiters.wakes
    wake.item = 0
    wake.reached = INT64_MIN
    wake.due.root = NULL
    waiters.wakes_running += 1


cdef Waiter* _next_to_make_due(Waiters* waiters, Wake* wake) noexcept nogil:
    # A waiter that was filed before the wake began: one that was filed since then has seen the change.
    cdef const ChangeItem* item
    cdef Watches* watches
    cdef Watch* watch
    while wake.item < wake.change.count:
        item = &wake.change.items[wake.item]
        watches = _watches_of(waiters, item.kind, wake.change.frame)
        # A waiter that is filed again comes after the others with the same key.
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
    _attempt(waiters, tree, waiter)
    if waiter.answered and not waiter.deliver(waiter):
        waiter.place = PLACE_READY
        waiter.ready = ready
        _link(ready, waiter)
    return 1 + waiter.watch_count // WATCHES_PER_INSERT


cdef Waiter* waiters_next_ready(Waiters* waiters, const Wake* wake, WaiterList* ready) noexcept nogil:
    cdef Waiter* waiter = ready.first
    if wake.number <= waiters.forgotten_wakes:
        ready.first = ready.last = NULL
        return NULL
    if waiter != NULL:
        waiters_remove(waiters, waiter)
    return waiter


cdef void waiters_forget(Waiters* waiters) noexcept nogil:
    cdef uint32_t frame
    waiters.forgotten = waiters.arrivals
    waiters.forgotten_wakes = waiters.wakes
    waiters.count = waiters.wakes_running = 0
    waiters.filed.first = waiters.any.first = waiters.due.first = NULL
    waiters.filed.last = waiters.any.last = waiters.due.last = NULL
    waiters.names.root = NULL
    for frame in range(waiters.frames_capacity):
        waiters.frames[frame].data.root = waiters.frames[frame].frame.root = NULL


cdef void waiters_free(Waiters* waiters) noexcept nogil:
    free(waiters.frames)
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
        # Late samples may change the answer of one that waits for a change: see above.
        if at_rest and not waiter.only_new and query_answer(
                tree, &waiter.query, &answer, &stamp_ns).code == STATUS_OK:
            return "a waiter whose lookup would answer"
        count[0] += 1
        waiter = waiter.next
    return NULL


cdef const char* waiters_check(const Waiters* waiters, const Tree* tree) noexcept nogil:
    cdef uint32_t frame
    cdef uint32_t count = 0
    cdef const char* problem = watches_check(&waiters.names)
    cdef bint at_rest = waiters.wakes_running == 0
    for frame in range(waiters.frames_capacity):
        if problem == NULL:
            problem = watches_check(&waiters.frames[frame].data)
        if problem == NULL:
            problem = watches_check(&waiters.frames[frame].frame)
    if problem == NULL:
        problem = _check_list(&waiters.filed, PLACE_FILED, tree, at_rest, &count)
    if problem == NULL:
        problem = _check_list(&waiters.any, PLACE_ANY, tree, at_rest, &count)
    # While a wake is running, due waiters are counted and in none of these lists.
    if problem == NULL and count > waiters.count:
        problem = "waiters miscounted"
    return problem
