"""Owns what is done to the tree under its lock, and what follows from it outside the lock."""

cimport cython
from cpython.exc cimport PyErr_CheckSignals
from libc.stddef cimport size_t
from libc.stdint cimport SIZE_MAX, UINT32_MAX, int64_t, uint32_t, uint64_t
from libc.string cimport memset
from posix.time cimport CLOCK_MONOTONIC, timespec

from tf2_py._core.clock cimport monotonic_ns
from tf2_py._core.forking cimport FORK_INNER, fork_forget, fork_watch
from tf2_py._core.lock cimport lock_free, lock_init, lock_read, lock_write, unlock_read, unlock_write
from tf2_py._core.lookup cimport Query, query_answer
from tf2_py._core.names cimport NAME_NO_MEMORY, name_is_invalid
from tf2_py._core.stamp cimport NS_PER_S
from tf2_py._core.tree cimport (
    DEFAULT_CACHE_TIME_NS,
    TREE_NO_MEMORY,
    Change,
    Limits,
    Tree,
    tree_authority,
    tree_clear,
    tree_free,
    tree_init,
    tree_insert,
)
from tf2_py._core.types cimport (
    STATUS_BAD_FIXED,
    STATUS_BAD_SOURCE,
    STATUS_BAD_TARGET,
    STATUS_EXTRAPOLATION,
    STATUS_OK,
    Incoming,
    Status,
    Transform,
)
from tf2_py._core.waiters cimport (
    PLACE_NONE,
    Waiter,
    WaiterList,
    waiter_free,
    waiters_add,
    waiters_free,
    waiters_remove,
    wake_begin,
    wake_step,
)
from tf2_py._engine.snapshot cimport snapshot_names
from tf2_py._objects.lookup_errors cimport query_error
from tf2_py._objects.messages cimport new_transform_stamped
from tf2_py._objects.names_in_logs cimport name_for_log
from tf2_py._objects.throttle cimport LINES_PER_MESSAGE, Throttle
from tf2_py._wire.batch cimport Batch, Entry, batch_begin

from tf2_py._objects import errors, log

cdef extern from "Python.h":
    ctypedef struct CPythonSized "PyVarObject":
        Py_ssize_t ob_size

cdef extern from "<semaphore.h>" nogil:
    int sem_init(sem_t* semaphore, int shared, unsigned int value)
    int sem_destroy(sem_t* semaphore)
    int sem_post(sem_t* semaphore)
    int sem_clockwait(sem_t* semaphore, int clock, const timespec* deadline)

NO_LIMITS.frames = NO_LIMITS.waiters = UINT32_MAX
NO_LIMITS.bytes = SIZE_MAX

# How often a blocked thread looks for signals and for the end of its context.
cdef int64_t WAKE_CHECK_NS = 100 * <int64_t>1000000


