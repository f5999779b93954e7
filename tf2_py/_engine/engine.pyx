"""Owns what is done to the tree under its lock, and what follows from it outside the lock."""

cimport cython
from libc.stddef cimport size_t
from libc.stdint cimport SIZE_MAX, UINT32_MAX, int64_t, uint32_t, uint64_t
from libc.stdlib cimport free, malloc
from libc.string cimport memset

from tf2_py._core.change cimport Change
from tf2_py._core.forking cimport FORK_INNER, fork_forget, fork_watch
from tf2_py._core.lock cimport lock_free, lock_init, lock_read, lock_write, unlock_read
from tf2_py._core.lookup cimport (
    Query,
    query_answer,
    query_end_frames,
    query_fixed_frame,
    query_is_identity,
)
from tf2_py._core.mirror cimport mirror_free, mirror_leave
from tf2_py._core.names cimport NAME_NO_MEMORY, NAME_UNKNOWN, names_find
from tf2_py._core.path cimport Path
from tf2_py._core.publication cimport (
    publication_adopt,
    publication_close,
    publication_free,
    publication_has_room,
    publication_has_room_for,
    publication_open,
    publication_pause,
    publication_start_over,
    publication_tell,
    publication_tell_all,
)
from tf2_py._core.reading cimport Reading, reading_begin, reading_continue
from tf2_py._core.segment cimport Segment, segment_head, segment_word, store32
from tf2_py._core.self_check cimport unlock_written
from tf2_py._core.series cimport TimeSeries, series_lookup
from tf2_py._core.tree cimport (
    DEFAULT_CACHE_TIME_NS,
    TREE_NO_MEMORY,
    Limits,
    Tree,
    tree_authority,
    tree_bytes,
    tree_check,
    tree_clear,
    tree_count_refused,
    tree_free,
    tree_init,
    tree_insert,
)
from tf2_py._core.types cimport (
    NO_FRAME,
    REFUSAL_KINDS,
    REFUSED_BYTES,
    STATUS_BAD_FIXED,
    STATUS_EXTRAPOLATION,
    STATUS_OK,
    FrameId,
    Incoming,
    Status,
    Transform,
)
from tf2_py._core.waiters cimport (
    PLACE_NONE,
    Waiter,
    WaiterList,
    waiters_add,
    waiters_check,
    waiters_free,
    waiters_remove,
    wake_begin,
    wake_step,
)
from tf2_py._core.walk cimport walk_common_time, walk_lookup
from tf2_py._engine.snapshot cimport snapshot_frames, snapshot_names, snapshot_span
from tf2_py._engine.travel cimport read_state, state_of
from tf2_py._objects.advice cimport Advice
from tf2_py._objects.frame_names cimport name_for_log
from tf2_py._objects.lookup_errors cimport query_error, query_lack
from tf2_py._objects.throttle cimport LINES_PER_MESSAGE, Throttle
from tf2_py._wire.batch cimport Batch, Entry, batch_begin, batch_error

from tf2_py._objects import errors, log

cdef Limits NO_LIMITS
NO_LIMITS.frames = NO_LIMITS.waiters = UINT32_MAX
NO_LIMITS.bytes = SIZE_MAX


cdef class WaiterOwner:
    """What a Waiter belongs to."""

    cdef object deliver(self):
        raise NotImplementedError

    cpdef str lacks(self):
        raise NotImplementedError


