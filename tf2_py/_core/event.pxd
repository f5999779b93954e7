"""What a thread sleeps for, without the GIL, until another one has set it."""

from libc.stdint cimport int64_t

from tf2_py._core.condition cimport (
    condition_init,
    condition_wait,
    pthread_cond_destroy,
    pthread_cond_signal,
    pthread_cond_t,
    pthread_mutex_destroy,
    pthread_mutex_init,
    pthread_mutex_lock,
    pthread_mutex_t,
    pthread_mutex_unlock,
)
from tf2_py._core.forking cimport ForkThread, fork_record_thread, fork_thread_exists


cdef struct Event:
    # Of one thread, which alone waits for it. In a forked child without that thread it may be locked,
    # and is not touched.
    pthread_mutex_t mutex
    pthread_cond_t changed
    ForkThread waiting      # the thread
    bint is_set             # under the mutex


# By the thread that is going to wait. 0, or -1: it could not be made.
cdef inline int event_init(Event* event) noexcept nogil:
    event.is_set = False
    fork_record_thread(&event.waiting)
    if pthread_mutex_init(&event.mutex, NULL) != 0:
        return -1
    if condition_init(&event.changed) != 0:
        pthread_mutex_destroy(&event.mutex)
        return -1
    return 0


cdef inline void event_free(Event* event) noexcept nogil:
    if fork_thread_exists(&event.waiting):
        pthread_cond_destroy(&event.changed)
        pthread_mutex_destroy(&event.mutex)


cdef inline void event_set(Event* event) noexcept nogil:
    if not fork_thread_exists(&event.waiting):
        return
    pthread_mutex_lock(&event.mutex)
    event.is_set = True
    pthread_cond_signal(&event.changed)
    pthread_mutex_unlock(&event.mutex)


# Whether it is set; otherwise it sleeps first, until it is, for so long at most. It may wake earlier.
cdef inline bint event_wait(Event* event, int64_t ns) noexcept nogil:
    cdef bint is_set
    pthread_mutex_lock(&event.mutex)
    if not event.is_set:
        condition_wait(&event.changed, &event.mutex, ns)
    is_set = event.is_set
    pthread_mutex_unlock(&event.mutex)
    return is_set
