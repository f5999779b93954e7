# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""File waiters by what they lack, and try those that a change can help."""

# Lists.

cdef inline void _link_before(Link* following, Waiter* waiter) noexcept nogil:
    cdef Link* link = &waiter.link
    link.waiter = waiter
    link.previous = following.previous
    link.next = following
    link.previous.next = link
    following.previous = link


cdef void _append_all(Link* head, Link* taken) noexcept nogil:
    # Moves all links of another list to the end of this one.
    if not links_empty(taken):
        taken.next.previous = head.previous
        head.previous.next = taken.next
        taken.previous.next = head
        head.previous = taken.previous
        links_init(taken)


# What a waiter lacks.

cdef Link* _list_for(Waiters* waiters, const Tree* tree, const Query* query, Status status) noexcept nogil:
    # By the status of a failed lookup. A lookup at a time walks up from both frames. Unless the shape
    # changes, it takes the same way again, and fails again without data in the frame that lacked them. In a
    # loop, data of other frames may also complete a way.
    cdef int64_t time_ns = query.target_ns if status.half == HALF_TARGET else query.source_ns
    if status.code in (STATUS_BAD_TARGET, STATUS_BAD_SOURCE, STATUS_BAD_FIXED):
        return &waiters.shape
    if query.policy.is_given or time_ns == 0:
        return &waiters.every
    if status.code == STATUS_EXTRAPOLATION and tree_has_one_way_up(tree, status.child):
        return &waiters.frames
    return &waiters.shape if status.code == STATUS_UNCONNECTED else &waiters.every


cdef int _watch(Waiters* waiters, const Tree* tree, Waiter* waiter, FrameId frame,
                int64_t time_ns) noexcept nogil:
    # Adds an entry for the waiter to a frame. 0; -1: there is no memory for it.
    cdef Watched* watched
    cdef void* grown
    cdef uint32_t capacity
    if frame >= waiters.watched_capacity:
        grown = realloc(waiters.watched, tree.capacity * sizeof(Watched))
        if grown == NULL:
            return -1
        waiters.watched = <Watched*>grown
        memset(&waiters.watched[waiters.watched_capacity], 0,
               (tree.capacity - waiters.watched_capacity) * sizeof(Watched))
        waiters.watched_capacity = tree.capacity
    watched = &waiters.watched[frame]
    if watched.count == watched.capacity:
        capacity = 2 * watched.capacity + 8
        grown = realloc(watched.entries, capacity * sizeof(WatchEntry))
        if grown == NULL:
            return -1
        watched.entries = <WatchEntry*>grown
        watched.capacity = capacity
    watched.entries[watched.count].time_ns = time_ns
    watched.entries[watched.count].waiter = waiter
    waiter.frame = frame
    waiter.entry = watched.count
    watched.count += 1
    return 0


cdef void _take_out(Waiters* waiters, Waiter* waiter) noexcept nogil:
    # Out of its list, and off the frame that it watches, whose last entry moves to the place of this one.
    cdef Watched* watched
    cdef WatchEntry last
    waiter.link.previous.next = waiter.link.next
    waiter.link.next.previous = waiter.link.previous
    if waiter.frame == NO_FRAME:
        return
    watched = &waiters.watched[waiter.frame]
    watched.count -= 1
    last = watched.entries[watched.count]
    last.waiter.entry = waiter.entry
    watched.entries[waiter.entry] = last
    waiter.frame = NO_FRAME


cdef void _take_concerned(Waiters* waiters, const Watched* watched) noexcept nogil:
    # Moves the waiters that watch a time which the change covers, or after which it refuses data, to `due`:
    # backwards, because entries move forwards, and each to its front, so that they keep the order of their
    # arrival.
    cdef TimeRange covered = waiters.change.covered
    cdef int64_t horizon_ns = waiters.change.horizon_ns
    cdef int64_t last_ns = max(covered.last, horizon_ns)
    cdef int64_t time_ns
    cdef uint32_t i = watched.count
    cdef Waiter* waiter
    while i:
        i -= 1
        time_ns = watched.entries[i].time_ns
        if time_ns > last_ns:
            continue    # most waiters are for a later time
        waiter = watched.entries[i].waiter
        if (covered.first <= time_ns <= covered.last
                or (time_ns < horizon_ns and waiter.until_refused)):
            _take_out(waiters, waiter)
            _link_before(waiters.due.next, waiter)


# Waiting.

cdef void waiters_init(Waiters* waiters) noexcept nogil:
    links_init(&waiters.frames)
    links_init(&waiters.shape)
    links_init(&waiters.every)
    links_init(&waiters.due)
    waiters.ready = NULL


cdef bint waiters_remove(Waiters* waiters, Waiter* waiter) noexcept nogil:
    cdef bint is_listed = waiter.is_listed and waiter.arrival > waiters.forgotten
    waiter.is_listed = False
    if not is_listed:
        return False
    _take_out(waiters, waiter)
    if waiter.answered:
        return False
    waiters.count -= 1
    return True


cdef bint _is_answer(Status status) noexcept nogil:
    # A limit that could never apply ends a wait when the rest of the lookup has an answer.
    return status.code == STATUS_OK or (status.code == STATUS_BAD_LIMIT and status.gap == GAP_NONE)


cdef bint _is_refused(const Tree* tree, const Waiter* waiter, const Status* status) noexcept nogil:
    # Whether the tree refuses the data that the lookup lacks, of a frame on the path of the newest samples.
    # Otherwise the frames may still be connected in another way.
    cdef const History* history = &tree.histories[status.child]
    cdef Path path
    cdef FrameId target, source
    cdef int64_t newest_ns
    cdef uint32_t i
    if (not waiter.until_refused or status.code != STATUS_EXTRAPOLATION or waiter.query.source_ns == 0
            or status.requested_ns >= history_horizon(history, &tree.retention, history.newest_ns)
            or query_end_frames(tree, &waiter.query, &target, &source).code != STATUS_OK
            or walk_common_time(tree, target, source, &path, &newest_ns).code != STATUS_OK):
        return False
    for i in range(path.source_hops):
        if path.source[i] == status.child:
            return True
    for i in range(path.target_hops):
        if path.target[i] == status.child:
            return True
    return False


