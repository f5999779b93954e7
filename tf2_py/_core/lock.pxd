"""The readers-writer lock of a BufferCore: no thread starves; usable without the GIL."""

from libc.stdint cimport uint32_t

from tf2_py._core.condition cimport (
    condition_init,
    condition_wait,
    pthread_cond_broadcast,
    pthread_cond_destroy,
    pthread_cond_t,
    pthread_mutex_destroy,
    pthread_mutex_init,
    pthread_mutex_lock,
    pthread_mutex_t,
    pthread_mutex_unlock,
)

cdef extern from *:
    """
    #if defined(__x86_64__) || defined(__i386__)
    #define TF2_PAUSE() __builtin_ia32_pause()
    #elif defined(__aarch64__)
    #define TF2_PAUSE() __asm__ __volatile__("yield" ::: "memory")
    #else
    #define TF2_PAUSE() __asm__ __volatile__("" ::: "memory")
    #endif
    #define TF2_LOAD_RELAXED(where) __atomic_load_n(where, __ATOMIC_RELAXED)
    #define TF2_STORE_RELAXED(where, value) __atomic_store_n(where, value, __ATOMIC_RELAXED)
    """
    void _pause "TF2_PAUSE"() nogil
    uint32_t _load_relaxed "TF2_LOAD_RELAXED"(const uint32_t* where) nogil
    void _store_relaxed "TF2_STORE_RELAXED"(uint32_t* where, uint32_t value) nogil

cdef enum:
    SLEEP_NS = 20000000     # how long a thread sleeps before it looks at the counts again
    SPINS = 500     # some 12 us on an AMD EPYC, half a turn: sleeping and being woken costs more


# Readers and writers take turns. A reader that arrives while a writer holds the lock or waits for it follows
# that writer. A writer that is done admits all readers that wait by then, before the next writer. Writers
# follow each other in order of arrival. So a reader waits for one writer at most, and a writer for those
# before it, each with one turn of readers. All hold the lock for tens of microseconds: longer work is done in
# slices.
#
# pthread_rwlock_t promises none of this: glibc's lets readers starve writers, or the other way round.
#
# A thread that holds the lock touches no Python object and does not take the GIL. So a thread that waits for
# the lock and holds the GIL waits for microseconds, and there is no deadlock between the two. The lock is not
# recursive: a thread that reads while it reads may wait for a writer that waits for that thread.
cdef struct Lock:
    pthread_mutex_t mutex           # guards the counts, for a few instructions
    pthread_cond_t readers_turn     # readers wait for it
    pthread_cond_t writers_turn     # writers wait for it
    uint32_t readers                # that hold the lock or have been admitted
    uint32_t readers_waiting
    uint32_t writers_arrived        # ever; the two counts wrap
    uint32_t writers_done           # of these; the difference holds the lock or waits


cdef inline int lock_init(Lock* lock) noexcept nogil:
    lock.readers = lock.readers_waiting = lock.writers_arrived = lock.writers_done = 0
    if pthread_mutex_init(&lock.mutex, NULL) != 0 or condition_init(&lock.readers_turn) != 0:
        return -1
    return condition_init(&lock.writers_turn)


cdef inline void lock_free(Lock* lock) noexcept nogil:
    pthread_cond_destroy(&lock.writers_turn)
    pthread_cond_destroy(&lock.readers_turn)
    pthread_mutex_destroy(&lock.mutex)


cdef inline void _spin_while(const uint32_t* where, uint32_t value) noexcept nogil:
    cdef int spins = 0
    while spins < SPINS and _load_relaxed(where) == value:
        _pause()
        spins += 1


cdef inline void _sleep(pthread_cond_t* condition, pthread_mutex_t* mutex) noexcept nogil:
    # Not without end: condition variables of glibc before 2.41 may lose a wake-up (its bug 25847).
    condition_wait(condition, mutex, SLEEP_NS)


cdef inline void lock_read(Lock* lock) noexcept nogil:
    cdef uint32_t done
    pthread_mutex_lock(&lock.mutex)
    if lock.writers_arrived == lock.writers_done:
        lock.readers += 1
    else:
        # The writer whose turn it is will add it to `readers`.
        lock.readers_waiting += 1
        done = lock.writers_done
        pthread_mutex_unlock(&lock.mutex)
        _spin_while(&lock.writers_done, done)
        pthread_mutex_lock(&lock.mutex)
        while done == lock.writers_done:
            _sleep(&lock.readers_turn, &lock.mutex)
    pthread_mutex_unlock(&lock.mutex)


cdef inline void unlock_read(Lock* lock) noexcept nogil:
    pthread_mutex_lock(&lock.mutex)
    _store_relaxed(&lock.readers, lock.readers - 1)
    if lock.readers == 0 and lock.writers_arrived != lock.writers_done:
        pthread_cond_broadcast(&lock.writers_turn)
    pthread_mutex_unlock(&lock.mutex)


cdef inline void lock_write(Lock* lock) noexcept nogil:
    cdef uint32_t turn
    pthread_mutex_lock(&lock.mutex)
    turn = lock.writers_arrived
    lock.writers_arrived += 1
    if lock.readers == 1 and lock.writers_done == turn:
        # Mostly the reader is one lookup, and short.
        pthread_mutex_unlock(&lock.mutex)
        _spin_while(&lock.readers, 1)
        pthread_mutex_lock(&lock.mutex)
    while lock.readers or lock.writers_done != turn:
        _sleep(&lock.writers_turn, &lock.mutex)
    pthread_mutex_unlock(&lock.mutex)


cdef inline void unlock_write(Lock* lock) noexcept nogil:
    pthread_mutex_lock(&lock.mutex)
    _store_relaxed(&lock.writers_done, lock.writers_done + 1)
    if lock.readers_waiting:
        lock.readers = lock.readers_waiting
        lock.readers_waiting = 0
        pthread_cond_broadcast(&lock.readers_turn)
    elif lock.writers_arrived != lock.writers_done:
        pthread_cond_broadcast(&lock.writers_turn)
    pthread_mutex_unlock(&lock.mutex)
