"""
Hold a list of locks around each fork, because threads that held them would not exist in the child.

It uses C's ``pthread_atfork``, not Python's ``os.register_at_fork``: that also covers forks made by C code,
and runs directly around the fork, so that no Python code runs while the locks are held.
"""

cdef extern from "<pthread.h>" nogil:
    int pthread_atfork(void (*prepare)() noexcept, void (*parent)() noexcept, void (*child)() noexcept)

cdef pthread_mutex_t _list_lock         # held while the lists change, and around a fork
cdef ForkedLock* _first_forked[FORK_ORDERS]


cdef void fork_watch(ForkedLock* forked, Lock* lock, int order) noexcept nogil:
    pthread_mutex_lock(&_list_lock)
    forked.lock = lock
    forked.order = order
    forked.previous = NULL
    forked.next = _first_forked[order]
    if forked.next != NULL:
        forked.next.previous = forked
    _first_forked[order] = forked
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
        _first_forked[forked.order] = forked.next
    forked.lock = NULL
    pthread_mutex_unlock(&_list_lock)


cdef void _with_each(void (*what)(Lock* lock) noexcept nogil) noexcept nogil:
    cdef ForkedLock* forked
    cdef int order
    for order in range(FORK_ORDERS):
        forked = _first_forked[order]
        while forked != NULL:
            what(forked.lock)
            forked = forked.next


cdef void _reinitialise(Lock* lock) noexcept nogil:
    lock_init(lock)


cdef void _before_fork() noexcept nogil:
    pthread_mutex_lock(&_list_lock)
    _with_each(lock_acquire)


cdef void _after_fork_in_parent() noexcept nogil:
    _with_each(lock_release)
    pthread_mutex_unlock(&_list_lock)


cdef void _after_fork_in_child() noexcept nogil:
    # Initialise the locks: they count threads that waited for them and that do not exist here.
    cdef ForkedLock* forked
    cdef int order
    _with_each(_reinitialise)
    pthread_mutex_init(&_list_lock, NULL)
    for order in range(FORK_ORDERS):
        forked = _first_forked[order]
        while forked != NULL:
            if forked.in_child != NULL:
                forked.in_child(forked.owner)
            forked = forked.next


pthread_mutex_init(&_list_lock, NULL)
if pthread_atfork(_before_fork, _after_fork_in_parent, _after_fork_in_child) != 0:
    raise MemoryError