cdef Status _attempt(Waiters* waiters, const Tree* tree, Waiter* waiter) noexcept nogil:
    cdef Transform answer
    cdef int64_t stamp_ns
    cdef Status status = query_answer(tree, &waiter.query, &answer, &stamp_ns)
    cdef Link* head
    if (status.code == STATUS_OK and waiter.only_new and stamp_ns == waiter.previous_ns
            and memcmp(&answer, &waiter.previous, sizeof(Transform)) == 0):
        status.code = STATUS_NOT_NEW
    if _is_answer(status) or _is_refused(tree, waiter, &status):
        waiter.status = status
        waiter.answer = answer
        waiter.stamp_ns = stamp_ns
        store_release(&waiter.answered, True)
        return status
    if asks_for_1970(&waiter.query, &status):
        waiters.in_1970_ns = status.requested_ns
    head = _list_for(waiters, tree, &waiter.query, status)
    if head == &waiters.frames and _watch(waiters, tree, waiter, status.child, status.requested_ns) != 0:
        head = &waiters.every
    _link_before(head, waiter)
    waiter.is_listed = True
    waiters.count += 1
    return status


cdef Status waiters_add(Waiters* waiters, const Tree* tree, Waiter* waiter) noexcept nogil:
    waiters.arrivals += 1
    waiter.arrival = waiters.arrivals
    return _attempt(waiters, tree, waiter)


cdef void wake_begin(Waiters* waiters, Link* ready) noexcept nogil:
    cdef FrameId frame = waiters.change.frame
    cdef Waiter* waiter
    if waiters.change.shape:
        while not links_empty(&waiters.frames):
            waiter = waiters.frames.next.waiter
            _take_out(waiters, waiter)
            _link_before(&waiters.due, waiter)
        _append_all(&waiters.due, &waiters.shape)
    elif frame < waiters.watched_capacity:
        _take_concerned(waiters, &waiters.watched[frame])
    _append_all(&waiters.due, &waiters.every)
    if not links_empty(&waiters.due):
        waiters.ready = ready


cdef void wake_step(Waiters* waiters, const Tree* tree) noexcept nogil:
    cdef Waiter* waiter = waiters.due.next.waiter
    cdef Link* ready = waiters.ready
    cdef Link* link
    if waiter == NULL:
        waiters.ready = NULL    # it has been removed meanwhile
        return
    waiters_remove(waiters, waiter)
    _attempt(waiters, tree, waiter)
    if waiter.answered and waiter.woken != NULL:
        event_set(waiter.woken)
    elif waiter.answered:
        # Nearly always, the last one has arrived before it.
        link = ready.previous
        while link != ready and link.waiter.arrival > waiter.arrival:
            link = link.previous
        _link_before(link.next, waiter)
        waiter.is_listed = True
    if links_empty(&waiters.due):
        waiters.ready = NULL


cdef Waiter* waiters_next_ready(Waiters* waiters, Link* ready) noexcept nogil:
    cdef Waiter* waiter
    if links_empty(ready) or ready.next.waiter.arrival <= waiters.forgotten:
        return NULL
    waiter = ready.next.waiter
    waiters_remove(waiters, waiter)
    return waiter


cdef void waiters_forget(Waiters* waiters) noexcept nogil:
    cdef uint32_t frame
    waiters.forgotten = waiters.arrivals
    waiters.count = 0
    waiters_init(waiters)
    for frame in range(waiters.watched_capacity):
        waiters.watched[frame].count = 0


cdef void waiters_free(Waiters* waiters) noexcept nogil:
    cdef uint32_t frame
    for frame in range(waiters.watched_capacity):
        free(waiters.watched[frame].entries)
    free(waiters.watched)


cdef const char* waiters_check(const Waiters* waiters, const Tree* tree) noexcept nogil:
    cdef const Link* heads[3]
    cdef const Link* link
    cdef const Waiter* waiter
    cdef Transform answer
    cdef Status status
    cdef int64_t stamp_ns
    cdef uint32_t count = 0
    cdef int i
    heads[0], heads[1], heads[2] = &waiters.frames, &waiters.shape, &waiters.every
    for i in range(3):
        link = heads[i].next
        while link != heads[i]:
            waiter = link.waiter
            if link.next.previous != link or not waiter.is_listed or waiter.answered:
                return "a waiter in a list that is not its own"
            if (waiter.frame != NO_FRAME) != (i == 0):
                return "a waiter that watches a frame in another list"
            if i == 0 and waiters.watched[waiter.frame].entries[waiter.entry].waiter != waiter:
                return "a waiter whose entry is not its own"
            status = query_answer(tree, &waiter.query, &answer, &stamp_ns)
            # Exempt: late samples may change the answer of a waiter with `only_new`, and the clock may change
            # the answer of a waiter that judges ages.
            if (not waiter.only_new
                    and not (waiter.query.policy.is_given and waiter.query.policy.judges_age)
                    and _is_answer(status)):
                return "a waiter whose lookup would answer"
            # Another frame of its path may refuse data, too.
            if status.child == waiter.frame and _is_refused(tree, waiter, &status):
                return "a waiter whose data is refused"
            count += 1
            link = link.next
    # Those that are due are counted, too.
    if count > waiters.count:
        return "waiters miscounted"
    return NULL
