"""
Owns the list of locks to be held around a fork: in the child their holders do not exist.

C's ``pthread_atfork`` and not Python's ``os.register_at_fork``: it also runs for the forks of C code, and
right around the fork, so that no Python code runs while the locks are held.
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

cdef pthread_mutex_t _list_lock         # held while the lists change, and around a fork
cdef ForkedLock* _first[FORK_ORDERS]
cdef uint32_t _generation = 0
cdef pthread_t _survivor = 0            # the thread that made the last fork ...
cdef uint32_t _survives_since = 0       # ... and a generation not before the one in which it began


cdef void fork_watch(ForkedLock* forked, Lock* lock, int order) noexcept nogil:
    pthread_mutex_lock(&_list_lock)
    forked.lock = lock
    forked.order = order
    forked.previous = NULL
    forked.next = _first[order]
    if forked.next != NULL:
        forked.next.previous = forked
    _first[order] = forked
    pthread_mutex_unlock(&_list_lock)


cdef void fork_forget(ForkedLock* forked) noexcept nogil:
    if forked.lock == NULL:
        return
    pthread_mutex_lock(&_list_lock)
    if forked.next != NULL:
        forked.next.previous = forked.previous
    if forked.previous != NULL:
        forked.previous.next = forked.next
    else:
        _first[forked.order] = forked.next
    forked.lock = NULL
    pthread_mutex_unlock(&_list_lock)


cdef void _with_each(void (*what)(Lock* lock) noexcept nogil) noexcept nogil:
    cdef ForkedLock* forked
    cdef int order
    for order in range(FORK_ORDERS):
        forked = _first[order]
        while forked != NULL:
            what(forked.lock)
            forked = forked.next


cdef void _reinitialise(Lock* lock) noexcept nogil:
    lock_init(lock)


cdef void _before_fork() noexcept nogil:
    pthread_mutex_lock(&_list_lock)
    _with_each(lock_write)


cdef void _after_fork_in_parent() noexcept nogil:
    _with_each(unlock_write)
    pthread_mutex_unlock(&_list_lock)


cdef void _after_fork_in_child() noexcept nogil:
    # Initialise the locks: they count threads that waited for them and that do not exist here.
    global _generation, _survivor, _survives_since
    cdef ForkedLock* forked
    cdef int order
    _with_each(_reinitialise)
    pthread_mutex_init(&_list_lock, NULL)
    for order in range(FORK_ORDERS):
        forked = _first[order]
        while forked != NULL:
            if forked.in_child != NULL:
                forked.in_child(forked.owner)
            forked = forked.next
    # Ids of threads are reused: what was recorded with this id before this thread began is another thread's.
    if not pthread_equal(_survivor, pthread_self()):
        _survivor = pthread_self()
        _survives_since = _generation
    _generation += 1


cdef void fork_record_thread(ForkThread* thread) noexcept nogil:
    thread.generation = _generation
    thread.thread = pthread_self()


cdef bint fork_thread_exists(const ForkThread* thread) noexcept nogil:
    if thread.generation == _generation:
        return True
    return thread.generation >= _survives_since and pthread_equal(thread.thread, _survivor)


cdef uint32_t fork_generation() noexcept nogil:
    return _generation


pthread_mutex_init(&_list_lock, NULL)
if pthread_atfork(_before_fork, _after_fork_in_parent, _after_fork_in_child) != 0:
    raise MemoryError
