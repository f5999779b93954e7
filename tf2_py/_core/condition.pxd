"""Condition variables that are waited for on the steady clock: setting the time of day does not move it."""

from libc.stdint cimport int64_t


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
    # With the mutex held, for 0 ns or more; signals of the system do not end it.
    void condition_wait "tf2_condition_wait"(pthread_cond_t* condition, pthread_mutex_t* mutex,
                                             int64_t ns) nogil
