"""
Owns the locks of the process across a fork: their holders do not exist in the child.

C's `pthread_atfork` and not Python's `os.register_at_fork`: it runs for the forks of C code, too, and right
around the fork, so that no code of Python runs while the locks are held.
"""

from libc.stdint cimport uint32_t

from tf2_py._core.lock cimport Lock, lock_init, lock_write, unlock_write

cdef extern from "<pthread.h>" nogil:
    ctypedef struct pthread_mutex_t:
        pass
    ctypedef struct pthread_mutexattr_t:
        pass
    pthread_t pthread_self()
    bint pthread_equal(pthread_t a, pthread_t b)
    int pthread_mutex_init(pthread_mutex_t* mutex, const pthread_mutexattr_t* attributes)
    int pthread_mutex_lock(pthread_mutex_t* mutex)
    int pthread_mutex_unlock(pthread_mutex_t* mutex)
    int pthread_atfork(void (*prepare)() noexcept, void (*parent)() noexcept, void (*child)() noexcept)

cdef pthread_mutex_t _listing           # held to change the lists, and around a fork
cdef ForkedLock* _first[FORK_ORDERS]
cdef uint32_t _generation = 0
cdef pthread_t _survivor = 0            # of the last fork ...
cdef uint32_t _survives_since = 0       # ... and in which generation it began, or later


cdef void fork_watch(ForkedLock* forked, Lock* lock, int order) noexcept nogil:
    pthread_mutex_lock(&_listing)
    forked.lock = lock
    forked.order = order
    forked.before = NULL
    forked.after = _first[order]
    if forked.after != NULL:
        forked.after.before = forked
    _first[order] = forked
    pthread_mutex_unlock(&_listing)


cdef void fork_forget(ForkedLock* forked) noexcept nogil:
    if forked.lock == NULL:
        return
    pthread_mutex_lock(&_listing)
    if forked.after != NULL:
        forked.after.before = forked.before
    if forked.before != NULL:
        forked.before.after = forked.after
    else:
        _first[forked.order] = forked.after
    forked.lock = NULL
    pthread_mutex_unlock(&_listing)


cdef void _with_each(void (*what)(Lock* lock) noexcept nogil) noexcept nogil:
    cdef ForkedLock* forked
    cdef int order
    for order in range(FORK_ORDERS):
        forked = _first[order]
        while forked != NULL:
            what(forked.lock)
            forked = forked.after


cdef void _make_anew(Lock* lock) noexcept nogil:
    lock_init(lock)


cdef void _before_fork() noexcept nogil:
    pthread_mutex_lock(&_listing)
    _with_each(lock_write)


cdef void _after_fork_in_parent() noexcept nogil:
    _with_each(unlock_write)
    pthread_mutex_unlock(&_listing)


cdef void _after_fork_in_child() noexcept nogil:
    # New ones: threads that queued for the old ones are counted there, and will never come.
    global _generation, _survivor, _survives_since
    _with_each(_make_anew)
    pthread_mutex_init(&_listing, NULL)
    # Ids of threads are given again: a note of that id may be another thread's, from before this one began.
    if not pthread_equal(_survivor, pthread_self()):
        _survivor = pthread_self()
        _survives_since = _generation
    _generation += 1


cdef void fork_note(ForkNote* note) noexcept nogil:
    note.generation = _generation
    note.thread = pthread_self()


cdef bint fork_is_here(const ForkNote* note) noexcept nogil:
    if note.generation == _generation:
        return True
    return note.generation >= _survives_since and pthread_equal(note.thread, _survivor)


cdef uint32_t fork_generation() noexcept nogil:
    return _generation


pthread_mutex_init(&_listing, NULL)
if pthread_atfork(_before_fork, _after_fork_in_parent, _after_fork_in_child) != 0:
    raise MemoryError