@cython.no_gc_clear
cdef class Engine:
    """The tree of a BufferCore, and all that is done to it under its lock."""

    def __cinit__(self, *args, **kwargs):
        if lock_init(&self._lock) != 0:
            raise MemoryError
        self._forked.owner = <void*>self
        fork_watch(&self._forked, &self._lock, FORK_INNER)
        if tree_init(&self._tree, DEFAULT_CACHE_TIME_NS, &NO_LIMITS) != 0:
            raise MemoryError
        self._throttle = log.Throttle()
        self._advice = Advice()
        self._observers = []

    def __dealloc__(self):
        fork_forget(&self._forked)
        # No waiter is left: each owner holds its engine.
        waiters_free(&self._waiters)
        tree_free(&self._tree)
        lock_free(&self._lock)
        if self._publication != NULL:
            publication_free(self._publication)
        if self._mirror != NULL:
            mirror_free(self._mirror)
        free(self._publication)
        free(self._mirror)

    cdef void insert(self, Batch* batch):
        batch_begin(batch)
        if self.insert_some(batch):
            with nogil:
                while self.insert_some(batch):
                    pass

    cdef bint insert_some(self, Batch* batch) noexcept nogil:
        cdef uint32_t authority = 0
        cdef uint32_t cost
        cdef uint64_t work
        cdef int64_t left = SLICE
        cdef bint inserts, was_attached
        lock_write(&self._lock)
        inserts = batch.done < batch.count
        if inserts:
            was_attached = self._tree.mirror != NULL
            batch.no_memory = batch.no_memory or not self._take_leave(False)
            if was_attached and self._tree.mirror == NULL and self._waiters.count:
                # It brought what the other process inserted meanwhile. A thread may have told the waiters of
                # that or may be about to; in a forked child there is none.
                batch.wake.change.everything = True
                batch.wake.change.count = 0
                wake_begin(&self._waiters, &batch.wake)
                batch.waking = True
            self._open()
            # Each time: the buffer may have been emptied meanwhile, with its names.
            if self._publication == NULL or publication_has_room_for(
                    self._publication, batch.authority_size):
                authority = tree_authority(&self._tree, batch.authority, batch.authority_size)
            batch.no_memory = batch.no_memory or authority == NAME_NO_MEMORY
        while left > 0 and (batch.waking or batch.done < batch.count):
            if batch.waking:
                cost = wake_step(&self._waiters, &self._tree, &batch.wake, &batch.ready)
                batch.waking = cost > 0
                left -= cost
            else:
                work = self._tree.work
                self._insert_next(batch, authority)
                left -= <int64_t>(1 + self._tree.work - work)
        batch.needs_report = batch.refused > 0 or batch.no_memory or batch.ready.first != NULL
        batch.needs_report = batch.needs_report or is_filled(<void*>self._observers)
        if inserts:
            self._close()
        unlock_written(&self._lock, &self._tree, &self._waiters)
        if self._publication != NULL:
            publication_pause(self._publication)
        return batch.waking or batch.done < batch.count

    cdef void _insert_next(self, Batch* batch, uint32_t authority) noexcept nogil:
        cdef Entry* entry = &batch.entries[batch.done]
        cdef Change* change = NULL
        batch.done += 1
        entry.refused = 0
        if batch.no_memory:
            return
        if self._waiters.count or self._publication != NULL:
            change = &batch.wake.change
        if self._publication != NULL and not publication_has_room(
                self._publication, &self._tree, &entry.incoming):
            entry.refused = REFUSED_BYTES
            tree_count_refused(&self._tree, REFUSED_BYTES)
            batch.refused += 1
            return
        entry.refused = tree_insert(&self._tree, &entry.incoming, authority, batch.is_static, change)
        if entry.refused == 0:
            batch.taken += 1
        elif entry.refused == TREE_NO_MEMORY:
            entry.refused = 0
            batch.no_memory = True
        else:
            batch.refused += 1
        if self._publication != NULL:
            publication_tell(self._publication, &self._tree, change)
        if self._waiters.count:
            wake_begin(&self._waiters, &batch.wake)
            batch.waking = True

    cdef int report(self, Batch* batch, list later) except -1:
        error = self._deliver(&batch.ready, later)
        if later is not None:
            later.extend(self._observers)
        else:
            for observer in list(self._observers):
                try:
                    observer()
                except BaseException as raised:
                    if error is None:
                        error = raised
        self._log_refused(batch)
        if error is not None:
            raise error
        if batch.no_memory:
            raise MemoryError
        return 0

    cdef int _log_refused(self, Batch* batch) except -1:
        # Text is made only of what is printed.
        cdef size_t chosen[LINES_PER_MESSAGE]
        cdef size_t count, i
        cdef uint64_t more
        cdef const Incoming* incoming
        if batch.refused == 0:
            return 0
        count = (<Throttle>self._throttle).choose(batch, chosen, &more)
        for i in range(count):
            incoming = &batch.entries[chosen[i]].incoming
            log.refused(
                batch.entries[chosen[i]].refused,
                name_for_log(incoming.parent, incoming.parent_size),
                name_for_log(incoming.child, incoming.child_size),
                name_for_log(batch.authority, batch.authority_size),
                incoming.stamp_ns,
            )
        if more:
            log.not_logged(more)
        return 0

    cdef object malformed(self, const Batch* batch, size_t size, str topic=None):
        self._malformed += 1
        error = batch_error(batch, size)
        if topic is not None:
            log.malformed(self._throttle, topic, str(error))
        return error

    cdef object _deliver(self, WaiterList* ready, list later):
        # One at a time: what is called may insert, wait or cancel. All are served, whatever one raises.
        cdef Waiter* waiter
        error = None
        while True:
            lock_write(&self._lock)
            waiter = ready.first
            if waiter != NULL:
                waiters_remove(&self._waiters, waiter)
            unlock_written(&self._lock, &self._tree, &self._waiters)
            if waiter == NULL:
                return error
            # The owner still exists: it removes its waiter, with the GIL, before it is destroyed.
            try:
                rest = (<WaiterOwner>waiter.owner).deliver()
                if rest is None:
                    continue
                if later is None:
                    rest()
                else:
                    later.append(rest)
            except BaseException as raised:
                if error is None:
                    error = raised

    cdef int forget(self) except -1:
        cdef Batch batch
        lock_write(&self._lock)
        if not self._take_leave(False):
            unlock_written(&self._lock, &self._tree, &self._waiters)
            raise MemoryError
        self._open()
        tree_clear(&self._tree)
        if self._publication != NULL:
            publication_tell_all(self._publication, &self._tree)
        self._close()
        # Less data may end a loop, and what the waiters lack is no longer what they are filed under.
        self._begin_to_wake_all(&batch)
        unlock_written(&self._lock, &self._tree, &self._waiters)
        return self._wake_all(&batch)

    cdef int start_over(self, int64_t cache_time_ns, const Limits* limits) except -1:
        cdef Tree empty
        memset(&empty, 0, sizeof(Tree))
        if tree_init(&empty, cache_time_ns, limits) != 0:
            tree_free(&empty)
            raise MemoryError
        return self._replace_tree(&empty, 0)

    cdef dict export(self):
        return state_of(&self._tree, &self._lock, self._malformed)

    cdef int restore(self, dict state) except -1:
        cdef Tree restored
        cdef unsigned long long malformed
        read_state(state, &restored, &malformed)
        return self._replace_tree(&restored, malformed)

    cdef int _replace_tree(self, const Tree* tree, unsigned long long malformed) except -1:
        cdef Tree old
        cdef Tree new = tree[0]
        cdef Batch batch
        lock_write(&self._lock)
        # What the other process holds is not to be kept.
        self._take_leave(True)
        if self._publication != NULL and not publication_adopt(self._publication, &new):
            unlock_written(&self._lock, &self._tree, &self._waiters)
            tree_free(&new)
            raise MemoryError
        self._open()
        old = self._tree
        self._tree = new
        if self._publication != NULL:
            publication_start_over(self._publication)
            publication_tell_all(self._publication, &self._tree)
        self._close()
        # The waiters are filed under the old tree's frames.
        self._begin_to_wake_all(&batch)
        unlock_written(&self._lock, &self._tree, &self._waiters)
        with nogil:
            tree_free(&old)
        self._malformed = malformed
        self._advice.forget()
        return self._wake_all(&batch)

    cdef void _begin_to_wake_all(self, Batch* batch) noexcept nogil:
        # As after an insert that may complete every waiter. With the lock held.
        batch.count = 0
        batch_begin(batch)
        batch.wake.change.everything = True
        batch.wake.change.count = 0
        batch.waking = True
        wake_begin(&self._waiters, &batch.wake)

    cdef int _wake_all(self, Batch* batch) except -1:
        with nogil:
            while self.insert_some(batch):
                pass
        error = self._deliver(&batch.ready, None)
        if error is not None:
            raise error
        return 0

    cdef Status lookup(self, const Query* query, Transform* out, int64_t* stamp_ns) noexcept nogil:
        cdef Status status
        cdef Reading reading
        reading_begin(&reading, &self._tree, &self._lock)
        while reading_continue(&reading):
            status = query_answer(&self._tree, query, out, stamp_ns)
        return status

    cdef Py_ssize_t lookup_series(self, const Query* query, const TimeSeries* series,
                                  Status* status) noexcept nogil:
        cdef FrameId target, source
        cdef Reading reading
        reading_begin(&reading, &self._tree, &self._lock)
        while reading_continue(&reading):
            status[0] = query_end_frames(&self._tree, query, &target, &source)
            if query_is_identity(query):
                status.code = STATUS_OK
            elif status.code == STATUS_OK and query.fixed != NULL:
                if query_fixed_frame(&self._tree, query) == NO_FRAME:
                    status.code = STATUS_BAD_FIXED
        if status.code != STATUS_OK:
            return -1
        return series_lookup(&self._tree, &self._lock, query, series, status)

    cdef Status common_time(self, const Query* query, int64_t* common_ns) noexcept nogil:
        cdef Path path
        cdef FrameId target, source
        cdef Status status
        cdef Reading reading
        reading_begin(&reading, &self._tree, &self._lock)
        while reading_continue(&reading):
            status = query_end_frames(&self._tree, query, &target, &source)
            if status.code == STATUS_OK:
                status = walk_common_time(&self._tree, target, source, &path, common_ns)
        return status

    cdef Status find_path(self, const Query* query, Path* path) noexcept nogil:
        cdef FrameId target, source
        cdef Status status
        cdef int64_t stamp_ns
        cdef Reading reading
        reading_begin(&reading, &self._tree, &self._lock)
        while reading_continue(&reading):
            status = query_end_frames(&self._tree, query, &target, &source)
            if status.code == STATUS_OK:
                status = walk_lookup(&self._tree, target, source, query.source_ns, path, NULL, &stamp_ns)
        return status

    cdef object error(self, const Query* query, Status status, str call="lookupTransform"):
        cdef str child = None
        cdef str parent = None
        if status.code == STATUS_EXTRAPOLATION:
            child, parent = self.frame_names((status.child, status.parent))
        self._begin_advice()
        return query_error(query, status, child, parent, call, self._advice, self)

    cdef int _begin_advice(self) except -1:
        cdef size_t count = 0
        cdef Reading reading
        reading_begin(&reading, &self._tree, &self._lock)
        while reading_continue(&reading):
            count = self._tree.names.count
        return self._advice.begin(self, count - 1 if count else 0)     # without the reserved name

    def _known_names(self):
        """Every frame name, in the order of first appearance."""
        return self.frame_names(None)[1:]

    def _ask_for_silence(self, find_silence):
        """
        Have errors say which topics are silent.

        :param find_silence: called with this buffer when an error is made, and returns two clauses: about all
            topics that the buffer is filled from, and about those of dynamic transforms; ``""`` where none is
            silent. It must not refer to the buffer. The answer is remembered for 0.1 s, except that an error
            about known frames asks anew before it says that a topic is silent.
        """
        self._advice.ask(find_silence)

    cdef int add_waiter(self, Waiter* waiter, Status* status) except -1:
        cdef bint too_many
        cdef uint32_t most
        lock_write(&self._lock)
        status[0] = waiters_add(&self._waiters, &self._tree, waiter)
        most = self._tree.limits.waiters
        too_many = status.code != STATUS_OK and self._waiters.count > most
        if too_many:
            waiters_remove(&self._waiters, waiter)
        if self._tree.mirror != NULL:
            self._nudge()
        unlock_written(&self._lock, &self._tree, &self._waiters)
        if too_many:
            self._waits_refused += 1
            error = errors.too_many_waiters(most)
            log.too_many_waiters(self._throttle, str(error))
            raise error
        return 0

    cdef bint remove_waiter(self, Waiter* waiter) noexcept nogil:
        cdef bint was_pending
        lock_write(&self._lock)
        was_pending = waiter.place != PLACE_NONE and not waiter.answered
        waiters_remove(&self._waiters, waiter)
        unlock_written(&self._lock, &self._tree, &self._waiters)
        return was_pending

    cdef list pending(self, size_t most):
        # With the lock held only pointers are copied. The owners still exist afterwards: the GIL is held all
        # the time, and without it none is destroyed.
        cdef void** owners = <void**>malloc((most + 1) * sizeof(void*))
        cdef size_t count, i
        if owners == NULL:
            raise MemoryError
        lock_read(&self._lock)
        count = _copy_owners(&self._waiters.filed, owners, 0, most)
        count = _copy_owners(&self._waiters.any, owners, count, most)
        count = _copy_owners(&self._waiters.due, owners, count, most)
        unlock_read(&self._lock)
        try:
            return [<object>owners[i] for i in range(count)]
        finally:
            free(owners)

    cdef str lack(self, const Query* query):
        cdef int64_t stamp_ns
        cdef Status status = self.lookup(query, NULL, &stamp_ns)
        child, = self.frame_names((status.child if status.code == STATUS_EXTRAPOLATION else NO_FRAME,))
        self._begin_advice()
        return query_lack(query, status, child, self._advice, self._known_names)

    cdef list frame_facts(self, bint roots=False):
        return snapshot_frames(&self._tree, &self._lock, roots)

    cdef list frame_names(self, frames):
        return snapshot_names(&self._tree, &self._lock, frames)

    cdef uint32_t find_name(self, const char* name, size_t size) noexcept nogil:
        cdef uint32_t found = NAME_UNKNOWN
        cdef Reading reading
        reading_begin(&reading, &self._tree, &self._lock)
        while reading_continue(&reading):
            found = names_find(&self._tree.names, name, size)
        return found

    cdef bint span(self, int64_t* oldest_ns, int64_t* newest_ns) noexcept nogil:
        return snapshot_span(&self._tree, &self._lock, oldest_ns, newest_ns)

    cdef dict counts(self):
        cdef Tree tree
        cdef size_t size
        cdef uint32_t bit, waiters
        cdef unsigned long long malformed = self._malformed
        cdef Reading reading
        reading_begin(&reading, &self._tree, &self._lock)
        while reading_continue(&reading):
            tree = self._tree
            waiters = self._waiters.count
            size = tree_bytes(&self._tree)
            if tree.mirror != NULL:
                malformed = self._malformed + segment_head(tree.mirror.segment).facts.malformed
        return {
            "taken": tree.taken,
            "refused": {log.REFUSALS[bit][1]: tree.refused[bit] for bit in range(REFUSAL_KINDS)},
            "frames": tree.names.count - 1,
            "samples": tree.samples,
            "bytes": size,
            "waiters": waiters,
            "waits_refused": self._waits_refused,
            "malformed_messages": malformed,
        }

    cdef const char* check(self) noexcept nogil:
        cdef const char* problem = NULL
        cdef Reading reading
        reading_begin(&reading, &self._tree, &self._lock)
        while reading_continue(&reading):
            problem = tree_check(&self._tree)
            if problem == NULL:
                problem = waiters_check(&self._waiters, &self._tree)
        return problem

    @property
    def cache_time_ns(self):
        """How far each frame's history reaches back, in nanoseconds."""
        cdef int64_t cache_time_ns = 0
        cdef Reading reading
        reading_begin(&reading, &self._tree, &self._lock)
        while reading_continue(&reading):
            cache_time_ns = self._tree.cache_time_ns
        return cache_time_ns

    # Sharing, as far as what changes the tree must know of it; the rest is in sharing.pyx.

    cdef bint _take_leave(self, bint at_any_cost) noexcept nogil:
        # With the lock held for writing, as the next ones. False: there is no memory; nothing has changed.
        cdef Segment* segment
        if self._tree.mirror != NULL:
            segment = self._tree.mirror.segment
            if not mirror_leave(&self._tree, at_any_cost):
                return False
            segment.wake(segment_word(segment))
            self._nudge()
        return True

    cdef void _nudge(self) noexcept nogil:
        # The thread that follows another process, if it sleeps because nothing waited.
        store32(&self._nudges, self._nudges + 1)
        if self._mirror != NULL and self._mirror.segment != NULL:
            self._mirror.segment.wake(&self._nudges)

    cdef void _open(self) noexcept nogil:
        if self._publication != NULL:
            publication_open(self._publication)

    cdef void _close(self) noexcept nogil:
        if self._publication != NULL:
            publication_close(self._publication, &self._tree, self._malformed)


cdef size_t _copy_owners(const WaiterList* waiters, void** owners, size_t count, size_t most) noexcept nogil:
    cdef const Waiter* waiter = waiters.first
    while waiter != NULL and count < most:
        owners[count] = waiter.owner
        count += 1
        waiter = waiter.next
    return count
