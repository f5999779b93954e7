"""The lock of a BufferCore: readers beside readers, usable without the GIL, held for microseconds."""

cdef extern from "<pthread.h>" nogil:
    ctypedef struct pthread_rwlock_t:
        pass
    ctypedef struct pthread_rwlockattr_t:
        pass
    int pthread_rwlock_init(pthread_rwlock_t* lock, const pthread_rwlockattr_t* attributes)
    int pthread_rwlock_destroy(pthread_rwlock_t* lock)
    int pthread_rwlock_rdlock(pthread_rwlock_t* lock)
    int pthread_rwlock_wrlock(pthread_rwlock_t* lock)
    int pthread_rwlock_unlock(pthread_rwlock_t* lock)

# Nobody touches a Python object, or takes the GIL, while he holds the lock; so whoever waits for it with
# the GIL in hand waits for microseconds, and the two cannot wait for each other.
ctypedef pthread_rwlock_t Lock


cdef inline int lock_init(Lock* lock) noexcept nogil:
    return pthread_rwlock_init(lock, NULL)


cdef inline void lock_free(Lock* lock) noexcept nogil:
    pthread_rwlock_destroy(lock)


cdef inline void lock_read(Lock* lock) noexcept nogil:
    pthread_rwlock_rdlock(lock)


cdef inline void lock_write(Lock* lock) noexcept nogil:
    pthread_rwlock_wrlock(lock)


cdef inline void unlock(Lock* lock) noexcept nogil:
    pthread_rwlock_unlock(lock)
