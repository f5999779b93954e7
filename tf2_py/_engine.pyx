"""Owns what is done to the tree under its lock, and what follows from it outside the lock."""

cimport cython
from cpython.exc cimport PyErr_CheckSignals
from libc.stddef cimport size_t
from libc.stdint cimport int64_t, uint32_t
from libc.string cimport memset
from posix.time cimport CLOCK_MONOTONIC, clock_gettime, timespec

from tf2_py._batch cimport Batch, Entry
from tf2_py._lock cimport lock_free, lock_init, lock_read, lock_write, unlock
from tf2_py._messages cimport new_transform_stamped
from tf2_py._names cimport NAME_NO_MEMORY, names_intern
from tf2_py._query cimport Query, query_error, query_walk
from tf2_py._snapshot cimport snapshot_names
from tf2_py._tree cimport TREE_NO_MEMORY, Tree, tree_clear, tree_free, tree_init, tree_insert
from tf2_py._types cimport (
    REFUSED_OLD,
    STATUS_BAD_FIXED,
    STATUS_BAD_SOURCE,
    STATUS_BAD_TARGET,
    STATUS_EXTRAPOLATION,
    STATUS_OK,
    FrameId,
    Incoming,
    Status,
    Transform,
)
from tf2_py._waiters cimport (
    PLACE_NONE,
    Waiter,
    WaiterList,
    waiters_add,
    waiters_free,
    waiters_remove,
    waiters_wake,
)

from tf2_py import _log

cdef extern from "Python.h":
    ctypedef struct CPythonSized "PyVarObject":
        Py_ssize_t ob_size

cdef extern from "<semaphore.h>" nogil:
    int sem_init(sem_t* semaphore, int shared, unsigned int value)
    int sem_destroy(sem_t* semaphore)
    int sem_post(sem_t* semaphore)
    int sem_clockwait(sem_t* semaphore, int clock, const timespec* deadline)

# How often a blocked thread looks for signals and for the end of its context.
cdef int64_t LOOK_UP_NS = 100 * <int64_t>1000000


cdef class Engine:
    """What a BufferCore stands on."""

    def __cinit__(self, *args, **kwargs):
        if lock_init(&self._lock) != 0:
            raise MemoryError
        if tree_init(&self._tree, DEFAULT_CACHE_TIME_NS) != 0:
            raise MemoryError
        self._throttle = _log.Throttle()
        self._observers = []

    def __dealloc__(self):
        # Nobody waits any more: every Wait holds its engine.
        waiters_free(&self._waiters)
        tree_free(&self._tree)
        lock_free(&self._lock)

    cdef void insert(self, Batch* batch) noexcept nogil:
        cdef uint32_t authority
        cdef size_t i
        cdef Entry* entry
        cdef FrameId changed
        batch.taken = batch.refused = 0
        batch.ready.first = batch.ready.last = NULL
        lock_write(&self._lock)
        authority = names_intern(&self._tree.authorities, batch.authority, batch.authority_size)
        batch.no_memory = authority == NAME_NO_MEMORY
        for i in range(batch.count):
            entry = &batch.entries[i]
            entry.refused = 0
            if batch.no_memory:
                continue
            entry.refused = tree_insert(&self._tree, &entry.incoming, authority, batch.is_static, &changed)
            if self._waiters.count and (entry.refused == 0 or entry.refused == REFUSED_OLD):
                # Too old a sample brings its names, too.
                waiters_wake(&self._waiters, &self._tree, changed, &batch.ready)
            if entry.refused == 0:
                batch.taken += 1
            elif entry.refused == TREE_NO_MEMORY:
                entry.refused = 0
                batch.no_memory = True
            else:
                batch.refused += 1
        batch.news = batch.refused > 0 or batch.no_memory or batch.ready.first != NULL
        batch.news = batch.news or _is_filled(<void*>self._observers)
        unlock(&self._lock)

    cdef int report(self, Batch* batch, list later) except -1:
        try:
            self._deliver(&batch.ready, later)
        finally:
            # Whatever a waiter's callback raises.
            self._log_refused(batch)
        if batch.no_memory:
            raise MemoryError
        return 0

    cdef int _log_refused(self, Batch* batch) except -1:
        cdef size_t i
        cdef Incoming* incoming
        if batch.refused == 0:
            return 0
        for i in range(batch.count):
            if batch.entries[i].refused:
                incoming = &batch.entries[i].incoming
                _log.refused(
                    self._throttle,
                    batch.entries[i].refused,
                    incoming.parent[:incoming.parent_size].decode("utf-8"),
                    incoming.child[:incoming.child_size].decode("utf-8"),
                    batch.authority[:batch.authority_size].decode("utf-8"),
                    incoming.stamp_ns,
                )
        return 0

    cdef object malformed(self, const Batch* batch, size_t size):
        self._malformed += 1
        return ValueError(
            f"malformed TFMessage: {batch.problem.decode()}, at byte {batch.problem_at} of {size}"
        )

    cdef int _deliver(self, WaiterList* ready, list later) except -1:
        # One by one: what is called may insert, wait or cancel. Whatever one of them raises, all are served.
        cdef Waiter* waiter
        cdef Wait wait
        error = None
        while True:
            lock_write(&self._lock)
            waiter = ready.first
            if waiter != NULL:
                waiters_remove(&self._waiters, waiter)
            unlock(&self._lock)
            if waiter == NULL:
                break
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
                error = error or raised
        if later is not None:
            later.extend(self._observers)
        else:
            for observer in list(self._observers):
                try:
                    observer()
                except BaseException as raised:
                    error = error or raised
        if error is not None:
            raise error
        return 0

    @property
    def _new_data_callbacks(self):
        """The list of what is called after every insert, by the thread that runs users' code."""
        return self._observers

    cdef void forget(self) noexcept nogil:
        lock_write(&self._lock)
        tree_clear(&self._tree)
        unlock(&self._lock)

    cdef int start_over(self, int64_t cache_time_ns) except -1:
        cdef Tree empty
        cdef Tree old
        memset(&empty, 0, sizeof(Tree))
        if tree_init(&empty, cache_time_ns) != 0:
            tree_free(&empty)
            raise MemoryError
        lock_write(&self._lock)
        old = self._tree
        # Waiters are filed under the old tree's frames: the next insert finds a change and looks at them all.
        empty.changes = old.changes + 1
        self._tree = empty
        unlock(&self._lock)
        tree_free(&old)
        self._malformed = 0
        return 0

    cdef Status lookup(self, const Query* query, Transform* out, int64_t* stamp_ns) noexcept nogil:
        cdef Status status
        lock_read(&self._lock)
        status = query_walk(&self._tree, query, out, stamp_ns)
        unlock(&self._lock)
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


