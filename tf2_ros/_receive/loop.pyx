"""Owns the loop that takes transforms from rcl's subscriptions into a buffer, without the GIL."""

from libc.stddef cimport size_t
from libc.stdint cimport int64_t, uintptr_t
from libc.string cimport memset

from tf2_py._internal cimport (
    FORK_OUTER,
    Batch,
    Engine,
    ForkedLock,
    Lock,
    batch_begin,
    batch_free,
    batch_read_cdr,
    flag_set,
    fork_forget,
    fork_watch,
    lock_free,
    lock_init,
    lock_write,
    monotonic_ns,
    name_utf8,
    system_ns,
    unlock_write,
)
from tf2_ros._receive.arrival_waitable cimport (
    MAX_SOURCES,
    ArrivalCounts,
    ArrivalWaitable,
    arrivals_count,
    arrivals_took,
)
from tf2_ros._receive.journal cimport Journal, KeptMessage, journal_clear, journal_keep, kept_data
from tf2_ros._receive.rcl cimport (
    RCL_RET_OK,
    RCL_RET_SUBSCRIPTION_TAKE_FAILED,
    RCL_RET_TIMEOUT,
    RMW_GID_STORAGE_SIZE,
    c_bool,
    message_free,
    message_init,
    rcl_clock_get_now,
    rcl_clock_t,
    rcl_context_is_valid,
    rcl_context_t,
    rcl_event_t,
    rcl_guard_condition_t,
    rcl_is_enabled_ros_time_override,
    rcl_last_error,
    rcl_ret_t,
    rcl_serialized_message_t,
    rcl_subscription_t,
    rcl_take_serialized_message,
    rcl_wait,
    rcl_wait_set_add_event,
    rcl_wait_set_add_guard_condition,
    rcl_wait_set_add_subscription,
    rcl_wait_set_clear,
    rcl_wait_set_fini,
    rcl_wait_set_init,
    rcl_wait_set_t,
    rcutils_get_default_allocator,
    rcutils_reset_error,
    rmw_message_info_t,
)
from tf2_ros._receive.recording cimport Recording, Records, records_add, records_add_malformed
from tf2_ros._receive.type_watch cimport (
    TypeWatch,
    type_watch_begin,
    type_watch_goes_on,
    type_watch_is_unchanged,
    type_watch_permits,
)

import traceback
import weakref

from tf2_py._internal import log

cdef enum:
    MAX_IN_A_ROW = 100          # messages of one source, before the other source and the guard are served
    KEEP_BYTES = 1 << 20        # bytes of memory that are kept from one message to the next, at most

# How long rcl_wait sleeps at most. A signal ends a context without waking it; and with events in the wait set
# each message costs more, so these are waited for only once in this time.
cdef int64_t WAKE_CHECK_NS = 1000000000


cdef struct Source:
    size_t number               # under which its messages are counted
    const rcl_subscription_t* subscription
    const rcl_event_t* event    # may happen to it; or NULL
    bint happened
    bint is_static


cdef enum Outcome:
    OUTCOME_WOKEN               # the guard was triggered, an event happened, a watched type changed
    OUTCOME_ENDED               # the context has ended
    OUTCOME_FAILED              # rcl has the reason


cdef bint _insert_some(Engine engine, Batch* batch) noexcept nogil:
    return engine.insert_some(batch)


# Without the GIL references cannot be counted: the loop has the address of the engine alone.
ctypedef bint (*InsertSome)(void* engine, Batch* batch) noexcept nogil
cdef InsertSome insert_some = <InsertSome>_insert_some


