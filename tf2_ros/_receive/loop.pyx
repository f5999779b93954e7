"""Owns the loop that takes transforms from rcl's subscriptions into a buffer, without the GIL."""

import sys
import traceback
import weakref
from collections import deque

from libc.stddef cimport size_t
from libc.stdint cimport int64_t, uint64_t, uintptr_t
from libc.string cimport memset
from posix.time cimport CLOCK_MONOTONIC, clock_gettime, timespec

from tf2_py._core.forking cimport FORK_INNER, FORK_OUTER, ForkedLock, fork_forget, fork_watch
from tf2_py._core.lock cimport Lock, lock_free, lock_init, lock_write, unlock_write
from tf2_py._engine.engine cimport Engine
from tf2_py._objects.messages cimport name_utf8
from tf2_py._wire.batch cimport Batch, batch_begin, batch_free, batch_read_cdr
from tf2_ros._receive.journal cimport Journal, KeptMessage, journal_clear, journal_keep, kept_data
from tf2_ros._receive.rcl cimport (
    RCL_RET_OK,
    RCL_RET_SUBSCRIPTION_TAKE_FAILED,
    RCL_RET_TIMEOUT,
    c_bool,
    rcl_allocator_t,
    rcl_clock_get_now,
    rcl_clock_t,
    rcl_context_is_valid,
    rcl_context_t,
    rcl_error_string_t,
    rcl_event_t,
    rcl_get_default_allocator,
    rcl_get_error_string,
    rcl_get_zero_initialized_wait_set,
    rcl_guard_condition_t,
    rcl_is_enabled_ros_time_override,
    rcl_reset_error,
    rcl_ret_t,
    rcl_serialized_message_t,
    rcl_subscription_t,
    rcl_take_serialized_message,
    rcl_trigger_guard_condition,
    rcl_wait,
    rcl_wait_set_add_event,
    rcl_wait_set_add_guard_condition,
    rcl_wait_set_add_subscription,
    rcl_wait_set_clear,
    rcl_wait_set_fini,
    rcl_wait_set_init,
    rcl_wait_set_t,
    rmw_get_zero_initialized_serialized_message,
    rmw_serialized_message_fini,
    rmw_serialized_message_init,
)

from rclpy.waitable import NumberOfEntities

from tf2_py._objects import log

cdef extern from "Python.h":
    ctypedef struct CPythonType "PyTypeObject":
        # Another one after every change of an attribute of the type or of one of its bases; 0: none.
        unsigned int tp_version_tag

cdef enum:
    MAX_SOURCES = 2             # dynamic and static transforms
    MAX_TYPES = 2               # whose attributes decide: the listener's and the buffer's
    MAX_IN_A_ROW = 100          # messages of one source, before the other and the guard get their turn
    KEEP_BYTES = 1 << 20        # more memory than that is not kept from one message to the next

# A signal ends a context without a word to those who wait in it; and an event would make each message dearer.
cdef int64_t WAKE_CHECK_NS = 1000000000

# How often messages give an executor in its own loop a turn, at most.
cdef int64_t TURN_NS = 100000000


cdef struct Source:
    size_t number               # under which its messages are counted
    const rcl_subscription_t* subscription
    const rcl_event_t* event    # may happen to it; or NULL
    bint happened
    bint is_static


cdef enum Outcome:
    OUTCOME_WOKEN               # the guard was triggered, an event happened, a watched type changed
    OUTCOME_ENDED               # the context has ended
    OUTCOME_FAILED              # rcl tells why


cdef bint _take_some(Engine engine, Batch* batch) noexcept nogil:
    return engine.insert_some(batch)


# Without the GIL nobody can count references: the loop knows the engine by its address alone.
ctypedef bint (*TakeSome)(void* engine, Batch* batch) noexcept nogil
cdef TakeSome take_some = <TakeSome>_take_some


class _OneGuardCondition(NumberOfEntities):
    """Added to other numbers in each round of an executor, without the slow addition of rclpy 7."""

    def __radd__(self, other):
        other.num_guard_conditions += 1
        return other