cdef class Engine:
    """What a BufferCore stands on."""

    def __cinit__(self, *args, **kwargs):
        if lock_init(&self._lock) != 0:
            raise MemoryError
        fork_watch(&self._forked, &self._lock, FORK_INNER)
        if tree_init(&self._tree, DEFAULT_CACHE_TIME_NS, &NO_LIMITS) != 0:
            raise MemoryError
        self._throttle = log.Throttle()
        self._observers = []

    def __dealloc__(self):
        fork_forget(&self._forked)
        # Nobody waits any more: every Wait holds its engine.
        waiters_free(&self._waiters)
        tree_free(&self._tree)
        lock_free(&self._lock)

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
        lock_write(&self._lock)
        if batch.done < batch.count:
            # Each time: the buffer may have been emptied meanwhile, with its names.
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
        batch.needs_report = batch.needs_report or _is_filled(<void*>self._observers)
        unlock_write(&self._lock)
        return batch.waking or batch.done < batch.count

    cdef void _insert_next(self, Batch* batch, uint32_t authority) noexcept nogil:
        cdef Entry* entry = &batch.entries[batch.done]
        cdef Change* change = &batch.wake.change if self._waiters.count else NULL
        batch.done += 1
        entry.refused = 0
        if batch.no_memory:
            return
        entry.refused = tree_insert(&self._tree, &entry.incoming, authority, batch.is_static, change)
        if entry.refused == 0:
            batch.taken += 1
        elif entry.refused == TREE_NO_MEMORY:
            entry.refused = 0
            batch.no_memory = True
        else:
            batch.refused += 1
        if change != NULL:
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

    cdef object _too_many_waiters(self):
        error = errors.too_many_waiters(self._tree.limits.waiters)
        log.too_many_waiters(self._throttle, str(error))
        return error

    cdef object malformed(self, const Batch* batch, size_t size):
        self._malformed += 1
        return ValueError(
            f"malformed TFMessage: {batch.problem.decode()}, at byte {batch.problem_at} of {size}"
        )

    cdef object _deliver(self, WaiterList* ready, list later):
        # One by one: what is called may insert, wait or cancel. Whatever one of them raises, all are served.
        cdef Waiter* waiter
        cdef Wait wait
        error = None
        while True:
            lock_write(&self._lock)
            waiter = ready.first
            if waiter != NULL:
                waiters_remove(&self._waiters, waiter)
            unlock_write(&self._lock)
            if waiter == NULL:
                return error
            # Still there: a Wait leaves under the lock and with the GIL, before it goes.
            wait = <Wait>waiter.owner
            try:
                rest = wait._notify(wait.answer)
                if rest is None:
                    continue
                if later is None:
                    rest()
                else:
                    later.append(rest)
            except BaseException as raised:
                if error is None:
                    error = raised

    @property
    def _new_data_callbacks(self):
        """The list of what is called after every insert, by the thread that runs users' code."""
        return self._observers

    cdef int forget(self) except -1:
        cdef Batch batch
        lock_write(&self._lock)
        tree_clear(&self._tree)
        # Less data may end a loop; and what the others lack is no longer what they are filed under.
        self._begin_to_wake_all(&batch)
        unlock_write(&self._lock)
        return self._wake_all(&batch)

    cdef int start_over(self, int64_t cache_time_ns, const Limits* limits) except -1:
        cdef Tree empty
        cdef Tree old
        cdef Batch batch
        memset(&empty, 0, sizeof(Tree))
        if tree_init(&empty, cache_time_ns, limits) != 0:
            tree_free(&empty)
            raise MemoryError
        lock_write(&self._lock)
        old = self._tree
        self._tree = empty
        # They are filed under the old tree's frames.
        self._begin_to_wake_all(&batch)
        unlock_write(&self._lock)
        with nogil:
            tree_free(&old)
        self._malformed = 0
        return self._wake_all(&batch)

    cdef void _begin_to_wake_all(self, Batch* batch) noexcept nogil:
        # As if a transform had come that may help everybody. With the lock held.
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
        lock_read(&self._lock)
        status = query_answer(&self._tree, query, out, stamp_ns)
        unlock_read(&self._lock)
        return status

    cdef object error(self, const Query* query, Status status, str call="lookupTransform"):
        cdef str child = None
        cdef str parent = None
        if status.code == STATUS_EXTRAPOLATION:
            ends = (status.child, status.parent)
            child, parent = snapshot_names(&self._tree, &self._lock, ends)
        return query_error(query, status, child, parent, call)


cdef inline bint _is_filled(void* objects) noexcept nogil:
    return (<CPythonSized*>objects).ob_size > 0


cdef bint _post(Waiter* waiter) noexcept nogil:
    # To a blocked thread the answer is delivered without the GIL.
    sem_post(<sem_t*>waiter.woken)
    return True


cdef bint _leave_ready(Waiter* waiter) noexcept nogil:
    return False