cdef class Receiver:
    """
    Takes messages from subscriptions into a buffer.

    :param buffer: a BufferCore. It is not kept alive, because its waiters may lead to the node: a thread in
        :meth:`run` would keep both for ever. Only one that cannot be referenced weakly is kept.
    :param str authority: of the transforms.
    :param arrivals: counts the messages.
    :param hand_over: called with a list of callables that run user code: what a message completed. Where it
        returns true, the message is counted with these, and not in ``arrivals``.
    :param recording: notes who sent each transform and when; or None.
    """

    cdef void* _engine          # NULL once it was destroyed; guarded by _engine_lock
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
    cdef list _watched          # types; keeps those of _watch
    cdef TypeWatch _watch
    cdef rcl_clock_t* _clock    # of the buffer, or NULL
    cdef Journal _journal       # guarded by _engine_lock
    cdef Recording _recording   # keeps _records
    cdef Records* _records      # NULL: nothing is noted
    cdef rmw_message_info_t _information    # about the message, where something is noted

    def __cinit__(self, Engine buffer not None, str authority not None, ArrivalWaitable arrivals not None,
                  hand_over, Recording recording=None):
        cdef Py_ssize_t size
        if lock_init(&self._engine_lock) != 0:
            raise MemoryError
        fork_watch(&self._forked, &self._engine_lock, FORK_OUTER)
        if not message_init(&self._message):
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
        self._recording = recording
        self._records = NULL if recording is None else &recording._records

    def __dealloc__(self):
        fork_forget(&self._forked)
        journal_clear(&self._journal)
        batch_free(&self._batch)
        message_free(&self._message)
        lock_free(&self._engine_lock)

    def _forget(self, _):
        with nogil:
            lock_write(&self._engine_lock)
        self._engine = NULL
        unlock_write(&self._engine_lock)

    def watch(self, types):
        """
        Let :meth:`run` return before it takes another message, once an attribute of one of these changed.

        :param types: at most two. For attributes of objects there is :meth:`decide_again`.
        """
        self._watched = list(types)
        type_watch_begin(&self._watch, self._watched)

    def decide_again(self):
        """Let :meth:`run` return before it takes another message; the caller triggers the guard condition."""
        flag_set(&self._watch.changed, True)

    def fills(self, Engine buffer not None):
        """Whether the transforms go into this buffer."""
        return self._engine == <void*>buffer

    def reinsert_recent(self, int64_t until_ns):
        """
        Insert again what arrived since the clock last moved forward, except stamps after ``until_ns``.

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
        Take messages until the guard condition is triggered, an event happens or the context ends.

        :param context: address of the ``rcl_context_t``.
        :param guard: address of an ``rcl_guard_condition_t`` that nothing else waits for.
        :param clock: address of the ``rcl_clock_t`` of the buffer, or 0.
        :param sources: at most two tuples: the number under which its messages are counted, address of an
            ``rcl_subscription_t``, address of an ``rcl_event_t`` or 0, the topic's name, whether its
            transforms are static.
        :return: which events have happened, by their addresses; None if the context has ended. An empty list
            where something has changed that :meth:`watch` is about.
        :raises RuntimeError: rcl failed; the text says how.

        The structs at these addresses must exist until it returns. An event is reported within a second.
        """
        cdef Outcome outcome
        cdef size_t i
        if len(sources) > MAX_SOURCES:
            raise ValueError(f"{len(sources)} sources, at most {MAX_SOURCES} are possible")
        self._context = <rcl_context_t*><uintptr_t>context
        self._guard = <const rcl_guard_condition_t*><uintptr_t>guard
        self._clock = <rcl_clock_t*><uintptr_t>clock
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
            raise RuntimeError(rcl_last_error())
        if outcome == OUTCOME_ENDED:
            return None
        return [<uintptr_t>self._sources[i].event for i in range(self._count) if self._sources[i].happened]

    cdef Outcome _serve(self) noexcept nogil:
        cdef Outcome outcome = OUTCOME_FAILED
        memset(&self._set, 0, sizeof(self._set))
        if rcl_wait_set_init(&self._set, self._count, 1, 0, 0, 0, self._count, self._context,
                             rcutils_get_default_allocator()) == RCL_RET_OK:
            outcome = self._loop()
            if rcl_wait_set_fini(&self._set) != RCL_RET_OK:
                rcutils_reset_error()
        if outcome == OUTCOME_FAILED and not rcl_context_is_valid(self._context):
            rcutils_reset_error()
            return OUTCOME_ENDED
        return outcome

    cdef Outcome _loop(self) noexcept nogil:
        cdef rcl_ret_t result
        cdef size_t i
        cdef int64_t now_ns = monotonic_ns()
        cdef int64_t wake_check_ns = 0
        if not self._watch.has_versions:
            # What was found holds for what is there now; for what comes later, it is found again.
            for i in range(self._count):
                if self._drain(i, now_ns) != RCL_RET_OK:
                    return OUTCOME_FAILED
            type_watch_goes_on(&self._watch)
        while rcl_context_is_valid(self._context):
            result = self._arm(now_ns >= wake_check_ns)
            if now_ns >= wake_check_ns:
                wake_check_ns = now_ns + WAKE_CHECK_NS
            if result == RCL_RET_OK:
                result = rcl_wait(&self._set, WAKE_CHECK_NS)
            now_ns = monotonic_ns()
            if result == RCL_RET_TIMEOUT:
                continue
            if result != RCL_RET_OK:
                return OUTCOME_FAILED
            for i in range(self._count):
                if self._set.subscriptions[i] != NULL and self._drain(i, now_ns) != RCL_RET_OK:
                    return OUTCOME_FAILED
            if not type_watch_is_unchanged(&self._watch):
                return OUTCOME_WOKEN
            if self._set.guard_conditions[0] != NULL or self._events_happened():
                return OUTCOME_WOKEN
        return OUTCOME_ENDED

    cdef bint _events_happened(self) noexcept nogil:
        cdef bint any_happened = False
        cdef size_t i, j
        for i in range(self._count):
            for j in range(self._count):
                if self._set.events[j] != NULL and self._set.events[j] == self._sources[i].event:
                    self._sources[i].happened = any_happened = True
        return any_happened

    cdef rcl_ret_t _arm(self, bint with_events) noexcept nogil:
        # Waiting removes what is not ready, so the set is filled anew each time.
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

    cdef rcl_ret_t _drain(self, size_t index, int64_t now_ns) noexcept nogil:
        cdef rcl_ret_t result = RCL_RET_OK
        cdef int _
        self._batch.is_static = self._sources[index].is_static
        for _ in range(MAX_IN_A_ROW):
            if not type_watch_permits(&self._watch):
                break
            result = rcl_take_serialized_message(
                self._sources[index].subscription,
                &self._message,
                NULL if self._records == NULL else &self._information,
                NULL,
            )
            if result != RCL_RET_OK:
                break
            type_watch_goes_on(&self._watch)
            arrivals_took(self._counts, self._sources[index].number, now_ns)
            self._take_message(index)
            if self._message.buffer_capacity > KEEP_BYTES:
                self._release_memory()
        return RCL_RET_OK if result == RCL_RET_SUBSCRIPTION_TAKE_FAILED else result

    cdef void _take_message(self, size_t index) noexcept nogil:
        cdef bint needs_report = False
        cdef bint handed_over = False
        cdef bint more = False
        lock_write(&self._engine_lock)
        if self._engine != NULL:
            batch_begin(&self._batch)
            more = batch_read_cdr(&self._batch, self._message.buffer, self._message.buffer_length)
            needs_report = not more
            if more:
                self._keep_for_jump()
            if self._records != NULL:
                self._record(more)
        while more and self._engine != NULL:
            more = insert_some(self._engine, &self._batch)
            needs_report = self._batch.needs_report
            # A fork, or the end of the buffer, waits for one slice only.
            unlock_write(&self._engine_lock)
            lock_write(&self._engine_lock)
        unlock_write(&self._engine_lock)
        if needs_report:
            handed_over = self._report(index)
        if not handed_over:
            arrivals_count(self._counts, self._sources[index].number)

    cdef void _record(self, bint readable) noexcept nogil:
        cdef int64_t received_ns = self._information.received_timestamp
        if not readable:
            records_add_malformed(self._records)
            return
        if not self._simulated_now(&received_ns) and received_ns <= 0:
            received_ns = system_ns()
        records_add(
            self._records, &self._batch, received_ns,
            self._information.publisher_gid.data, RMW_GID_STORAGE_SIZE,
        )

    cdef bint _simulated_now(self, int64_t* now_ns) noexcept nogil:
        # Whether the buffer's time is simulated; it is set only then.
        cdef c_bool simulated = False
        if self._clock == NULL:
            return False
        if rcl_is_enabled_ros_time_override(self._clock, &simulated) != RCL_RET_OK or not simulated:
            return False
        return rcl_clock_get_now(self._clock, now_ns) == RCL_RET_OK

    cdef void _keep_for_jump(self) noexcept nogil:
        # Where time is simulated, a message of a restarted recording may arrive before the jump of the clock.
        cdef int64_t now_ns
        if not self._batch.is_static and self._simulated_now(&now_ns):
            journal_keep(&self._journal, now_ns, self._message.buffer, self._message.buffer_length)

    cdef void _release_memory(self) noexcept nogil:
        batch_free(&self._batch)
        message_free(&self._message)
        message_init(&self._message)

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
            # Usually for lack of memory; the next message may succeed.
            log.receiving_failed(engine._throttle, traceback.format_exc())
        return bool(later) and self._hand_over(later)


cdef void _keep_until(Batch* batch, int64_t until_ns) noexcept nogil:
    cdef size_t i
    cdef size_t count = 0
    for i in range(batch.count):
        if batch.entries[i].incoming.stamp_ns <= until_ns:
            batch.entries[count] = batch.entries[i]
            count += 1
    batch.count = count