cdef inline bint _never(const char* name, Py_ssize_t size) noexcept nogil:
    # A name that no lookup will ever accept, whatever comes in.
    return size == 0 or name[0] == b"/"


cdef int64_t _now_ns() noexcept nogil:
    cdef timespec now
    clock_gettime(CLOCK_MONOTONIC, &now)
    return now.tv_sec * <int64_t>1000000000 + now.tv_nsec


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
        sem_destroy(&self._woken)

    cdef int _begin(self, Engine engine, tuple names, const Query* query, object notify) except -1:
        cdef Status status
        self._names = names
        self._notify = notify
        self._waiter.query = query[0]
        self._waiter.owner = <void*>self
        self._waiter.woken = &self._woken
        self._waiter.deliver = _post if notify is None else _leave_ready
        self._engine = engine
        lock_write(&engine._lock)
        status = waiters_add(&engine._waiters, &engine._tree, &self._waiter)
        unlock(&engine._lock)
        if status.code == STATUS_OK:
            return 0
        # Whatever else is missing, too: with such a name there will never be an answer.
        if _never(query.target, query.target_size):
            status.code = STATUS_BAD_TARGET
        elif _never(query.source, query.source_size):
            status.code = STATUS_BAD_SOURCE
        elif query.fixed != NULL and _never(query.fixed, query.fixed_size):
            status.code = STATUS_BAD_FIXED
        else:
            return 0
        self._leave()
        raise engine.error(query, status)

    cdef void _leave(self) noexcept nogil:
        lock_write(&self._engine._lock)
        waiters_remove(&self._engine._waiters, &self._waiter)
        unlock(&self._engine._lock)

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
        waiting = self._waiter.place != PLACE_NONE
        waiters_remove(&self._engine._waiters, &self._waiter)
        unlock(&self._engine._lock)
        return waiting

    def reason(self):
        """What a lookup raises now: the exception, or None where it would answer."""
        cdef int64_t stamp_ns
        cdef Status status = self._engine.lookup(&self._waiter.query, NULL, &stamp_ns)
        return None if status.code == STATUS_OK else self._engine.error(&self._waiter.query, status)

    def block(self, int64_t timeout_ns, alive):
        """
        Sleep, without the GIL, until the answer is there.

        :param timeout_ns: nanoseconds of steady time.
        :param alive: called now and then; False ends the wait.
        :return: whether there is an answer. The wait is over in any case, also where a signal handler raises.
        """
        cdef int64_t deadline_ns = _now_ns() + timeout_ns
        cdef int64_t until_ns
        cdef timespec until
        cdef int failed = 0
        try:
            while not self._waiter.answered:
                if not alive():
                    break
                until_ns = min(deadline_ns, _now_ns() + LOOK_UP_NS)
                until.tv_sec = until_ns // 1000000000
                until.tv_nsec = until_ns % 1000000000
                with nogil:
                    failed = sem_clockwait(&self._woken, CLOCK_MONOTONIC, &until)
                PyErr_CheckSignals()
                if failed and until_ns >= deadline_ns and _now_ns() >= deadline_ns:
                    break
        finally:
            self._leave()
        # It may have come between the last sleep and leaving.
        return self._waiter.answered