@cython.final
@cython.no_gc_clear
cdef class Wait:
    """The wait for one lookup. Engines make them; dropping the last reference ends the wait."""

    def __cinit__(self):
        sem_init(&self._woken, 0, 0)

    def __init__(self):
        raise TypeError("a Wait is made by BufferCore._wait()")

    def __dealloc__(self):
        if self._engine is not None:
            self._leave()
        waiter_free(&self._waiter)
        sem_destroy(&self._woken)

    cdef int _begin(self, Engine engine, tuple names, const Query* query, object notify) except -1:
        cdef Status status
        cdef bint too_many
        self._names = names
        self._notify = notify
        self._waiter.query = query[0]
        self._waiter.owner = <void*>self
        self._waiter.woken = &self._woken
        self._waiter.deliver = _post if notify is None else _leave_ready
        self._engine = engine
        lock_write(&engine._lock)
        status = waiters_add(&engine._waiters, &engine._tree, &self._waiter)
        too_many = status.code != STATUS_OK and engine._waiters.count > engine._tree.limits.waiters
        if too_many:
            waiters_remove(&engine._waiters, &self._waiter)
        unlock_write(&engine._lock)
        if too_many:
            engine._waits_refused += 1
            raise engine._too_many_waiters()
        if status.code == STATUS_OK:
            return 0
        # Whatever else is missing, too: with such a name there will never be an answer.
        if name_is_invalid(query.target, query.target_size):
            status.code = STATUS_BAD_TARGET
        elif name_is_invalid(query.source, query.source_size):
            status.code = STATUS_BAD_SOURCE
        elif query.fixed != NULL and name_is_invalid(query.fixed, query.fixed_size):
            status.code = STATUS_BAD_FIXED
        else:
            return 0
        self._leave()
        raise engine.error(query, status)

    cdef void _leave(self) noexcept nogil:
        lock_write(&self._engine._lock)
        waiters_remove(&self._engine._waiters, &self._waiter)
        unlock_write(&self._engine._lock)

    @property
    def answer(self):
        """A new message of the answer, or None."""
        if not self._waiter.answered:
            return None
        target, source, _ = self._names
        return new_transform_stamped(&self._waiter.answer, self._waiter.stamp_ns, target, source)

    def cancel(self):
        """End the wait. Whether it was going on: False where the answer is there, or has been delivered."""
        cdef bint waiting
        lock_write(&self._engine._lock)
        waiting = self._waiter.place != PLACE_NONE and not self._waiter.answered
        waiters_remove(&self._engine._waiters, &self._waiter)
        unlock_write(&self._engine._lock)
        return waiting

    def reason(self):
        """What a lookup raises now: the exception, or None where it would answer."""
        cdef int64_t stamp_ns
        cdef Status status = self._engine.lookup(&self._waiter.query, NULL, &stamp_ns)
        return None if status.code == STATUS_OK else self._engine.error(&self._waiter.query, status)

    def wait_for(self, int64_t timeout_ns, alive):
        """
        Sleep, without the GIL, until the answer is there.

        :param timeout_ns: nanoseconds of steady time.
        :param alive: called now and then; False ends the wait.
        :return: whether there is an answer. The wait is over in any case, also where a signal handler raises.
        """
        cdef int64_t deadline_ns = monotonic_ns() + timeout_ns
        cdef int64_t until_ns
        cdef timespec until
        cdef int failed = 0
        try:
            while not self._waiter.answered:
                if not alive():
                    break
                until_ns = min(deadline_ns, monotonic_ns() + WAKE_CHECK_NS)
                until.tv_sec = until_ns // NS_PER_S
                until.tv_nsec = until_ns % NS_PER_S
                with nogil:
                    failed = sem_clockwait(&self._woken, CLOCK_MONOTONIC, &until)
                PyErr_CheckSignals()
                if failed and until_ns >= deadline_ns and monotonic_ns() >= deadline_ns:
                    break
        finally:
            self._leave()
        # It may have come between the last sleep and leaving.
        return self._waiter.answered