cdef object ONE_GUARD_CONDITION = _OneGuardCondition(0, 1)


cdef struct ArrivalCounts:
    Lock lock
    ForkedLock forked               # lock
    uint64_t unseen[MAX_SOURCES]    # messages of each source that no round of an executor has accounted for
    uint64_t depths[MAX_SOURCES]    # of the queues: more messages an executor would not have found there
    bint waiting                    # an executor sleeps, and wants to wake for each message
    int64_t wake_at_ns              # or sleeps in its own loop, and wants to wake for one from then on; or 0
    bint turn_due                   # it was woken so
    rcl_guard_condition_t* guard    # wakes it


cdef void _count(ArrivalCounts* arrivals, size_t source) noexcept nogil:
    cdef bint wake
    lock_write(&arrivals.lock)
    if arrivals.unseen[source] < arrivals.depths[source]:
        arrivals.unseen[source] += 1
    wake = arrivals.waiting
    if arrivals.wake_at_ns != 0 and _now_ns() >= arrivals.wake_at_ns:
        arrivals.wake_at_ns = 0
        arrivals.turn_due = wake = True
    unlock_write(&arrivals.lock)
    if wake and rcl_trigger_guard_condition(arrivals.guard) != RCL_RET_OK:
        rcl_reset_error()


cdef class ArrivalWaitable:
    """
    Messages that a receiver took and no round of an executor has accounted for, with what they completed.

    A base for an ``rclpy.waitable.Waitable``: what an executor calls in each of its rounds.
    """

    cdef ArrivalCounts _counts
    cdef object _handle             # keeps the guard condition
    cdef dict _loops
    # One entry for each message that completed something: it counts for that message, too.
    cdef readonly object completed
    cdef readonly bint spun         # by any executor, ever
    cdef bint _watched              # code of a user runs before the executor sleeps again
    cdef void* _wait_set            # of the executor that went to sleep last, where it has not woken yet

    def __cinit__(self, *_, **__):
        if lock_init(&self._counts.lock) != 0:
            raise MemoryError
        fork_watch(&self._counts.forked, &self._counts.lock, FORK_INNER)
        self._loops = {}
        self.completed = deque()
        self._watched = True

    def set_up(self, guard, depths, dict loops not None):
        """
        To be called before anything else.

        :param guard: the guard condition that wakes the executor: a handle with a ``pointer``.
        :param depths: of the queue of each source; at most so many messages of it are counted.
        :param loops: by the name of a file, the names of its functions that are loops of an executor; in all
            other functions of these files, an executor is called by a user sooner or later.
        """
        cdef size_t i
        if len(depths) > MAX_SOURCES:
            raise ValueError(f"{len(depths)} sources, at most {MAX_SOURCES} are possible")
        self._handle = guard
        self._loops = loops
        self._counts.guard = <rcl_guard_condition_t*><uintptr_t>guard.pointer
        for i in range(len(depths)):
            self._counts.depths[i] = depths[i]

    def __dealloc__(self):
        fork_forget(&self._counts.forked)
        lock_free(&self._counts.lock)

    def __enter__(self):
        """Do nothing: nobody destroys the guard condition before it goes together with this."""

    def __exit__(self, *_):
        """Do nothing, either."""

    def get_num_entities(self):
        """The guard condition alone."""
        return ONE_GUARD_CONDITION

    def add_to_wait_set(self, wait_set):
        """An executor is going to sleep."""
        self.spun = True
        self._watched = self._is_watched()
        self._wait_set = <void*>wait_set
        if self._any(waiting=True):
            self.wake()
        wait_set.add_guard_condition(self._handle)

    def is_ready(self, wait_set):
        """Whether there is something to take."""
        if self._wait_set != <void*>wait_set:
            return False  # the node has gone to another executor, which must not miss anything
        self._wait_set = NULL
        if not self._any(waiting=False):
            return False
        # What else is ready comes first, as before a subscription; for code of a user nothing is.
        return not self._watched or len(self.completed) > 0 or not self.others_ready(wait_set)

    def others_ready(self, wait_set):
        """Whether something else of the node is ready to be executed."""
        return False

    def take_data(self):
        """One message with what it completed; in an executor's own loop, all of them."""
        cdef size_t i
        if not self._watched:
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

    def forget(self, size_t number):
        """Count no more what came from this source."""
        lock_write(&self._counts.lock)
        self._counts.unseen[number] = 0
        unlock_write(&self._counts.lock)

    def wake(self):
        """Trigger the guard condition."""
        if self._handle is None or rcl_trigger_guard_condition(self._counts.guard) != RCL_RET_OK:
            raise RuntimeError(_last_error())

    cdef bint _any(self, bint waiting):
        cdef bint found = len(self.completed) > 0
        cdef size_t i
        lock_write(&self._counts.lock)
        self._counts.waiting = waiting and self._watched
        # Signal handlers, tasks that poll and errors of other threads get their turn in an executor's rounds,
        # and programs rely on transforms to bring these about.
        self._counts.wake_at_ns = _now_ns() + TURN_NS if waiting and not self._watched else 0
        found = found or (self._counts.turn_due and not waiting)
        self._counts.turn_due = False
        for i in range(MAX_SOURCES):
            if not self._watched:
                self._counts.unseen[i] = 0
            found = found or self._counts.unseen[i] > 0
        unlock_write(&self._counts.lock)
        return found

    cdef bint _is_watched(self) except -1:
        # It is where the executor was called by something else than its own loops.
        frame = sys._getframe()
        while frame is not None:
            code = frame.f_code
            loops = self._loops.get(code.co_filename)
            if loops is None:
                return True
            if code.co_name in loops:
                return False
            frame = frame.f_back
        return True


