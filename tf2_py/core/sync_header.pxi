# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Locks, events, clocks and atomic words: what threads without the GIL share."""

# Condition variables that wait on the steady clock, which does not change when the time of day is set.

cdef extern from "<pthread.h>" nogil:
    ctypedef struct pthread_mutex_t:
        pass
    ctypedef struct pthread_cond_t:
        pass
    int pthread_mutex_init(pthread_mutex_t* mutex, const void* attributes)
    int pthread_mutex_destroy(pthread_mutex_t* mutex)
    int pthread_mutex_lock(pthread_mutex_t* mutex)
    int pthread_mutex_unlock(pthread_mutex_t* mutex)
    int pthread_cond_destroy(pthread_cond_t* condition)
    int pthread_cond_signal(pthread_cond_t* condition)
    int pthread_cond_broadcast(pthread_cond_t* condition)

cdef extern from *:
    """
    #include <pthread.h>
    #include <stdint.h>
    #include <time.h>

    #define TF2_S 1000000000

    #ifdef __APPLE__
    /* It has no pthread_condattr_setclock, but waits for a duration. */
    static inline int tf2_condition_init(pthread_cond_t *condition)
    {
        return pthread_cond_init(condition, NULL);
    }

    static inline void tf2_condition_wait(pthread_cond_t *condition, pthread_mutex_t *mutex, int64_t ns)
    {
        struct timespec duration = {.tv_sec = ns / TF2_S, .tv_nsec = ns % TF2_S};
        pthread_cond_timedwait_relative_np(condition, mutex, &duration);
    }
    #else
    static inline int tf2_condition_init(pthread_cond_t *condition)
    {
        pthread_condattr_t attributes;
        int failed = pthread_condattr_init(&attributes);
        if (failed)
            return failed;
        failed = pthread_condattr_setclock(&attributes, CLOCK_MONOTONIC);
        if (!failed)
            failed = pthread_cond_init(condition, &attributes);
        pthread_condattr_destroy(&attributes);
        return failed;
    }

    static inline void tf2_condition_wait(pthread_cond_t *condition, pthread_mutex_t *mutex, int64_t ns)
    {
        struct timespec until;
        clock_gettime(CLOCK_MONOTONIC, &until);
        ns += until.tv_nsec;
        until.tv_sec += ns / TF2_S;
        until.tv_nsec = ns % TF2_S;
        pthread_cond_timedwait(condition, mutex, &until);
    }
    #endif
    """
    int condition_init "tf2_condition_init"(pthread_cond_t* condition) nogil    # 0, or why not
    # With the mutex held, for 0 ns or more; signals of the operating system do not end it.
    void condition_wait "tf2_condition_wait"(pthread_cond_t* condition, pthread_mutex_t* mutex,
                                             int64_t ns) nogil


# Words that several threads read and write without a lock; the names say in which order others see that.

