"""Owns the counts of messages that a receiver took, and what an executor calls in each of its rounds."""

from libc.stddef cimport size_t
from libc.stdint cimport int64_t

from tf2_py._internal cimport (
    FORK_INNER,
    fork_forget,
    fork_watch,
    lock_free,
    lock_init,
    lock_write,
    monotonic_ns,
    unlock_write,
)
from tf2_ros._receive.rcl cimport (
    RCL_RET_OK,
    rcl_guard_condition_t,
    rcl_last_error,
    rcl_trigger_guard_condition,
    rcutils_reset_error,
    require_rcl,
)
from tf2_ros._receive.rclpy_rounds cimport ONE_GUARD_CONDITION, called_by_own_loop, handle_pointer

from collections import deque

# How often messages wake an executor in its own loop, at most.
cdef int64_t ROUND_NS = 100000000


cdef void arrivals_took(ArrivalCounts* arrivals, size_t source, int64_t now_ns) noexcept nogil:
    lock_write(&arrivals.lock)
    arrivals.taken[source] += 1
    arrivals.taken_at_ns[source] = now_ns
    unlock_write(&arrivals.lock)


cdef void arrivals_count(ArrivalCounts* arrivals, size_t source) noexcept nogil:
    cdef bint wake
    lock_write(&arrivals.lock)
    if arrivals.unseen[source] < arrivals.depths[source]:
        arrivals.unseen[source] += 1
    wake = arrivals.waiting
    if arrivals.wake_at_ns != 0 and monotonic_ns() >= arrivals.wake_at_ns:
        arrivals.wake_at_ns = 0
        arrivals.round_due = wake = True
    unlock_write(&arrivals.lock)
    if wake and rcl_trigger_guard_condition(arrivals.guard) != RCL_RET_OK:
        rcutils_reset_error()


cdef class ArrivalWaitable:
    """
    Messages that a receiver took and no round of an executor has accounted for, with what they completed.

    A base for an ``rclpy.waitable.Waitable``: what an executor calls in each of its rounds.
    """

    def __cinit__(self, *_, **__):
        require_rcl()
        if lock_init(&self._counts.lock) != 0:
            raise MemoryError
        fork_watch(&self._counts.forked, &self._counts.lock, FORK_INNER)
        self.completed = deque()
        self._in_user_code = True

    def set_up(self, guard, depths):
        """
        To be called before anything else.

        :param guard: the guard condition that wakes the executor: a handle with a ``pointer``.
        :param depths: of the queue of each source; at most so many messages of it are counted.
        """
        cdef size_t i
        if len(depths) > MAX_SOURCES:
            raise ValueError(f"{len(depths)} sources, at most {MAX_SOURCES} are possible")
        self._handle = guard
        self._counts.guard = <rcl_guard_condition_t*>handle_pointer(guard)
        for i in range(len(depths)):
            self._counts.depths[i] = depths[i]

    def __dealloc__(self):
        fork_forget(&self._counts.forked)
        lock_free(&self._counts.lock)

    def __enter__(self):
        """Do nothing: nobody destroys the guard condition before it is destroyed together with this."""

    def __exit__(self, *_):
        """Do nothing, either."""

    def get_num_entities(self):
        """The guard condition alone."""
        return ONE_GUARD_CONDITION

    def add_to_wait_set(self, wait_set):
        """An executor is about to sleep."""
        self.spun = True
        self._in_user_code = not called_by_own_loop()
        self._wait_set = <void*>wait_set
        self.before_sleep(self._in_user_code)
        if self._has_any(waiting=True):
            self.wake()
        wait_set.add_guard_condition(self._handle)

    def is_ready(self, wait_set):
        """Whether there is something to take."""
        if self._wait_set != <void*>wait_set:
            return False  # the node has moved to another executor, which must not miss anything
        self._wait_set = NULL
        if not self._has_any(waiting=False):
            return False
        # What else is ready comes first, as before a subscription; before user code nothing does.
        return not self._in_user_code or len(self.completed) > 0 or not self.others_ready(wait_set)

    def others_ready(self, wait_set):
        """Whether something else of the node is ready to be executed."""
        return False

    def take_data(self):
        """One message with what it completed; in an executor's own loop, all of them."""
        cdef size_t i
        if not self._in_user_code:
            return [completion for _ in range(len(self.completed)) for completion in self.completed.popleft()]
        if self.completed:
            return self.completed.popleft()
        lock_write(&self._counts.lock)
        for i in range(MAX_SOURCES):
            if self._counts.unseen[i]:
                self._counts.unseen[i] -= 1
                break
        unlock_write(&self._counts.lock)
        return []

    def stop_counting(self, size_t number):
        """Forget the messages that came from this source."""
        lock_write(&self._counts.lock)
        self._counts.unseen[number] = 0
        unlock_write(&self._counts.lock)

    def taken(self, size_t number):
        """How many messages of this source were taken, and the steady time of the last one in nanoseconds."""
        cdef uint64_t count
        cdef int64_t at_ns
        if number >= MAX_SOURCES:
            raise ValueError(f"a source has the number {number}, {MAX_SOURCES} are possible")
        lock_write(&self._counts.lock)
        count, at_ns = self._counts.taken[number], self._counts.taken_at_ns[number]
        unlock_write(&self._counts.lock)
        return count, at_ns

    def before_sleep(self, in_user_code):
        """
        An executor is about to sleep; for what counts by itself.

        :param in_user_code: it was called by user code, which continues before it sleeps again.
        """

    def count(self, size_t number):
        """One message of this source was taken; from any thread."""
        if number >= MAX_SOURCES:
            raise ValueError(f"a source has the number {number}, {MAX_SOURCES} are possible")
        with nogil:
            arrivals_took(&self._counts, number, monotonic_ns())
            arrivals_count(&self._counts, number)

    def wake(self):
        """Trigger the guard condition."""
        if self._handle is None or rcl_trigger_guard_condition(self._counts.guard) != RCL_RET_OK:
            raise RuntimeError(rcl_last_error())

    cdef bint _has_any(self, bint waiting):
        cdef bint found = len(self.completed) > 0
        cdef size_t i
        lock_write(&self._counts.lock)
        self._counts.waiting = waiting and self._in_user_code
        # Signal handlers, tasks that poll and errors of other threads are handled in an executor's rounds,
        # and programs rely on transforms to cause rounds.
        self._counts.wake_at_ns = monotonic_ns() + ROUND_NS if waiting and not self._in_user_code else 0
        found = found or (self._counts.round_due and not waiting)
        self._counts.round_due = False
        for i in range(MAX_SOURCES):
            if not self._in_user_code:
                self._counts.unseen[i] = 0
            found = found or self._counts.unseen[i] > 0
        unlock_write(&self._counts.lock)
        return found