cdef class Receiver:
    """
    Takes messages from subscriptions into a buffer.

    :param buffer: a BufferCore. It is not kept alive, for what waits in it may lead to the node: a thread in
        :meth:`run` would keep both for ever. Only one that cannot be referenced weakly is kept.
    :param str authority: who says so.
    :param arrivals: counts the messages.
    :param hand_over: called with a list of callables that run a user's code: what a message completed. Where
        it returns true, the message is counted with these, and not in `arrivals`.
    """

    cdef void* _engine          # NULL: it is gone; guarded by _engine_lock
    cdef Lock _engine_lock      # held while the engine is at work
    cdef ForkedLock _forked     # _engine_lock
    cdef object _reference      # called, gives the engine or None
    cdef str _authority         # keeps the batch's UTF-8 alive
    cdef Batch _batch
    cdef rcl_serialized_message_t _message
    cdef rcl_wait_set_t _set
    cdef rcl_context_t* _context
    cdef const rcl_guard_condition_t* _guard
    cdef Source _sources[MAX_SOURCES]
    cdef size_t _count          # of sources
    cdef list _topics           # their names
    cdef ArrivalWaitable _arrivals
    cdef ArrivalCounts* _counts     # of _arrivals
    cdef object _hand_over
    cdef list _watched          # types; keeps _types
    cdef CPythonType* _types[MAX_TYPES]
    cdef unsigned int _versions[MAX_TYPES]
    cdef bint _changed          # an attribute that decides was set on an object
    cdef bint _spent            # the one message that may be taken where a type has no version
    cdef rcl_clock_t* _clock    # of the buffer, or NULL
    cdef Journal _journal       # guarded by _engine_lock

    def __cinit__(self, Engine buffer not None, str authority not None, ArrivalWaitable arrivals not None,
                  hand_over):
        cdef Py_ssize_t size
        if lock_init(&self._engine_lock) != 0:
            raise MemoryError
        fork_watch(&self._forked, &self._engine_lock, FORK_OUTER)
        if not _message_init(&self._message):
            raise MemoryError
        self._authority = authority
        self._batch.authority = name_utf8(authority, &size)
        self._batch.authority_size = size
        if type(buffer).__weakrefoffset__:
            self._reference = weakref.ref(buffer, self._forget)
        else:
            self._reference = lambda: buffer
        self._engine = <void*>buffer
        self._arrivals = arrivals
        self._counts = &arrivals._counts
        self._hand_over = hand_over
        self._watched = []

    def __dealloc__(self):
        fork_forget(&self._forked)
        journal_clear(&self._journal)
        batch_free(&self._batch)
        _message_free(&self._message)
        lock_free(&self._engine_lock)

    def _forget(self, _):
        with nogil:
            lock_write(&self._engine_lock)
        self._engine = NULL
        unlock_write(&self._engine_lock)

    def watch(self, types):
        """
        Let :meth:`run` return before it takes another message, once an attribute of one of these changed.

        :param types: at most two. :meth:`changed` is for the attributes of objects.
        """
        cdef size_t i = 0
        self._changed = False
        if len(types) > MAX_TYPES:
            raise ValueError(f"{len(types)} types, at most {MAX_TYPES} are possible")
        self._types[0] = self._types[1] = NULL
        self._watched = list(types)
        for one in self._watched:
            getattr(one, "__init__", None)  # looking an attribute up gives a type its version
            self._types[i] = <CPythonType*><void*>one
            self._versions[i] = self._types[i].tp_version_tag
            i += 1

    def changed(self):
        """Let :meth:`run` return before it takes another message; the caller triggers the guard condition."""
        self._changed = True

    def fills(self, Engine buffer not None):
        """Whether the transforms go into this buffer."""
        return self._engine == <void*>buffer

    def replay(self, int64_t until_ns):
        """
        Insert again what arrived since the clock last moved forward, but for stamps after `until_ns`.

        For the jump callback of the clock, after the buffer was cleared.
        """
        cdef Journal journal
        cdef KeptMessage* kept
        cdef Batch batch
        cdef Engine engine = self._reference()
        cdef list later = []
        with nogil:
            lock_write(&self._engine_lock)
        journal = self._journal
        self._journal.first = self._journal.last = NULL
        self._journal.bytes = 0
        self._journal.time_ns = until_ns
        unlock_write(&self._engine_lock)
        memset(&batch, 0, sizeof(Batch))
        batch.authority = self._batch.authority
        batch.authority_size = self._batch.authority_size
        try:
            kept = journal.first
            while kept != NULL and engine is not None:
                if batch_read_cdr(&batch, kept_data(kept), kept.size):
                    _keep_until(&batch, until_ns)
                    engine.insert(&batch)
                    if batch.needs_report:
                        engine.report(&batch, later)
                kept = kept.after
        finally:
            batch_free(&batch)
            journal_clear(&journal)
            if later:
                self._hand_over(later)

    def run(self, context, guard, clock, sources):
        """
        Take in what comes, until the guard condition is triggered, an event happens or the context ends.

        :param clock: address of the ``rcl_clock_t`` of the buffer, or 0.

        :param context: address of the ``rcl_context_t``.
        :param guard: address of an ``rcl_guard_condition_t`` that nobody else waits for.
        :param sources: at most two tuples: the number under which its messages are counted, address of an
            ``rcl_subscription_t``, address of an ``rcl_event_t`` or 0, the topic's name, whether its
            transforms are static.
        :return: which events have happened, by their addresses; None if the context has ended. An empty list
            where what :meth:`watch` is about has changed.
        :raises RuntimeError: rcl failed; the text says how.

        What is behind the addresses must stay. An event is told within a second.
        """
        cdef Outcome outcome
        cdef size_t i
        if len(sources) > MAX_SOURCES:
            raise ValueError(f"{len(sources)} sources, at most {MAX_SOURCES} are possible")
        self._context = <rcl_context_t*><uintptr_t>context
        self._guard = <const rcl_guard_condition_t*><uintptr_t>guard
        self._clock = <rcl_clock_t*><uintptr_t>clock
        self._spent = False
        self._topics = []
        self._count = 0
        for number, subscription, event, topic, is_static in sources:
            if not 0 <= number < MAX_SOURCES:
                raise ValueError(f"a source has the number {number}, {MAX_SOURCES} are possible")
            self._sources[self._count].number = number
            self._sources[self._count].subscription = <const rcl_subscription_t*><uintptr_t>subscription
            self._sources[self._count].event = <const rcl_event_t*><uintptr_t>event
            self._sources[self._count].happened = False
            self._sources[self._count].is_static = is_static
            self._topics.append(topic)
            self._count += 1
        with nogil:
            outcome = self._serve()
        if outcome == OUTCOME_FAILED:
            raise RuntimeError(_last_error())
        if outcome == OUTCOME_ENDED:
            return None
        return [<uintptr_t>self._sources[i].event for i in range(self._count) if self._sources[i].happened]

    cdef Outcome _serve(self) noexcept nogil:
        cdef Outcome outcome = OUTCOME_FAILED
        self._set = rcl_get_zero_initialized_wait_set()
        if rcl_wait_set_init(&self._set, self._count, 1, 0, 0, 0, self._count, self._context,
                             rcl_get_default_allocator()) == RCL_RET_OK:
            outcome = self._loop()
            if rcl_wait_set_fini(&self._set) != RCL_RET_OK:
                rcl_reset_error()
        if outcome == OUTCOME_FAILED and not rcl_context_is_valid(self._context):
            rcl_reset_error()
            return OUTCOME_ENDED
        return outcome

    cdef Outcome _loop(self) noexcept nogil:
        cdef rcl_ret_t result
        cdef size_t i
        cdef int64_t now_ns
        cdef int64_t wake_check_ns = 0
        while rcl_context_is_valid(self._context):
            now_ns = _now_ns()
            result = self._arm(now_ns >= wake_check_ns)
            if now_ns >= wake_check_ns:
                wake_check_ns = now_ns + WAKE_CHECK_NS
            if result == RCL_RET_OK:
                result = rcl_wait(&self._set, WAKE_CHECK_NS)
            if result == RCL_RET_TIMEOUT:
                continue
            if result != RCL_RET_OK:
                return OUTCOME_FAILED
            for i in range(self._count):
                if self._set.subscriptions[i] != NULL and self._drain(i) != RCL_RET_OK:
                    return OUTCOME_FAILED
            if not self._is_unchanged():
                return OUTCOME_WOKEN
            if self._set.guard_conditions[0] != NULL or self._events_happened():
                return OUTCOME_WOKEN
        return OUTCOME_ENDED

    cdef inline bint _is_unchanged(self) noexcept nogil:
        cdef size_t i
        for i in range(MAX_TYPES):
            if self._types[i] != NULL and self._types[i].tp_version_tag != self._versions[i]:
                return False
        return not self._changed

    cdef bint _may_take(self) noexcept nogil:
        # A type whose attributes change very often gets no version: it is looked at for each message.
        cdef size_t i
        cdef bint versioned = True
        if not self._is_unchanged():
            return False
        for i in range(MAX_TYPES):
            if self._types[i] != NULL and self._versions[i] == 0:
                versioned = False
        if versioned:
            return True
        if self._spent:
            self._changed = True
            return False
        self._spent = True
        return True

    cdef bint _events_happened(self) noexcept nogil:
        cdef bint any_happened = False
        cdef size_t i, j
        for i in range(self._count):
            for j in range(self._count):
                if self._set.events[j] != NULL and self._set.events[j] == self._sources[i].event:
                    self._sources[i].happened = any_happened = True
        return any_happened

    cdef rcl_ret_t _arm(self, bint with_events) noexcept nogil:
        # Waiting strikes out what is not ready, so the set is filled anew each time.
        cdef rcl_ret_t result = rcl_wait_set_clear(&self._set)
        cdef size_t i
        if result == RCL_RET_OK:
            result = rcl_wait_set_add_guard_condition(&self._set, self._guard, NULL)
        for i in range(self._count):
            if result == RCL_RET_OK:
                result = rcl_wait_set_add_subscription(&self._set, self._sources[i].subscription, NULL)
            if result == RCL_RET_OK and with_events and self._sources[i].event != NULL:
                result = rcl_wait_set_add_event(&self._set, self._sources[i].event, NULL)
        return result

    cdef rcl_ret_t _drain(self, size_t index) noexcept nogil:
        cdef rcl_ret_t result = RCL_RET_OK
        cdef int _
        self._batch.is_static = self._sources[index].is_static
        for _ in range(MAX_IN_A_ROW):
            if not self._may_take():
                break
            result = rcl_take_serialized_message(
                self._sources[index].subscription, &self._message, NULL, NULL
            )
            if result != RCL_RET_OK:
                break
            self._take_message(index)
            if self._message.buffer_capacity > KEEP_BYTES:
                self._give_back()
        return RCL_RET_OK if result == RCL_RET_SUBSCRIPTION_TAKE_FAILED else result

    cdef void _take_message(self, size_t index) noexcept nogil:
        cdef bint due = False
        cdef bint handed_over = False
        cdef bint more = False
        lock_write(&self._engine_lock)
        if self._engine != NULL:
            batch_begin(&self._batch)
            more = batch_read_cdr(&self._batch, self._message.buffer, self._message.buffer_length)
            due = not more
            if more:
                self._keep_for_jump()
        while more and self._engine != NULL:
            more = take_some(self._engine, &self._batch)
            due = self._batch.needs_report
            # A fork, or the end of the buffer, waits for one slice only.
            unlock_write(&self._engine_lock)
            lock_write(&self._engine_lock)
        unlock_write(&self._engine_lock)
        if due:
            handed_over = self._report(index)
        if not handed_over:
            _count(self._counts, self._sources[index].number)

    cdef void _keep_for_jump(self) noexcept nogil:
        # Where time is simulated, a message of a restarted recording may overtake the clock's jump.
        cdef c_bool simulated = False
        cdef int64_t now_ns
        if self._batch.is_static or self._clock == NULL:
            return
        if rcl_is_enabled_ros_time_override(self._clock, &simulated) != RCL_RET_OK or not simulated:
            return
        if rcl_clock_get_now(self._clock, &now_ns) == RCL_RET_OK:
            journal_keep(&self._journal, now_ns, self._message.buffer, self._message.buffer_length)

    cdef void _give_back(self) noexcept nogil:
        batch_free(&self._batch)
        _message_free(&self._message)
        _message_init(&self._message)

    cdef bint _report(self, size_t index) noexcept with gil:
        # Whether the message has been handed over, with what it completed.
        cdef Engine engine = self._reference()
        cdef list later = []
        if engine is None:
            return False
        try:
            if self._batch.problem != NULL:
                engine.malformed(&self._batch, self._message.buffer_length, self._topics[index])
            else:
                engine.report(&self._batch, later)
        except BaseException:
            # No memory, mostly; the next message may fare better.
            if engine._throttle.passes("receiver"):
                log._logger().error(f"While transforms came in: {traceback.format_exc()}")
        return bool(later) and self._hand_over(later)


cdef void _keep_until(Batch* batch, int64_t until_ns) noexcept nogil:
    cdef size_t i
    cdef size_t count = 0
    for i in range(batch.count):
        if batch.entries[i].incoming.stamp_ns <= until_ns:
            batch.entries[count] = batch.entries[i]
            count += 1
    batch.count = count


cdef int64_t _now_ns() noexcept nogil:
    cdef timespec now
    clock_gettime(CLOCK_MONOTONIC, &now)
    return now.tv_sec * <int64_t>1000000000 + now.tv_nsec


cdef bint _message_init(rcl_serialized_message_t* message) noexcept nogil:
    # Of no bytes: rcl gives it as many as it needs.
    cdef rcl_allocator_t allocator = rcl_get_default_allocator()
    message[0] = rmw_get_zero_initialized_serialized_message()
    return rmw_serialized_message_init(message, 0, &allocator) == RCL_RET_OK


cdef void _message_free(rcl_serialized_message_t* message) noexcept nogil:
    if rmw_serialized_message_fini(message) != RCL_RET_OK:
        rcl_reset_error()


cdef str _last_error():
    cdef rcl_error_string_t error = rcl_get_error_string()
    rcl_reset_error()
    return error.str.decode("utf-8", "replace")
