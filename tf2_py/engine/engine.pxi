# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Insert, look up and wait: the tree under its lock, and what follows outside the lock."""

# Limits how often something is logged, so that a flood of messages does not become a flood of lines.

cdef int64_t PERIOD_NS = 1000000000
cdef int64_t DISPLACED_PERIOD_NS = 600 * PERIOD_NS

# What counts as the time of a clock that has not begun.
cdef int64_t NOT_BEGUN_NS = 1

cdef enum:
    LINES_PER_SECOND = 20


cdef class Throttle:
    """Lets each key pass once in a second, and at most LINES_PER_SECOND keys."""

    # Read and written with the GIL held.
    cdef set _passed
    cdef int64_t _until_ns      # steady time at which another second begins
    cdef uint64_t unlogged      # how often there were too many keys

    cpdef bint passes(self, what) except -1:
        """Whether a line about ``what``, hashable, is to be logged now."""
        cdef int64_t now_ns = monotonic_ns()
        if now_ns >= self._until_ns:
            self._passed, self._until_ns = set(), now_ns + PERIOD_NS
        if what in self._passed:
            return False
        if len(self._passed) == LINES_PER_SECOND:
            self.unlogged += 1
            return False
        self._passed.add(what)
        return True


# The self check of debug builds, which are compiled with ``-DTF2_SELF_CHECK``: releasing a lock after writing
# checks every invariant of what it guards, and ends the process if one does not hold.

cdef extern from *:
    """
    #ifdef TF2_SELF_CHECK
    #include <stdio.h>
    #include <stdlib.h>
    #define TF2_SELF_CHECKS 1
    #define tf2_broken(problem) (fprintf(stderr, "tf2 self check: %s\\n", problem), abort())
    #else
    #define TF2_SELF_CHECKS 0
    #define tf2_broken(problem) ((void)(problem))
    #endif
    """
    bint SELF_CHECKS "TF2_SELF_CHECKS"
    void _broken "tf2_broken"(const char* problem) nogil

cdef enum:
    MOST_CHECKED = 2000     # names and samples; checking a larger buffer each time would take too long


cdef const char* _problem(const Tree* tree, const Waiters* waiters) noexcept nogil:
    cdef const char* problem = tree_check(tree)
    return waiters_check(waiters, tree) if problem == NULL else problem


cdef inline void unlock_written(Lock* lock, const Tree* tree, const Waiters* waiters) noexcept nogil:
    cdef const char* problem = NULL
    if SELF_CHECKS and tree.names.count + tree.authorities.count + tree.samples <= MOST_CHECKED:
        problem = _problem(tree, waiters)
    if problem != NULL:
        _broken(problem)
    lock_release(lock)


# The engine.

cdef str NO_CLOCK = ("ages need a clock, which this buffer does not have: a BufferCore and the buffer of a "
                     "recording have none")
cdef Limits NO_LIMITS
NO_LIMITS.frames = UINT32_MAX
NO_LIMITS.bytes = SIZE_MAX
cdef Retention DEFAULT_RETENTION
DEFAULT_RETENTION.cache_time_ns = 10 * <int64_t>NS_PER_S    # as tf2's


cdef void _forget_waiters(void* owner) noexcept nogil:
    waiters_forget(&(<Engine>owner)._waiters)