cdef extern from *:
    """
    #define TF2_LOAD_ACQUIRE(word) __atomic_load_n(word, __ATOMIC_ACQUIRE)
    #define TF2_LOAD_SEQ_CST(word) __atomic_load_n(word, __ATOMIC_SEQ_CST)
    #define TF2_STORE_RELEASE(word, value) __atomic_store_n(word, value, __ATOMIC_RELEASE)
    #define TF2_STORE_SEQ_CST(word, value) __atomic_store_n(word, value, __ATOMIC_SEQ_CST)
    #define TF2_ADD_ACQ_REL(word, value) __atomic_fetch_add(word, value, __ATOMIC_ACQ_REL)
    #define TF2_ADD_SEQ_CST(word, value) __atomic_fetch_add(word, value, __ATOMIC_SEQ_CST)
    #define TF2_EXCHANGE_SEQ_CST(word, value) __atomic_exchange_n(word, value, __ATOMIC_SEQ_CST)
    static inline int tf2_replace_seq_cst(uint32_t *word, uint32_t old, uint32_t value)
    {
        return __atomic_compare_exchange_n(word, &old, value, 0, __ATOMIC_SEQ_CST, __ATOMIC_SEQ_CST);
    }
    """
    # Whoever loads what was stored also sees what the storing thread wrote before.
    uint32_t load_acquire "TF2_LOAD_ACQUIRE"(const uint32_t* word) nogil
    void store_release "TF2_STORE_RELEASE"(uint32_t* word, uint32_t value) nogil
    # Those that add and exchange return what the word held before. For counts of owners: the last one sees
    # what all others wrote.
    uint32_t add_acq_rel "TF2_ADD_ACQ_REL"(uint32_t* word, uint32_t value) nogil
    # All threads agree on one order. This is for threads that store one word and then look at another: of
    # two that do so in opposite orders, at least one sees what the other has stored.
    uint32_t load_seq_cst "TF2_LOAD_SEQ_CST"(const uint32_t* word) nogil
    uint64_t load64_seq_cst "TF2_LOAD_SEQ_CST"(const uint64_t* word) nogil
    void store_seq_cst "TF2_STORE_SEQ_CST"(uint32_t* word, uint32_t value) nogil
    void store64_seq_cst "TF2_STORE_SEQ_CST"(uint64_t* word, uint64_t value) nogil
    uint32_t add_seq_cst "TF2_ADD_SEQ_CST"(uint32_t* word, uint32_t value) nogil
    uint32_t exchange_seq_cst "TF2_EXCHANGE_SEQ_CST"(uint32_t* word, uint32_t value) nogil
    uint64_t exchange64_seq_cst "TF2_EXCHANGE_SEQ_CST"(uint64_t* word, uint64_t value) nogil
    # Only if it holds `old`; whether it did.
    bint replace_seq_cst "tf2_replace_seq_cst"(uint32_t* word, uint32_t old, uint32_t value) nogil


# Clocks. The steady one, for deadlines and periods, does not jump when the time of day is set.

cdef inline int64_t monotonic_ns() noexcept nogil:
    cdef timespec now
    clock_gettime(CLOCK_MONOTONIC, &now)
    return now.tv_sec * <int64_t>NS_PER_S + now.tv_nsec


# Since 1970, as ROS counts it.
cdef inline int64_t system_ns() noexcept nogil:
    cdef timespec now
    clock_gettime(CLOCK_REALTIME, &now)
    return now.tv_sec * <int64_t>NS_PER_S + now.tv_nsec


# A thread sleeps until another one has set the event, without the GIL.

cdef struct Event:
    # Only the thread that owns it waits for it. In a forked child it may be locked, and is not touched.
    pthread_mutex_t mutex
    pthread_cond_t changed
    bint is_set             # under the mutex


# By the thread that is going to wait. 0, or -1: it could not be made.
cdef inline int event_init(Event* event) noexcept nogil:
    event.is_set = False
    if pthread_mutex_init(&event.mutex, NULL) != 0:
        return -1
    if condition_init(&event.changed) != 0:
        pthread_mutex_destroy(&event.mutex)
        return -1
    return 0


cdef inline void event_free(Event* event) noexcept nogil:
    pthread_cond_destroy(&event.changed)
    pthread_mutex_destroy(&event.mutex)


cdef inline void event_set(Event* event) noexcept nogil:
    pthread_mutex_lock(&event.mutex)
    event.is_set = True
    pthread_cond_signal(&event.changed)
    pthread_mutex_unlock(&event.mutex)


cdef inline void event_clear(Event* event) noexcept nogil:
    pthread_mutex_lock(&event.mutex)
    event.is_set = False
    pthread_mutex_unlock(&event.mutex)


# Whether it is set. If not, sleeps first, until it is set or `ns` have passed; it may wake earlier.
cdef inline bint event_wait(Event* event, int64_t ns) noexcept nogil:
    cdef bint is_set
    pthread_mutex_lock(&event.mutex)
    if not event.is_set:
        condition_wait(&event.changed, &event.mutex, ns)
    is_set = event.is_set
    pthread_mutex_unlock(&event.mutex)
    return is_set


