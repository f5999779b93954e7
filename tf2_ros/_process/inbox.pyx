# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Keep what has arrived for a buffer until somebody reads it.

An inbox takes messages from its `InboxSource`, such as the subscriptions of a listener (`subscriptions`); the
declaration of `InboxSource` says what a source has to do. Its owner decides when it begins and ends.
Everything goes one way: the source fills a `ReceivedMessage`, and the inbox parses, prefixes, records and
inserts it. Every read of the buffer takes the messages (`drain`). So does one thread of the process: as soon
as many messages wait, at most ROUND_NS after the first one, and at once while something waits for a
transform, or while the buffer is read more often than the thread has rounds, so that such a reader finds
everything inserted. Its rounds also wake executors; while one of these is called by a program's own loop,
they take SHORT_ROUND_NS. Log lines, the completion of waits and everything else that follows from an insert
and needs the GIL are left to the background thread (`report_next`). So nothing here runs user code, and the
first thread never waits for the GIL.
"""

cimport cython
from libc.stddef cimport size_t
from libc.stdint cimport INT64_MAX, SIZE_MAX, int64_t, uint32_t
from libc.stdlib cimport calloc, free, malloc, realloc
from libc.string cimport memset, strlen

from tf2_py._internal cimport (
    Batch,
    Engine,
    Event,
    Link,
    Lock,
    ReadHook,
    batch_begin,
    batch_free,
    batch_prefix,
    batch_read_cdr,
    event_clear,
    event_init,
    event_set,
    event_wait,
    exchange_seq_cst,
    links_empty,
    load_seq_cst,
    lock_acquire,
    lock_ask,
    lock_await,
    lock_free,
    lock_init,
    lock_release,
    monotonic_ns,
    replace_seq_cst,
    store_seq_cst,
)
from tf2_ros.records cimport Recording, records_add, records_add_malformed

import traceback
import weakref
from threading import get_ident, main_thread

from tf2_py._internal import keep_for_ever, log
from tf2_ros._live_objects import LiveObjects

AUTHORITY = "default_authority"     # of what is received: messages do not name their publisher
cdef const char* DEFAULT_AUTHORITY = "default_authority"

cdef enum:
    MAX_REPORTS = 64            # messages that are kept for the log, which says what is wrong with them
    SLICE_WORK = 4              # of one `insert_some`, up to 64 transforms
    BEING_INSERTED = 2          # of InboxState.unread: nothing has arrived since a thread began to insert

# How long a read waits for the lock with the GIL, which it may not get back for 5 ms. Only a thread that
# takes a long message from the middleware has the lock for longer: 17 MB take 20 ms.
cdef int64_t PATIENCE_NS = 2000000
# How long the receiver thread sleeps while nothing arrives, at most.
cdef int64_t IDLE_NS = 1500000000
# After this, a read returns even if messages arrive faster than it can insert them.
cdef int64_t READ_NS = 5000000000


cdef void _sleep(Event* event, int64_t ns) noexcept nogil:
    # Until the event is set, which this undoes, or until so many nanoseconds have passed.
    event_wait(event, max(ns, 0))
    event_clear(event)


cdef bint _wants_each(InboxState* inbox) noexcept nogil:
    return load_seq_cst(&inbox.read) or load_seq_cst(&inbox.has_waiters) or load_seq_cst(&inbox.wants_each)


cdef void _tell_observers(InboxState* inbox) noexcept nogil:
    cdef ObserverLink* link = inbox.observers
    while link != NULL:
        (<Observer>link.observer).inserted()
        link = link.next


cdef void inbox_arrived(InboxState* inbox, bint is_full) noexcept nogil:
    store_seq_cst(&inbox.unread, 1)
    if is_full:
        store_seq_cst(&inbox.is_full, 1)
    if is_full or _wants_each(inbox) or load_seq_cst(&inbox.shared.is_idle):
        event_set(&inbox.shared.work)


# ReceivedMessages.

cdef void _shrink_received(ReceivedMessage* received) noexcept nogil:
    batch_free(&received.batch)
    free(received.data)
    received.data, received.capacity = NULL, 0


cdef void _free_received(ReceivedMessage* received) noexcept nogil:
    if received != NULL:
        _shrink_received(received)
        free(received)


cdef unsigned char* received_reserve(ReceivedMessage* received, size_t size) noexcept nogil:
    cdef void* memory
    if size > received.capacity or received.data == NULL:
        memory = realloc(received.data, size + 1)
        if memory == NULL:
            return NULL
        received.data = <unsigned char*>memory
        received.capacity = size + 1
    received.size = size
    return received.data


cdef void _free_all_received(ReceivedMessages* messages) noexcept:
    cdef ReceivedMessage* received = messages.first
    cdef ReceivedMessage* next_received
    cdef Link* link
    while received != NULL:
        next_received = received.next
        # Waiters that are ready were not reported, so all of this is garbage, and the collector frees waiters
        # and inbox in any order. The GIL is held, as by everything that removes such a waiter.
        link = received.batch.ready.next
        while link != NULL and link.waiter != NULL:
            link.waiter.is_listed = False
            link = link.next
        _free_received(received)
        received = next_received


cdef bint _begin_received(InboxState* inbox) noexcept nogil:
    # Prepares an empty struct for the next message; False: there is no memory.
    cdef ReceivedMessage* received = inbox.received
    if received == NULL:
        received = inbox.received = <ReceivedMessage*>calloc(1, sizeof(ReceivedMessage))
        if received == NULL:
            return False
    received.size = received.topic = 0
    received.is_static = received.is_begun = False
    received.received_ns = 0
    batch_begin(&received.batch)
    return True


# What is to be reported; with the lock held.

cdef void _begin_to_report(InboxState* inbox) noexcept nogil:
    cdef InboxState** link = &inbox.shared.first_to_report
    while link[0] != NULL:
        link = &link[0].next_to_report
    link[0], inbox.next_to_report = inbox, NULL
    event_set(&inbox.shared.reporting)


cdef void _end_to_report(InboxState* inbox) noexcept nogil:
    cdef InboxState** link = &inbox.shared.first_to_report
    while link[0] != NULL and link[0] != inbox:
        link = &link[0].next_to_report
    if link[0] != NULL:
        link[0] = inbox.next_to_report


cdef void _take_reports(InboxState* inbox, ReceivedMessages* reports) noexcept nogil:
    _end_to_report(inbox)
    reports[0] = inbox.reports
    memset(&inbox.reports, 0, sizeof(ReceivedMessages))


# Draining; with the lock held. The state has only the address of the engine: without the GIL, references
# cannot be counted. Who calls what:
#   a read of the buffer      catch_up ─► drain ─► _take, then `step` until nothing is left
#   the receiver thread       drain_when_due ─► _serve_all ─► _serve ─► _take
#   all of them               _take ─► _begin_message ─► `next` of the source; _go_on; _report_later
# A long message is inserted in slices, and between takes the lock is released: whoever takes next goes on.

cdef void _report_later(InboxState* inbox) noexcept nogil:
    # A flood of faults must not fill the memory: they are counted, not logged. Answers are never lost.
    cdef ReceivedMessages* reports = &inbox.reports
    if reports.count >= MAX_REPORTS and links_empty(&inbox.received.batch.ready):
        return
    if reports.last != NULL:
        reports.last.next = inbox.received
    else:
        reports.first = inbox.received
    reports.last = inbox.received
    reports.count += 1
    inbox.received = NULL
    if reports.count == 1:
        _begin_to_report(inbox)


cdef bint _parse(InboxState* inbox) noexcept nogil:
    # Reads the message that was taken; False: it is malformed.
    cdef ReceivedMessage* received = inbox.received
    cdef Batch* batch = &received.batch
    cdef bint is_readable
    batch.is_static = received.is_static
    batch.authority, batch.authority_size = DEFAULT_AUTHORITY, strlen(DEFAULT_AUTHORITY)
    is_readable = batch_read_cdr(batch, received.data, received.size)
    if is_readable and inbox.prefix != NULL:
        batch_prefix(batch, inbox.prefix, inbox.prefix_size)
    if inbox.records != NULL:
        if is_readable:
            records_add(inbox.records, batch, received.received_ns, received.sender, SENDER_BYTES)
        else:
            records_add_malformed(inbox.records)
    return is_readable


cdef size_t _begin_message(InboxState* inbox) noexcept nogil:
    # Takes the next message. Returns how much work that was; 0: there is none, or no memory for it.
    cdef size_t work
    if not _begin_received(inbox) or not (<InboxSource>inbox.source).next(inbox.received):
        return 0
    work = 1 + inbox.received.size // WORK_BYTES
    inbox.received.is_begun = _parse(inbox)
    if not inbox.received.is_begun:
        (<Engine>inbox.engine).count_malformed()
        _report_later(inbox)
    return work


cdef size_t _go_on(InboxState* inbox, size_t most) noexcept nogil:
    # Inserts the message that is begun, or about as much of it. Returns how much work that was.
    cdef ReceivedMessage* received = inbox.received
    cdef size_t work = 0
    while (<Engine>inbox.engine).insert_some(&received.batch):
        work += SLICE_WORK
        if work >= most:
            return work
    received.is_begun = False
    if received.batch.needs_report:
        _report_later(inbox)
    elif received.size > LARGE_BYTES:
        _shrink_received(received)
    return work


cdef inline bint _is_begun(const InboxState* inbox) noexcept nogil:
    return inbox.received != NULL and inbox.received.is_begun


cdef void _finish_message(InboxState* inbox) noexcept nogil:
    # Before the engine changes: all of a message goes into one buffer.
    if _is_begun(inbox):
        _go_on(inbox, SIZE_MAX)
        _tell_observers(inbox)


cdef void _forget_message(InboxState* inbox) noexcept nogil:
    # The rest of it has no buffer any more; or a thread of the parent was inserting it.
    if inbox.received != NULL:
        inbox.received.is_begun = False


cdef bint _take(InboxState* inbox, size_t most) noexcept nogil:
    # Does this much work, or a little more; returns whether more may be left.
    cdef size_t work = 0
    cdef size_t begun
    cdef bint more
    # First this, then the messages: `inbox_arrived` is called after its message has arrived. Until they are
    # inserted, readers must find something unread, and wait here.
    store_seq_cst(&inbox.unread, BEING_INSERTED)
    store_seq_cst(&inbox.is_full, 0)
    while inbox.engine != NULL and work < most:
        if not _is_begun(inbox):
            begun = _begin_message(inbox)
            if begun == 0:
                break
            work += begun
        if _is_begun(inbox):
            work += _go_on(inbox, most)
    # Before `unread` is cleared: executors have then heard of all that a reader sees.
    if work:
        _tell_observers(inbox)
    more = inbox.engine != NULL and work >= most
    if more or (inbox.engine != NULL and inbox.received == NULL):
        store_seq_cst(&inbox.unread, 1)   # without memory, the next round tries again
    else:
        replace_seq_cst(&inbox.unread, BEING_INSERTED, 0)
    return more


cdef void _clear_has_waiters(InboxState* inbox) noexcept nogil:
    # All that has arrived is inserted.
    if load_seq_cst(&inbox.has_waiters) and inbox.engine != NULL:
        (<Engine>inbox.engine).clear_has_waiters(&inbox.has_waiters)


# The receiver thread.

cdef bint _serve(InboxState* inbox) noexcept nogil:
    # A reader may have taken the rest since the last slice.
    if load_seq_cst(&inbox.unread) and _take(inbox, DRAIN_SLICE):
        return True
    _clear_has_waiters(inbox)
    return False


cdef bint _serve_all(SharedByInboxes* shared, bint is_round) noexcept nogil:
    # In a round all inboxes, otherwise those whose messages must not wait. Returns whether messages waited.
    cdef InboxState* inbox
    cdef bint found = False
    cdef uint32_t read
    cdef bint is_behind = True
    cdef bint is_rest = False       # of a slice: it is due
    while is_behind:
        # Between two slices other threads may read, and change the list.
        is_behind = False
        lock_acquire(&shared.lock)
        inbox = shared.first
        while inbox != NULL:
            found = found or load_seq_cst(&inbox.unread)
            read = load_seq_cst(&inbox.read)
            if is_round and read > 0 and not is_rest:
                store_seq_cst(&inbox.read, read - 1)   # this may undo a read of just now: the next one counts
            if is_round or is_rest or _wants_each(inbox) or load_seq_cst(&inbox.is_full):
                is_behind = _serve(inbox) or is_behind
            inbox = inbox.next
        lock_release(&shared.lock)
        is_rest = True
    return found


cdef void _wake_executors(SharedByInboxes* shared) noexcept nogil:
    cdef InboxState* inbox
    cdef ObserverLink* link
    lock_acquire(&shared.lock)
    inbox = shared.first
    while inbox != NULL:
        link = inbox.observers
        while link != NULL:
            (<Observer>link.observer).wake_if_due()
            link = link.next
        inbox = inbox.next
    lock_release(&shared.lock)


@cython.final
cdef class Inboxes:
    """Inboxes, and what two threads do for them; those of a process are `INBOXES`."""

    def __cinit__(self):
        self.reset()

    def reset(self):
        """Have no inboxes; in a forked child, also forget what threads of the parent held."""
        memset(&self.shared, 0, sizeof(SharedByInboxes))
        if event_init(&self.shared.work) != 0 or event_init(&self.shared.reporting) != 0:
            raise MemoryError
        if lock_init(&self.shared.lock) != 0:
            raise MemoryError

    def __dealloc__(self):
        lock_free(&self.shared.lock)

    def drain_when_due(self):
        """Drain the inboxes whenever they are due, without the GIL, until :meth:`stop`; for one thread."""
        cdef SharedByInboxes* shared = &self.shared
        cdef int64_t now_ns
        cdef int64_t round_ns = 0           # when the next round is due
        cdef bint is_round
        cdef uint32_t short_rounds
        with nogil:
            while not load_seq_cst(&shared.is_stopping):
                now_ns = monotonic_ns()
                is_round = now_ns >= round_ns
                if is_round:
                    round_ns = now_ns + ROUND_NS
                short_rounds = load_seq_cst(&shared.short_rounds)
                if short_rounds:
                    round_ns = min(round_ns, now_ns + SHORT_ROUND_NS)
                    if is_round:
                        replace_seq_cst(&shared.short_rounds, short_rounds, short_rounds - 1)
                # First idle, then a look at what waits; an arrival does this in the opposite order.
                store_seq_cst(&shared.is_idle, is_round)
                if _serve_all(shared, is_round):
                    store_seq_cst(&shared.is_idle, 0)
                if is_round:
                    _wake_executors(shared)
                _sleep(&shared.work, IDLE_NS if load_seq_cst(&shared.is_idle) else round_ns - monotonic_ns())

    def await_report(self, int64_t until_ns):
        """
        Wait until there is something to report, or until this steady time. Return False after :meth:`stop`.
        """
        with nogil:
            if not load_seq_cst(&self.shared.is_stopping):
                _sleep(&self.shared.reporting, until_ns - monotonic_ns())
        return not load_seq_cst(&self.shared.is_stopping)

    def wake_reporting(self):
        """End the wait for something to report."""
        event_set(&self.shared.reporting)

    def report_next(self):
        """Do what follows from what one of them has inserted: complete waits, and log what was refused."""
        cdef ReceivedMessages messages
        cdef Inbox inbox = None
        cdef InboxState* first
        lock_acquire(&self.shared.lock)
        first = self.shared.first_to_report
        if first != NULL:
            # It exists: it leaves the list, with the GIL, before it is destroyed.
            inbox = <Inbox>first.inbox
            _take_reports(first, &messages)
            if self.shared.first_to_report != NULL:
                event_set(&self.shared.reporting)
        lock_release(&self.shared.lock)
        if inbox is not None:
            # No code in Python has run since, so the engine is that of the reports.
            inbox._report(inbox._engine(), &messages)

    def stop(self):
        """End the threads."""
        store_seq_cst(&self.shared.is_stopping, 1)
        event_set(&self.shared.work)
        event_set(&self.shared.reporting)


INBOXES = Inboxes()


cdef class Observer:
    """Is notified after each insert."""

    def __cinit__(self, *_, **__):
        self.inboxes, self.receivers = LiveObjects(), LiveObjects()

    cdef void inserted(self) noexcept nogil:
        pass

    cdef void wake_if_due(self) noexcept nogil:
        pass


cdef class InboxSource:
    """Where the messages of one inbox come from. An inbox keeps it, and ends before it does."""

    cdef bint next(self, ReceivedMessage* received) noexcept nogil:
        return False

    cdef void detach(self) noexcept:
        pass


@cython.final
@cython.no_gc_clear     # `__dealloc__` needs the source
cdef class Inbox(ReadHook):
    """
    Keeps what has arrived for a buffer until the buffer is read, or the receiver thread takes it.

    It ends with :meth:`close`, or its last reference. In garbage, its finalizer runs before the collector
    clears anything that threads without the GIL use: engine, clock, or executors.

    :param source: of its messages; for no other inbox.
    :param hand_over: called with each callable that runs user code, to have it called.
    :param recording: notes the sender and time of each transform; or None.
    :param prefix: put before all names.
    :param inboxes: to which it belongs.
    """

    def __cinit__(self, InboxSource source not None, hand_over, Recording recording=None, str prefix="",
                  Inboxes inboxes not None=INBOXES):
        cdef SharedByInboxes* shared = &inboxes.shared
        self._source, self._hand_over, self._observers, self._inboxes = source, hand_over, set(), inboxes
        self._recording, self._prefix = recording, prefix.encode()
        self.state.inbox, self.state.source, self.state.shared = <void*>self, <void*>source, shared
        self.unread, self.read = &self.state.unread, &self.state.read
        self.has_waiters = &self.state.has_waiters
        if recording is not None:
            self.state.records = &recording._records
            # A simulated clock must be read when a message arrives, and some middlewares read a clock only
            # when a message is taken.
            self.state.wants_each = True
        if prefix:
            self.state.prefix, self.state.prefix_size = self._prefix, len(self._prefix)
        source.inbox = &self.state
        lock_acquire(&shared.lock)
        self.state.next = shared.first
        shared.first = &self.state
        lock_release(&shared.lock)

    def __del__(self):
        if self._source is not None and not self._is_closed:
            self.close()

    def __dealloc__(self):
        cdef ObserverLink* link
        self._discharge()
        while self.state.observers != NULL:
            link = self.state.observers
            self.state.observers = link.next
            free(link)
        _free_received(self.state.received)
        _free_all_received(&self.state.reports)

    cdef void _discharge(self) noexcept:
        # No thread uses it from here on.
        cdef InboxState** link
        if self._source is None or self._is_closed:
            return
        self._is_closed = True
        lock_acquire(&self.state.shared.lock)
        _finish_message(&self.state)
        link = &self.state.shared.first
        while link[0] != NULL and link[0] != &self.state:
            link = &link[0].next
        if link[0] != NULL:
            link[0] = self.state.next
        _end_to_report(&self.state)
        lock_release(&self.state.shared.lock)
        # Only now: it may run code in Python, and meanwhile another thread may report.
        self._source.detach()

    cdef void engine_ended(self) noexcept:
        lock_acquire(&self.state.shared.lock)
        _forget_message(&self.state)
        self.state.engine = NULL
        lock_release(&self.state.shared.lock)

    def close(self):
        """Receive nothing more. What has arrived is dropped; what was inserted is reported."""
        self._discharge()
        self.fill(None)

    def add_observer(self, Observer observer not None):
        """Inform this, too, of what is inserted from now on."""
        cdef ObserverLink* link
        observer.inboxes.add(self)
        if observer in self._observers:
            return
        self._observers.add(observer)    # from here on, no code in Python runs
        link = <ObserverLink*>malloc(sizeof(ObserverLink))
        if link == NULL:
            self._observers.discard(observer)
            raise MemoryError
        link.observer, link.next = <void*>observer, self.state.observers
        lock_acquire(&self.state.shared.lock)
        self.state.observers = link
        lock_release(&self.state.shared.lock)

    cdef object _engine(self):
        return None if self._reference is None else self._reference()

    def fill(self, Engine buffer):
        """Insert from now on into this buffer, which is not kept alive. None, or once closed: into none."""
        cdef ReceivedMessages messages
        if buffer is not None and self.state.engine == <void*>buffer:
            return
        reference = None if buffer is None else weakref.ref(buffer)
        # From here to the report no code in Python runs, and so no other thread that fills, closes or drains
        # (see `unread`: nothing makes a container).
        engine = self._engine()
        if self._is_closed:
            buffer = reference = None
        if engine is not None:
            (<Engine>engine).remove_inbox(self)
        self._reference = reference
        lock_acquire(&self.state.shared.lock)
        _finish_message(&self.state)
        _take_reports(&self.state, &messages)
        self.state.engine = <void*>buffer if buffer is not None else NULL
        lock_release(&self.state.shared.lock)
        if buffer is not None:
            buffer.add_inbox(self)
            inbox_arrived(&self.state, True)    # perhaps while there was no buffer
        self._report(engine, &messages)

    cdef bint step(self) noexcept nogil:
        cdef InboxState* state = &self.state
        cdef bint more
        lock_acquire(&state.shared.lock)
        more = _take(state, DRAIN_SLICE)
        if not more:
            _clear_has_waiters(state)
        lock_release(&state.shared.lock)
        return more

    cdef int drain(self) except -1:
        cdef Lock* lock = &self.state.shared.lock
        cdef uint32_t number = lock_ask(lock)
        cdef int64_t until_ns
        cdef bint more
        if lock_await(lock, number, PATIENCE_NS):
            more = _take(&self.state, READ_SLICE)
            lock_release(lock)
        else:
            with nogil:
                lock_await(lock, number, INT64_MAX)
                more = _take(&self.state, READ_SLICE)
                lock_release(lock)
        if more:
            until_ns = monotonic_ns() + READ_NS
            with nogil:
                while more and monotonic_ns() < until_ns:
                    more = self.step()
        return 0

    def catch_up(self):
        """Insert what has arrived, if anything has."""
        if load_seq_cst(self.unread):
            # For its own method, Cython 3.0 passes a pointer of the wrong type, which gcc 14 refuses.
            (<ReadHook>self).drain()

    def was_read(self):
        """Whether the buffer was read in the last rounds, or something waits for its transforms."""
        return load_seq_cst(self.read) != 0 or load_seq_cst(self.has_waiters) != 0

    def await_round(self, bint is_short, bint has_arrived):
        """Have a round after what has arrived and what arrives next: an executor sleeps until then."""
        cdef SharedByInboxes* shared = self.state.shared
        # Without this, the thread may sleep until the next message, or until the end of a long round.
        if (is_short and exchange_seq_cst(&shared.short_rounds, SHORT_ROUNDS) == 0) or has_arrived:
            event_set(&shared.work)

    def leave_to_parent(self):
        """
        In a forked child: receive nothing more, and never free anything. Return whether it received.

        A thread of the parent may have been changing it.
        """
        cdef bint has_received = self.state.engine != NULL
        keep_for_ever(self)
        self.state.engine = NULL
        _forget_message(&self.state)
        store_seq_cst(self.unread, 0)
        return has_received

    cdef int _report(self, Engine engine, ReceivedMessages* messages) except -1:
        # All are reported, even if a signal handler raises meanwhile in a thread of the program. `engine`:
        # that of these messages; without it nothing in them is ready, because what waits holds its engine.
        cdef ReceivedMessage* received = NULL if engine is None else messages.first
        error = None
        try:
            while received != NULL:
                try:
                    if received.batch.problem != NULL:
                        engine.malformed(&received.batch, received.size, self._source.names[received.topic])
                    else:
                        engine.report(&received.batch, self._hand_over)
                except BaseException as raised:
                    failure = self._unlogged(engine, raised)
                    error = failure if error is None else error
                received = received.next
        finally:
            _free_all_received(messages)
        if error is not None:
            raise error
        return 0

    cdef object _unlogged(self, Engine engine, object raised):
        # What has to be raised; None: it is logged. Nothing is raised here: messages are freed then, and what
        # waits would be left in their lists.
        try:
            # Usually for lack of memory; the next message may succeed. In the main thread, it may be that of
            # a signal handler.
            if not isinstance(raised, Exception) or get_ident() == main_thread().ident:
                return raised
            if engine._throttle.passes("receiver"):
                log.receiving_failed(traceback.format_exc())
        except BaseException as another:
            return another
        return None