@cython.no_gc_clear
cdef class Engine:
    """The tree of a BufferCore, and all that is done to it under its lock."""

    def __cinit__(self, *args, **kwargs):
        if lock_init(&self._lock) != 0:
            raise MemoryError
        waiters_init(&self._waiters)
        self._forked.owner = <void*>self
        self._forked.in_child = _forget_waiters
        fork_watch(&self._forked, &self._lock)
        if tree_init(&self._tree, &DEFAULT_RETENTION, &NO_LIMITS) != 0:
            raise MemoryError
        self._throttle, self._refusals = Throttle(), Throttle()
        self._advice = Advice()
        self._names, self._authorities = [], []
        # As if it was read now, so that the first reading notices a step since.
        self._clock.is_system = True
        self._clock.now_ns = system_ns()

    def __dealloc__(self):
        cdef ReadHook inbox = self._inboxes
        while inbox is not None:
            inbox.engine_ended()
            inbox = inbox.following
        fork_forget(&self._forked)
        # No waiter is left: each owner holds its engine.
        waiters_free(&self._waiters)
        with nogil:
            tree_free(&self._tree)
        lock_free(&self._lock)

    cdef int add_inbox(self, ReadHook inbox) except -1:
        inbox.following = self._inboxes
        self._inboxes = inbox
        lock_acquire(&self._lock)
        if self._waiters.count:
            store_seq_cst(inbox.has_waiters, 1)
        unlock_written(&self._lock, &self._tree, &self._waiters)
        return 0

    cdef int remove_inbox(self, ReadHook inbox) except -1:
        cdef ReadHook one = self._inboxes
        if one is inbox:
            self._inboxes = inbox.following
        else:
            while one is not None and one.following is not inbox:
                one = one.following
            if one is None:
                return 0
            one.following = inbox.following
        inbox.following = None
        self._removals += 1
        return 0

    cdef int drain_inboxes(self) except -1:
        cdef ReadHook inbox = self._inboxes
        cdef uint64_t removals
        while inbox is not None:
            if load_seq_cst(inbox.read) != RECENTLY:
                store_seq_cst(inbox.read, RECENTLY)
            removals = self._removals
            if load_seq_cst(inbox.unread):
                inbox.drain()   # meanwhile another thread may remove some
            inbox = inbox.following if self._removals == removals else self._inboxes
        return 0

    cdef void set_has_waiters(self) noexcept:
        cdef ReadHook inbox = self._inboxes
        while inbox is not None:
            store_seq_cst(inbox.has_waiters, 1)
            inbox = inbox.following

    cdef void clear_has_waiters(self, uint32_t* has_waiters) noexcept nogil:
        # Under the lock: a waiter is added under it, and the inboxes are marked there.
        lock_acquire(&self._lock)
        if self._waiters.count == 0:
            store_seq_cst(has_waiters, 0)
        unlock_written(&self._lock, &self._tree, &self._waiters)

    cdef void insert(self, Batch* batch):
        batch_begin(batch)
        if self.insert_some(batch):
            with nogil:
                while self.insert_some(batch):
                    pass

    cdef bint insert_some(self, Batch* batch) noexcept nogil:
        cdef uint32_t authority = 0
        cdef uint64_t work, displaced
        cdef int64_t left = SLICE
        cdef bint is_waking
        lock_acquire(&self._lock)
        displaced = self._tree.displaced
        if batch.done < batch.count:
            # Each time, because the buffer may have been emptied meanwhile, with its names.
            authority = tree_authority(&self._tree, batch.authority, batch.authority_size)
            batch.no_memory = batch.no_memory or authority == NAME_NO_MEMORY
        while left > 0:
            is_waking = self._waiters.ready == &batch.ready
            if is_waking or (self._waiters.ready != NULL and batch.done < batch.count):
                wake_step(&self._waiters, &self._tree)
                left -= INSERTS_PER_TRY
            elif batch.done < batch.count:
                work = self._tree.work
                self._insert_next(batch, authority)
                left -= <int64_t>(1 + self._tree.work - work)
            else:
                break
        if self._waiters.in_1970_ns:
            batch.in_1970_ns = self._waiters.in_1970_ns
            self._waiters.in_1970_ns = 0
        self._note_displaced(batch, displaced)
        batch.needs_report = (batch.refused > 0 or batch.unnormalized > 0 or batch.no_memory
                              or not links_empty(&batch.ready) or batch.in_1970_ns != 0
                              or batch.displaced > 0)
        is_waking = self._waiters.ready == &batch.ready
        unlock_written(&self._lock, &self._tree, &self._waiters)
        return is_waking or batch.done < batch.count

    cdef void _note_displaced(self, Batch* batch, uint64_t before) noexcept nogil:
        # A full buffer stays full, and most inserts displace a sample then.
        cdef int64_t now_ns = monotonic_ns() if self._tree.displaced != before else INT64_MIN
        if now_ns >= self._displaced_due_ns:
            self._displaced_due_ns = now_ns + DISPLACED_PERIOD_NS
            batch.displaced = self._tree.displaced

    cdef void finish_wakes(self) noexcept nogil:
        # So that whatever waits for what is inserted has its answer.
        self._lock_when_none_is_due()
        unlock_written(&self._lock, &self._tree, &self._waiters)

    cdef void _insert_next(self, Batch* batch, uint32_t authority) noexcept nogil:
        cdef Entry* entry = &batch.entries[batch.done]
        cdef Change* change = &self._waiters.change if self._waiters.count else NULL
        batch.done += 1
        entry.refused = 0
        entry.unnormalized = False
        if batch.no_memory:
            return
        entry.refused = tree_insert(&self._tree, &entry.incoming, authority, batch.is_static, change)
        if entry.refused == 0:
            batch.taken += 1
            if is_unnormalized(entry.incoming.squared_length) and tree_mark_unnormalized(&self._tree):
                entry.unnormalized = True
                batch.unnormalized += 1
        elif entry.refused == TREE_NO_MEMORY:
            entry.refused = 0
            batch.no_memory = True
        else:
            batch.refused += 1
        if change != NULL:
            wake_begin(&self._waiters, &batch.ready)

    cdef void replace(self, Batch* batch) noexcept nogil:
        cdef Replacing replacing
        cdef uint64_t displaced
        cdef uint32_t authority
        batch_begin(batch)
        batch.no_memory = replacing_begin(&replacing, batch) != 0
        if not batch.no_memory:
            self._lock_when_none_is_due()
            displaced = self._tree.displaced
            authority = tree_authority(&self._tree, batch.authority, batch.authority_size)
            batch.no_memory = (authority == NAME_NO_MEMORY
                               or not replacing_apply(&replacing, &self._tree, batch, authority))
            if not batch.no_memory:
                change_begin(&self._waiters.change, True)
                wake_begin(&self._waiters, &batch.ready)
            self._note_displaced(batch, displaced)
            unlock_written(&self._lock, &self._tree, &self._waiters)
        replacing_free(&replacing)
        batch.done = batch.count
        while self.insert_some(batch):      # only wakes
            pass

    cdef int report(self, Batch* batch, object hand_over) except -1:
        error = self._deliver(batch, hand_over)
        self._log_refused(batch)
        self._log_unnormalized(batch)
        if batch.in_1970_ns:
            self.log_1970(batch.in_1970_ns)
            batch.in_1970_ns = 0
        if batch.displaced:
            log.displaced(batch.displaced, self._tree.limits.bytes)
            batch.displaced = 0
        if error is not None:
            raise error
        if batch.no_memory:
            raise MemoryError
        return 0

    cdef int _log_refused(self, Batch* batch) except -1:
        # Only what is printed is converted to text.
        cdef Throttle throttle = self._refusals
        cdef const Entry* entry
        cdef uint64_t hashed
        cdef size_t i
        for i in range(batch.count if batch.refused else 0):
            entry = &batch.entries[i]
            hashed = name_hash(entry.incoming.child, entry.incoming.child_size)
            if entry.refused and throttle.passes((hashed, entry.refused)):
                child = name_for_log(entry.incoming.child, entry.incoming.child_size)
                self._advice.remember_refused(child, entry.refused)
                log.refused(
                    entry.refused,
                    name_for_log(entry.incoming.parent, entry.incoming.parent_size),
                    child,
                    name_for_log(batch.authority, batch.authority_size),
                    entry.incoming.stamp_ns,
                )
        if throttle.unlogged and self._throttle.passes("refusals"):
            log.not_logged(throttle.unlogged)
            throttle.unlogged = 0
        return 0

    cdef int _log_unnormalized(self, Batch* batch) except -1:
        # Once for each frame, except for those beyond the throttle's limit.
        cdef const Entry* entry
        cdef size_t i
        for i in range(batch.count if batch.unnormalized else 0):
            entry = &batch.entries[i]
            if entry.unnormalized and self._throttle.passes(
                    name_hash(entry.incoming.child, entry.incoming.child_size)):
                log.unnormalized(
                    sqrt(entry.incoming.squared_length),
                    name_for_log(entry.incoming.parent, entry.incoming.parent_size),
                    name_for_log(entry.incoming.child, entry.incoming.child_size),
                    name_for_log(batch.authority, batch.authority_size),
                )
        return 0

    cdef int log_1970(self, int64_t time_ns) except -1:
        if self._throttle.passes("1970"):
            log.in_1970(time_ns)
        return 0

    cdef void count_malformed(self) noexcept nogil:
        add_seq_cst(&self._malformed, 1)

    cdef object malformed(self, const Batch* batch, size_t size, str topic=None):
        error = batch_error(batch, size)
        if topic is not None and self._throttle.passes(topic):
            log.malformed(topic, str(error))
        return error

    cdef object _deliver(self, Batch* batch, object hand_over):
        # One at a time, because callbacks may insert, wait or cancel. All are called, even if one raises.
        # Only that may need memory: what is left in the list of a batch would point into freed memory.
        cdef Waiter* waiter
        cdef WaiterOwner owner
        error = None
        while not links_empty(&batch.ready):    # whoever else removes one has the GIL, too
            lock_acquire(&self._lock)
            waiter = waiters_next_ready(&self._waiters, &batch.ready)
            unlock_written(&self._lock, &self._tree, &self._waiters)
            if waiter == NULL:
                break       # this is a child, which a callback has forked
            try:
                # The owner still exists: it removes its waiter, with the GIL, before it is destroyed. It must
                # not be destroyed while it delivers.
                owner = <WaiterOwner>waiter.owner
                try:
                    call = owner.deliver()
                except BaseException as interrupt:
                    # What a signal handler has raised. Nothing else would deliver the answer.
                    error = interrupt if error is None else error
                    call = owner.deliver()
                owner = None
                if call is not None and hand_over is not None:
                    hand_over(call)
                    continue
                while call is not None:
                    call = call()
            except BaseException as raised:
                error = raised if error is None else error
        return error

    cdef bint remove(self, const char* name, size_t size, object hand_over=None) except -1:
        cdef Batch batch
        cdef bint had_samples = True
        cdef FrameId frame
        catch_up(self)
        self._lock_when_none_is_due()
        if name == NULL:
            tree_clear(&self._tree)
        else:
            frame = tree_frame(&self._tree, name, size)
            had_samples = frame != NO_FRAME and tree_forget(&self._tree, frame)
        # Less data may end a loop, and the waiters are no longer filed by what they lack.
        self._begin_to_wake_all(&batch)
        unlock_written(&self._lock, &self._tree, &self._waiters)
        self._advice.forget()
        self._wake_all(&batch, hand_over)
        return had_samples

    cdef int start_over(self, const Retention* retention, const Limits* limits) except -1:
        cdef Tree empty
        memset(&empty, 0, sizeof(Tree))
        if tree_init(&empty, retention, limits) != 0:
            tree_free(&empty)
            raise MemoryError
        return self._replace_tree(&empty)

    cdef dict state(self):
        cdef bint equals_file
        catch_up(self)
        lock_acquire(&self._lock)
        equals_file = self._tree.equals_file
        lock_release(&self._lock)
        frozen = self._frozen
        if equals_file and frozen is not None and frozen.is_there():
            return frozen.as_state()
        # As an array, because pickles of protocol 5 need not copy one.
        import numpy as np
        image = write_frozen(&self._tree, &self._lock, None, self._names, self._authorities)
        return {"image": np.frombuffer(image, np.uint8)}

    cdef int restore(self, image) except -1:
        cdef Tree restored
        catch_up(self)
        read_image(image, &restored)
        return self._replace_tree(&restored)

    cdef int write_frozen(self, file) except -1:
        catch_up(self)
        write_frozen(&self._tree, &self._lock, file, self._names, self._authorities)
        return 0

    cdef int open_frozen(self, path, expected) except -1:
        cdef Tree opened
        catch_up(self)
        frozen = read_frozen(path, expected, &opened)
        return self._replace_tree(&opened, frozen)

    cdef int _replace_tree(self, const Tree* tree, frozen=None) except -1:
        cdef Tree old
        cdef Batch batch
        cdef list names = []
        cdef list authorities = []
        self._lock_when_none_is_due()
        old = self._tree
        self._tree = tree[0]
        # The waiters watch the old tree's frames.
        self._begin_to_wake_all(&batch)
        unlock_written(&self._lock, &self._tree, &self._waiters)
        self._names, self._authorities, self._frozen = names, authorities, frozen
        with nogil:
            tree_free(&old)
        store_seq_cst(&self._malformed, 0)
        self._advice.forget()
        return self._wake_all(&batch)

    cdef void _lock_when_none_is_due(self) noexcept nogil:
        # To change the tree otherwise than by an insert, which would also wait for the end of a wake.
        cdef int64_t left = SLICE
        lock_acquire(&self._lock)
        while self._waiters.ready != NULL:
            wake_step(&self._waiters, &self._tree)
            left -= INSERTS_PER_TRY
            if left <= 0:
                unlock_written(&self._lock, &self._tree, &self._waiters)
                lock_acquire(&self._lock)
                left = SLICE

    cdef void _begin_to_wake_all(self, Batch* batch) noexcept nogil:
        # As after an insert that may complete every waiter. With the lock held.
        batch.count = 0
        batch_begin(batch)
        change_begin(&self._waiters.change, True)
        wake_begin(&self._waiters, &batch.ready)

    cdef int _wake_all(self, Batch* batch, object hand_over=None) except -1:
        with nogil:
            while self.insert_some(batch):
                pass
        error = self._deliver(batch, hand_over)
        if error is not None:
            raise error
        return 0

    cdef Status lookup(self, const Query* query, Transform* out, int64_t* stamp_ns) noexcept nogil:
        cdef Status status
        lock_acquire(&self._lock)
        status = query_answer(&self._tree, query, out, stamp_ns)
        lock_release(&self._lock)
        return status

    cdef object explanation(self, Query* query):
        cdef ClockReading reading
        cdef Explained explained
        cdef Status status
        cdef int problem
        cdef bint has_clock = self.has_read_clock(query, &reading)
        if query.policy.is_given and query.policy.judges_age and not has_clock:
            raise ValueError(NO_CLOCK)
        catch_up(self)
        lock_acquire(&self._lock)
        problem = query_explain(&self._tree, query, &explained, &status)
        lock_release(&self._lock)
        try:
            if problem != 0:
                raise MemoryError
            if status.code != STATUS_OK:
                raise self.error(query, status)
            # The GIL was held since, so that they are those of the same tree.
            learn_names(&self._tree.names, &self._lock, self._names)
            learn_names(&self._tree.authorities, &self._lock, self._authorities)
            return new_explanation(query, &explained, &reading if has_clock else NULL, self._names,
                                   self._authorities)
        finally:
            explained_free(&explained)

    cdef int read_clock(self, Query* query, ClockReading* reading) except -1:
        if not self.has_read_clock(query, reading):
            raise ValueError(NO_CLOCK)
        return 0

    cdef bint has_read_clock(self, Query* query, ClockReading* reading) except -1:
        cdef ClockHook clock = self._followed_clock
        if clock is None:
            return False
        # Nothing reports that a clock begins, either.
        self._must_look = clock.read(self, reading) or reading.now_ns <= NOT_BEGUN_NS
        query.policy.clock = reading
        lock_acquire(&self._lock)
        self._clock = reading[0]
        # A clock that has not begun may begin at any time.
        self._clock.now_ns = max(reading.now_ns, NOT_BEGUN_NS)
        lock_release(&self._lock)
        self._reads_clock = True
        return True

    cdef bint is_of_clock(self, error) except -1:
        # Signal handlers run in the main thread, so that even a SystemExit in another one is the clock's.
        cdef ClockHook clock = self._followed_clock
        return clock is not None and clock.runs_code and (
            isinstance(error, Exception) or get_ident() != main_thread().ident)

    def _tf2_follow_clock(self, ClockHook clock):
        """Count ages by this clock from now on. None: there is no clock."""
        self._followed_clock = clock

    def _tf2_clear(self, hand_over):
        """As ``clear``; ``hand_over`` is called with what runs code of a program."""
        self.remove(NULL, 0, hand_over)

    def _tf2_clock_jumped(self, hand_over=None):
        """
        Judge the ages of pending waits anew, because the clock has gone back, or shows another time.

        :param hand_over: called with what runs code of a program. None: this thread runs it.
        """
        cdef Query not_needed
        cdef ClockReading reading
        cdef Batch batch
        if not self._reads_clock:
            return
        self.read_clock(&not_needed, &reading)
        self._lock_when_none_is_due()
        self._begin_to_wake_all(&batch)
        unlock_written(&self._lock, &self._tree, &self._waiters)
        self._wake_all(&batch, hand_over)

    cdef str _limiting_frame(self, const Query* query, Status status):
        # The frame without newer data than the latest common time, at which another frame has no data yet;
        # None: the lookup failed for another reason, or data has arrived since.
        cdef FrameId frames[2 * MAX_HOPS]
        cdef int64_t newest_ns[2 * MAX_HOPS]
        cdef Status found
        cdef Query half = _half_of(query, status)
        cdef int64_t time_ns = query.target_ns if status.half == HALF_TARGET else query.source_ns
        if status.gap not in (GAP_PAST, GAP_SINGLE) or time_ns != 0 or status.edge_ns < status.requested_ns:
            return None
        for i in range(self.moving_frames(&half, NULL, frames, newest_ns, &found)):
            if newest_ns[i] == status.requested_ns:
                return self.frame_names([frames[i]])[0]
        return None

    cdef tuple _limits_instead(self, const Query* query, Status status):
        # The parent of a frame without an age, None if it is a root; and the frames to limit instead: those
        # that move on the path; of a root, its children.
        cdef FrameId frames[2 * MAX_HOPS]
        cdef Status found
        cdef int64_t newest_ns[2 * MAX_HOPS]
        cdef Query half = _half_of(query, status)
        cdef uint32_t count = self.moving_frames(&half, NULL, frames, newest_ns, &found)
        [name] = self.frame_names([status.child])
        on_path = self.frame_names([frames[i] for i in range(count)])
        parents = {one.name: one.parent for one in self.frame_facts()}
        if parents.get(name) is not None:
            return parents[name], on_path
        children = [child for child in parents if parents[child] == name]
        return None, [child for child in children if child in on_path] or children

    cdef Status _check_names(self, const Query* query) noexcept nogil:
        cdef QueryFrames frames
        cdef Status status
        lock_acquire(&self._lock)
        status = query_find_frames(&self._tree, query, &frames)
        lock_release(&self._lock)
        return status

    cdef Py_ssize_t lookup_series(self, const Query* query, const TimeSeries* series,
                                  Status* status) noexcept nogil:
        return series_lookup(&self._tree, &self._lock, query, series, status)

    cdef Py_ssize_t find_knots(self, const Query* query, Knots* knots) noexcept nogil:
        return series_knots(&self._tree, &self._lock, query, knots)

    cdef Status common_time(self, const Query* query, int64_t* common_ns) noexcept nogil:
        cdef Path path
        cdef FrameId target, source
        cdef Status status
        lock_acquire(&self._lock)
        status = query_end_frames(&self._tree, query, &target, &source)
        if status.code == STATUS_OK:
            status = walk_common_time(&self._tree, target, source, &path, common_ns)
        lock_release(&self._lock)
        return status

    cdef int answered_times(self, const Query* query, TimeRange* answered, Status* status) noexcept nogil:
        # On pinned histories: with many changes of the parent it takes long.
        cdef FrameId[2] ends
        cdef PinnedTree pinned
        cdef int problem = 0
        lock_acquire(&self._lock)
        status[0] = query_end_frames(&self._tree, query, &ends[0], &ends[1])
        if status.code == STATUS_OK:
            problem = tree_pin_above(&self._tree, ends, 2, &pinned)
        lock_release(&self._lock)
        if status.code != STATUS_OK or problem != 0:
            return problem
        status[0] = walk_time_range(&pinned, ends[0], ends[1], answered)
        tree_unpin(&pinned)
        return 0

    cdef uint32_t moving_frames(self, const Query* query, const ClockReading* clock, FrameId* frames,
                                int64_t* times_ns, Status* status) noexcept nogil:
        cdef const History* history
        cdef Path path
        cdef FrameId target, source
        cdef int64_t common_ns
        cdef uint32_t i
        cdef uint32_t count = 0
        path.source_hops = path.target_hops = 0
        lock_acquire(&self._lock)
        status[0] = query_end_frames(&self._tree, query, &target, &source)
        if status.code == STATUS_OK:
            status[0] = walk_common_time(&self._tree, target, source, &path, &common_ns)
        if status.code == STATUS_OK:
            for i in range(path.source_hops + path.target_hops):
                frames[count] = (path.source[i] if i < path.source_hops
                                 else path.target[path.source_hops + path.target_hops - 1 - i])
                history = &self._tree.histories[frames[count]]
                times_ns[count] = history.newest_ns
                if clock != NULL:
                    times_ns[count] = age_at(history.newest_ns, clock.now_ns)
                count += history.kind == HISTORY_DYNAMIC
        lock_release(&self._lock)
        return count

    cdef list frames_between(self, target_frame, source_frame, int64_t time_ns):
        cdef list frames = []
        cdef FrameId target, source
        cdef Query query
        cdef Path path
        cdef Status status
        cdef int64_t stamp_ns
        cdef uint32_t i
        query_frames(&query, target_frame, source_frame)
        query.source_ns = time_ns
        lock_acquire(&self._lock)
        status = query_end_frames(&self._tree, &query, &target, &source)
        if status.code == STATUS_OK:
            status = walk_lookup(&self._tree, target, source, time_ns, &query.policy, &path, NULL, &stamp_ns)
        lock_release(&self._lock)
        if status.code != STATUS_OK:
            raise self.error(&query, status)
        extend_path(frames, [path.source[i] for i in range(path.source_hops)])
        extend_path(frames, [path.top])
        extend_path(frames, [path.target[i - 1] for i in range(path.target_hops, 0, -1)])
        return frames

    cdef object error(self, const Query* query, Status status, str call="lookupTransform"):
        cdef str child = None
        cdef str parent = None
        cdef list instead = None
        cdef str limiting = None
        if status.code == STATUS_EXTRAPOLATION or status.code == STATUS_UNCONNECTED:
            child, parent = self.frame_names((status.child, status.parent))
            limiting = self._limiting_frame(query, status)
        elif status.code == STATUS_BAD_LIMIT and status.child != NO_FRAME:
            parent, instead = self._limits_instead(query, status)
        self._begin_advice()
        return query_error(query, status, child, parent, instead, limiting, call, self._advice, self,
                           self._followed_clock)

    cdef int _begin_advice(self) except -1:
        cdef size_t count
        lock_acquire(&self._lock)
        count = self._tree.names.count - 1 - self._tree.hidden      # without the reserved name
        lock_release(&self._lock)
        return self._advice.begin(self, count)

    def _tf2_names(self):
        """Every frame name, in the order of first appearance."""
        cdef list names
        if self._tree.hidden:
            return [one.name for one in snapshot_frames(
                &self._tree, &self._lock, True, self._names, self._authorities)]
        names = self._names
        learn_names(&self._tree.names, &self._lock, names)
        return names[1:]

    def _describe_silence_with(self, find_silence):
        """
        Have errors report which topics are silent.

        :param find_silence: called with this buffer when an error is made. Returns two clauses, about all
            topics that fill the buffer, and about those of dynamic transforms; ``""`` if none is silent. It
            must not refer to the buffer. The answer is kept for 0.1 s, except that an error about known
            frames calls it again before it reports a silent topic.
        """
        self._advice.describe_silence_with(find_silence)

    cdef int add_waiter(self, Waiter* waiter, Status* status) except -1:
        cdef int64_t in_1970_ns
        catch_up(self)
        lock_acquire(&self._lock)
        status[0] = self._file_waiter(waiter)
        in_1970_ns = self._waiters.in_1970_ns
        self._waiters.in_1970_ns = 0
        unlock_written(&self._lock, &self._tree, &self._waiters)
        if in_1970_ns:
            self.log_1970(in_1970_ns)
        if not load_acquire(&waiter.answered):
            catch_up(self)      # with what arrived before the inboxes were marked
        return 0

    cdef Status _file_waiter(self, Waiter* waiter) noexcept:
        # With the lock held. The first attempt judges ages by a reading of its own.
        cdef Status status = waiters_add(&self._waiters, &self._tree, waiter)
        waiter.query.policy.clock = &self._clock
        if not waiter.answered:
            self.set_has_waiters()
        return status

    cdef bint judge_waiter(self, Waiter* waiter, const ClockReading* reading) except -1:
        cdef bint is_answered
        lock_acquire(&self._lock)
        if waiters_remove(&self._waiters, waiter) or waiter.answered:
            store_release(&waiter.answered, False)
            if waiter.woken != NULL:
                event_clear(waiter.woken)
            waiter.query.policy.clock = reading
            self._file_waiter(waiter)
        is_answered = waiter.answered
        unlock_written(&self._lock, &self._tree, &self._waiters)
        if not is_answered:
            catch_up(self)      # as in add_waiter
        return is_answered

    cdef bint remove_waiter(self, Waiter* waiter) noexcept nogil:
        cdef bint was_pending
        lock_acquire(&self._lock)
        was_pending = waiters_remove(&self._waiters, waiter)
        unlock_written(&self._lock, &self._tree, &self._waiters)
        return was_pending

    cdef bint has_forgotten(self, const Waiter* waiter) noexcept nogil:
        return waiter.arrival <= self._waiters.forgotten

    cdef object reason(self, const Query* query):
        cdef int64_t stamp_ns
        cdef Transform not_needed   # with NULL, the other half of a two-time lookup would be tried first
        cdef ClockReading reading
        cdef Query judged = query[0]
        if judged.policy.is_given and judged.policy.judges_age:
            self.read_clock(&judged, &reading)
        cdef Status status = self.lookup(&judged, &not_needed, &stamp_ns)
        if status.code != STATUS_OK:
            return self.error(query, status)
        with nogil:
            self.finish_wakes()
        return None

    cdef list frame_facts(self, bint roots=False):
        catch_up(self)
        return snapshot_frames(&self._tree, &self._lock, roots, self._names, self._authorities)

    cdef dict frame_histories(self):
        catch_up(self)
        return histories_of(&self._tree, &self._lock, self._names)

    cdef list frame_names(self, frames):
        cdef list names = self._names
        learn_names(&self._tree.names, &self._lock, names)
        return [name_of(names, frame) for frame in frames]

    cdef bint has_frame(self, const char* name, size_t size) noexcept nogil:
        cdef FrameId frame
        lock_acquire(&self._lock)
        frame = tree_frame(&self._tree, name, size)
        lock_release(&self._lock)
        return frame != NO_FRAME

    cdef FrameId parent_at(self, const char* name, size_t size, int64_t time_ns) noexcept nogil:
        cdef FrameId parent
        lock_acquire(&self._lock)
        parent = history_parent_at(&self._tree.histories[tree_frame(&self._tree, name, size)], time_ns)
        lock_release(&self._lock)
        return parent

    cdef dict counts(self):
        cdef Tree tree
        cdef size_t size
        cdef uint32_t bit, waiters
        catch_up(self)
        lock_acquire(&self._lock)
        tree = self._tree
        waiters = self._waiters.count
        size = tree_bytes(&self._tree)
        lock_release(&self._lock)
        return {
            "taken": tree.taken,
            "refused": {log.REFUSALS[bit][1]: tree.refused[bit] for bit in range(REFUSAL_KINDS)},
            "frames": tree.names.count - 1 - tree.hidden,
            "samples": tree.samples,
            "displaced": tree.displaced,
            "bytes": size,
            "waiters": waiters,
            "malformed_messages": load_seq_cst(&self._malformed),
        }

    cdef const char* check(self) noexcept nogil:
        cdef const char* problem
        lock_acquire(&self._lock)
        problem = _problem(&self._tree, &self._waiters)
        lock_release(&self._lock)
        return problem

    @property
    def cache_time_ns(self):
        """How far each frame's history reaches back, in nanoseconds."""
        cdef int64_t cache_time_ns
        lock_acquire(&self._lock)
        cache_time_ns = self._tree.retention.cache_time_ns
        lock_release(&self._lock)
        return cache_time_ns


cdef Query _half_of(const Query* query, Status status):
    # The simple lookup that a status is about.
    cdef Query half = query[0]
    if status.half == HALF_SOURCE:
        half.target, half.target_size = query.fixed, query.fixed_size
    elif status.half == HALF_TARGET:
        half.source, half.source_size = query.fixed, query.fixed_size
    return half


cdef int extend_path(list chain, list frames) except -1:
    # A frame that occurs again closes a detour, which is cut off.
    for frame in frames:
        if frame in chain:
            del chain[chain.index(frame):]
        chain.append(frame)
    return 0


def keep_for_ever(*things):
    """Never destroy these, not even at the interpreter's end."""
    for thing in things:
        Py_INCREF(thing)