# A lock that threads get in the order in which they asked for it; usable without the GIL.

cdef extern from *:
    """
    #if defined(__x86_64__) || defined(__i386__)
    #define TF2_PAUSE() __builtin_ia32_pause()
    #elif defined(__aarch64__)
    #define TF2_PAUSE() __asm__ __volatile__("yield" ::: "memory")
    #else
    #define TF2_PAUSE() __asm__ __volatile__("" ::: "memory")
    #endif
    """
    void _pause "TF2_PAUSE"() nogil

cdef enum:
    SLEEP_NS = 20000000     # how long a thread sleeps before it looks at the counts again
    SPINS = 500     # some 12 us on an AMD EPYC, half a turn: sleeping and being woken costs more


# pthread_mutex_t does not keep the order: a thread that inserts slice after slice, and releases the lock in
# between, would nearly always get it back before a thread that sleeps wakes up. With the order kept, a thread
# waits for one turn of each thread before it. All hold the lock for tens of microseconds: longer work is done
# in slices, except that a long history moves to other memory in one go.
#
# Readers exclude each other, too. Nearly all of them hold the GIL while they read, so they could not read at
# the same time in any case.
#
# A thread that holds the lock touches no Python object and does not take the GIL. So a thread that waits for
# the lock and holds the GIL waits for microseconds, and there is no deadlock between the two. The lock is not
# recursive.
cdef struct Lock:
    uint32_t asked              # threads that ever asked for the lock; the two counts wrap
    uint32_t released           # how often it was released; the thread whose number this is has its turn
    pthread_mutex_t mutex       # for sleeping only
    pthread_cond_t turn         # the lock was released


# 0, or -1: it could not be made.
cdef inline int lock_init(Lock* lock) noexcept nogil:
    lock.asked = lock.released = 0
    if pthread_mutex_init(&lock.mutex, NULL) != 0:
        return -1
    return condition_init(&lock.turn)


cdef inline void lock_free(Lock* lock) noexcept nogil:
    pthread_cond_destroy(&lock.turn)
    pthread_mutex_destroy(&lock.mutex)


# The two steps of lock_acquire: asking for a turn, which must then be awaited and released ...
cdef inline uint32_t lock_ask(Lock* lock) noexcept nogil:
    return add_seq_cst(&lock.asked, 1)


# ... and waiting for it. Returns whether it has come within `ns`, or a little later.
cdef inline bint lock_await(Lock* lock, uint32_t number, int64_t ns) noexcept nogil:
    cdef int64_t until_ns
    cdef int spins = 0
    cdef bint has_come
    while load_seq_cst(&lock.released) != number and spins < SPINS:
        _pause()
        spins += 1
    if spins < SPINS:
        return True
    until_ns = INT64_MAX if ns == INT64_MAX else monotonic_ns() + ns
    pthread_mutex_lock(&lock.mutex)
    while load_seq_cst(&lock.released) != number and monotonic_ns() < until_ns:
        # Not without end: condition variables of glibc before 2.41 may lose a wake-up (its bug 25847).
        condition_wait(&lock.turn, &lock.mutex, min(ns, <int64_t>SLEEP_NS))
    has_come = load_seq_cst(&lock.released) == number
    pthread_mutex_unlock(&lock.mutex)
    return has_come


cdef inline void lock_acquire(Lock* lock) noexcept nogil:
    lock_await(lock, lock_ask(lock), INT64_MAX)


cdef inline void lock_release(Lock* lock) noexcept nogil:
    cdef uint32_t released = lock.released + 1
    store_seq_cst(&lock.released, released)
    # A thread that asks after this look sees `released`, because both orders are the same to all threads.
    if load_seq_cst(&lock.asked) != released:
        pthread_mutex_lock(&lock.mutex)
        pthread_cond_broadcast(&lock.turn)
        pthread_mutex_unlock(&lock.mutex)
