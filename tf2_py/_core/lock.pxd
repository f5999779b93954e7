"""The lock of a BufferCore: readers beside readers, nobody starves; usable without the GIL."""

from libc.stdint cimport uint32_t


cdef extern from "<pthread.h>" nogil:
    ctypedef struct pthread_mutex_t:
        pass
    ctypedef struct pthread_cond_t:
        pass
    int pthread_mutex_init(pthread_mutex_t* mutex, const void* attributes)
    int pthread_mutex_destroy(pthread_mutex_t* mutex)
    int pthread_mutex_lock(pthread_mutex_t* mutex)
    int pthread_mutex_unlock(pthread_mutex_t* mutex)
    int pthread_cond_init(pthread_cond_t* condition, const void* attributes)
    int pthread_cond_destroy(pthread_cond_t* condition)
    int pthread_cond_wait(pthread_cond_t* condition, pthread_mutex_t* mutex)
    int pthread_cond_broadcast(pthread_cond_t* condition)

cdef extern from *:
    """
    #if defined(__x86_64__) || defined(__i386__)
    #define TF2_RELAX() __builtin_ia32_pause()
    #elif defined(__aarch64__)
    #define TF2_RELAX() __asm__ __volatile__("yield" ::: "memory")
    #else
    #define TF2_RELAX() __asm__ __volatile__("" ::: "memory")
    #endif
    #define TF2_LOOK(where) __atomic_load_n(where, __ATOMIC_RELAXED)
    #define TF2_SET(where, value) __atomic_store_n(where, value, __ATOMIC_RELAXED)
    """
    void _relax "TF2_RELAX"() nogil
    uint32_t _look "TF2_LOOK"(const uint32_t* where) nogil
    void _set "TF2_SET"(uint32_t* where, uint32_t value) nogil

cdef enum:
    SPINS = 500     # about half a turn (12 us on an AMD EPYC): to sleep and to be woken costs more


# Readers and writers take turns. A reader who comes while a writer holds the lock or waits for it goes after
# that writer; a writer who is done lets all readers in who wait by then, before the next writer; writers go
# in the order in which they came. So a reader waits for one writer at most, and a writer for those before it,
# each with one turn of readers. All hold the lock for tens of microseconds: longer work is done in slices.
#
# pthread_rwlock_t promises none of this: glibc's lets readers starve writers, or the other way round.
#
# Nobody touches a Python object, or takes the GIL, while he holds the lock; so whoever waits for it with the
# GIL in hand waits for microseconds, and the two cannot wait for each other. It is not recursive: two
# readings of one thread, one in the other, may wait for a writer between them.
cdef struct Lock:
    pthread_mutex_t mutex           # over the rest, for a few instructions
    pthread_cond_t readers_turn
    pthread_cond_t writers_turn
    uint32_t readers                # hold the lock, or have been let in
    uint32_t readers_waiting
    uint32_t writers_came           # how many, ever; counters wrap
    uint32_t writers_went


cdef inline int lock_init(Lock* lock) noexcept nogil:
    lock.readers = lock.readers_waiting = lock.writers_came = lock.writers_went = 0
    if pthread_mutex_init(&lock.mutex, NULL) != 0 or pthread_cond_init(&lock.readers_turn, NULL) != 0:
        return -1
    return pthread_cond_init(&lock.writers_turn, NULL)


cdef inline void lock_free(Lock* lock) noexcept nogil:
    pthread_cond_destroy(&lock.writers_turn)
    pthread_cond_destroy(&lock.readers_turn)
    pthread_mutex_destroy(&lock.mutex)


cdef inline void _spin_while(const uint32_t* where, uint32_t value) noexcept nogil:
    cdef int spins = 0
    while spins < SPINS and _look(where) == value:
        _relax()
        spins += 1


cdef inline void lock_read(Lock* lock) noexcept nogil:
    cdef uint32_t went
    pthread_mutex_lock(&lock.mutex)
    if lock.writers_came == lock.writers_went:
        lock.readers += 1
    else:
        # The writer whose turn it is counts it in.
        lock.readers_waiting += 1
        went = lock.writers_went
        pthread_mutex_unlock(&lock.mutex)
        _spin_while(&lock.writers_went, went)
        pthread_mutex_lock(&lock.mutex)
        while went == lock.writers_went:
            pthread_cond_wait(&lock.readers_turn, &lock.mutex)
    pthread_mutex_unlock(&lock.mutex)


cdef inline void unlock_read(Lock* lock) noexcept nogil:
    pthread_mutex_lock(&lock.mutex)
    _set(&lock.readers, lock.readers - 1)
    if lock.readers == 0 and lock.writers_came != lock.writers_went:
        pthread_cond_broadcast(&lock.writers_turn)
    pthread_mutex_unlock(&lock.mutex)


cdef inline void lock_write(Lock* lock) noexcept nogil:
    cdef uint32_t turn
    pthread_mutex_lock(&lock.mutex)
    turn = lock.writers_came
    lock.writers_came += 1
    if lock.readers == 1 and lock.writers_went == turn:
        # A single lookup, mostly.
        pthread_mutex_unlock(&lock.mutex)
        _spin_while(&lock.readers, 1)
        pthread_mutex_lock(&lock.mutex)
    while lock.readers or lock.writers_went != turn:
        pthread_cond_wait(&lock.writers_turn, &lock.mutex)
    pthread_mutex_unlock(&lock.mutex)


cdef inline void unlock_write(Lock* lock) noexcept nogil:
    pthread_mutex_lock(&lock.mutex)
    _set(&lock.writers_went, lock.writers_went + 1)
    if lock.readers_waiting:
        lock.readers = lock.readers_waiting
        lock.readers_waiting = 0
        pthread_cond_broadcast(&lock.readers_turn)
    elif lock.writers_came != lock.writers_went:
        pthread_cond_broadcast(&lock.writers_turn)
    pthread_mutex_unlock(&lock.mutex)
