# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Take, parse and insert what has arrived for a buffer, in readers and in threads."""

from libc.stddef cimport size_t
from libc.stdint cimport int64_t, uint32_t

from tf2_py._internal cimport Batch, Engine, Event, Lock, ReadHook
from tf2_ros.records cimport Recording, Records

cdef enum:
    ROUND_NS = 100000000        # how long a message waits if nothing asks for it
    SHORT_ROUND_NS = 10000000   # the same while a program's own loop calls an executor
    SHORT_ROUNDS = 10           # so many of these follow each such call
    # Work is counted in messages of up to WORK_BYTES; a longer one counts as several.
    DRAIN_SLICE = 16            # work until other threads may drain
    READ_SLICE = 64             # work of a read until it releases the GIL
    WORK_BYTES = 2048
    LARGE_BYTES = READ_SLICE * WORK_BYTES   # memory for a longer message is given back


cdef enum:
    SENDER_BYTES = 16


cdef struct ReceivedMessage:
    # One message. It does not move: waiters refer to its batch.
    # What a source fills in; everything is reset before, except for memory and sender.
    unsigned char* data         # a serialized TFMessage, of malloc
    size_t size                 # bytes of it
    size_t capacity             # bytes allocated
    size_t topic                # index of its name in `names` of the InboxSource
    bint is_static
    # If messages are recorded: the publisher, and the time of reception.
    unsigned char[SENDER_BYTES] sender
    int64_t received_ns
    # What the inbox needs.
    Batch batch
    bint is_begun               # `batch` was parsed, and not all of it is inserted
    ReceivedMessage* next


cdef struct ReceivedMessages:
    ReceivedMessage* first
    ReceivedMessage* last
    size_t count


cdef struct ObserverLink:
    void* observer              # an Observer
    ObserverLink* next


cdef struct SharedByInboxes:
    # What the inboxes of a process have in common: the receiver thread and the background thread.
    Lock lock                   # guards the two lists, and what the InboxState of each inbox says
    InboxState* first           # of those that the receiver thread serves
    InboxState* first_to_report  # of those that have something to report
    Event work                  # for the receiver thread
    Event reporting             # for the background thread
    uint32_t is_idle            # atomic: the receiver thread must be woken by the next message
    uint32_t short_rounds       # atomic: so many rounds are still short
    uint32_t is_stopping        # atomic


cdef struct InboxState:
    # What is used without the GIL.
    uint32_t unread             # atomic; 0: no message waits; BEING_INSERTED: none but those being taken
    uint32_t is_full            # atomic: so many messages wait that they must be taken
    uint32_t has_waiters        # atomic: the engine has some, and wants each message at once
    uint32_t read               # atomic: rounds for which it wants them because of the last read
    uint32_t wants_each         # atomic: each message must be taken when it arrives
    ObserverLink* observers     # they hear of each insert; grows at the front
    # Set once.
    SharedByInboxes* shared
    void* inbox                 # the Inbox
    void* source                # the InboxSource
    Records* records            # NULL: nothing is recorded
    const char* prefix          # of all names; NULL: they stay as they are
    size_t prefix_size
    # Guarded by the lock of all inboxes.
    void* engine                # NULL: there is none, and nothing is taken
    ReceivedMessage* received   # for the next message; NULL: not allocated yet
    ReceivedMessages reports    # messages with something to report
    InboxState* next            # in the list of those that the receiver thread serves
    InboxState* next_to_report  # in that of those whose `reports` are not empty


# A message waits. `is_full`: so many wait that they must be taken. From any thread, with or without the GIL.
cdef void inbox_arrived(InboxState* inbox, bint is_full) noexcept nogil
# Makes room for the bytes of a message; NULL: no memory.
cdef unsigned char* received_reserve(ReceivedMessage* received, size_t size) noexcept nogil


cdef class Inboxes:
    # A thread that holds the lock of all inboxes takes at most one of an engine, of records, or of the
    # middleware.
    cdef SharedByInboxes shared


cdef class Observer:
    # All that this package knows of an executor.
    cdef object inboxes         # LiveObjects: those that it observes
    cdef readonly object receivers  # LiveObjects: those that leave their messages to an EventsExecutor
    # Something was inserted. Called without the GIL, in any thread, as the next one.
    cdef void inserted(self) noexcept nogil
    # It may wake for what was inserted. Called in each round of the receiver thread, so not for each message.
    cdef void wake_if_due(self) noexcept nogil


cdef class InboxSource:
    # Where the messages of one inbox come from. A subclass has three duties:
    # 1. `next` fills in the next message; False: there is none, or no memory for it. If others may
    #    wait in the latter case, it sets `unread` of the inbox. It calls nothing of the inbox but
    #    `received_reserve`. It runs under the lock of all inboxes, in any thread that drains or reads the
    #    buffer. Some of these hold the GIL and others do not: so it uses no Python object, and reads no file
    #    that may be slow. What was filled before has been inserted when it is called again.
    # 2. It makes known that a message waits: by `inbox_arrived(self.inbox, ...)`, after the message is there.
    # 3. `detach` ends that: from its return on, nothing may call `inbox_arrived`, because the inbox may be
    #    freed. It is called once, with the GIL and without a lock, in any thread, perhaps by a finalizer. So
    #    it must not wait for a thread that needs the GIL.
    # In a forked child, none of them is called any more.
    cdef InboxState* inbox      # that inbox, which sets this
    cdef list names             # of the topics, for errors
    cdef bint next(self, ReceivedMessage* received) noexcept nogil
    cdef void detach(self) noexcept


cdef class Inbox(ReadHook):
    cdef InboxState state
    cdef InboxSource _source
    cdef Inboxes _inboxes           # keeps what they share
    cdef bint _is_closed            # in a forked child, one that was closed before must not take the lock
    cdef object _hand_over
    cdef Recording _recording       # keeps the records
    cdef bytes _prefix
    cdef object _reference          # called, gives the engine or None
    cdef set _observers             # keeps what `observers` of the state refers to
    cdef object __weakref__

    # Without the GIL and the lock: one step of inserting what has arrived. Returns whether more may be left.
    cdef bint step(self) noexcept nogil

    cdef void _discharge(self) noexcept
    cdef object _engine(self)
    cdef int _report(self, Engine engine, ReceivedMessages* messages) except -1
    cdef object _unlogged(self, Engine engine, object raised)
