# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Hold a list of locks around each fork, because threads that held them would not exist in the child.

It uses C's ``pthread_atfork``, not Python's ``os.register_at_fork``: that also covers forks made by C code,
and runs directly around the fork, so that no Python code runs while the locks are held.
"""

cdef extern from "<pthread.h>" nogil:
    int pthread_atfork(void (*prepare)() noexcept, void (*parent)() noexcept, void (*child)() noexcept)

cdef pthread_mutex_t _list_lock         # held while the list changes, and around a fork
cdef ForkedLock* _first_forked


cdef void fork_watch(ForkedLock* forked, Lock* lock) noexcept nogil:
    global _first_forked
    pthread_mutex_lock(&_list_lock)
    forked.lock = lock
    forked.next = _first_forked
    _first_forked = forked
    pthread_mutex_unlock(&_list_lock)


cdef void fork_forget(ForkedLock* forked) noexcept nogil:
    cdef ForkedLock** at = &_first_forked
    pthread_mutex_lock(&_list_lock)
    while at[0] != NULL and at[0] != forked:
        at = &at[0].next
    if at[0] == forked:
        at[0] = forked.next
    pthread_mutex_unlock(&_list_lock)


cdef void _before_fork() noexcept nogil:
    cdef ForkedLock* forked
    pthread_mutex_lock(&_list_lock)
    forked = _first_forked
    while forked != NULL:
        lock_acquire(forked.lock)
        forked = forked.next


cdef void _after_fork_in_parent() noexcept nogil:
    cdef ForkedLock* forked = _first_forked
    while forked != NULL:
        lock_release(forked.lock)
        forked = forked.next
    pthread_mutex_unlock(&_list_lock)


cdef void _after_fork_in_child() noexcept nogil:
    cdef ForkedLock* forked = _first_forked
    pthread_mutex_init(&_list_lock, NULL)
    while forked != NULL:
        # Made anew, because it counts threads that waited for it and that do not exist here.
        lock_init(forked.lock)
        if forked.in_child != NULL:
            forked.in_child(forked.owner)
        forked = forked.next


pthread_mutex_init(&_list_lock, NULL)
if pthread_atfork(_before_fork, _after_fork_in_parent, _after_fork_in_child) != 0:
    raise MemoryError
