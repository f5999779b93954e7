# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
The subscriptions of a listener as the source of an inbox.

The middleware reports each arrival, which is only counted; messages are taken from a subscription when the
inbox is drained.
"""

cimport cython
from libc.stddef cimport size_t
from libc.stdint cimport int64_t, uint32_t, uint64_t, uintptr_t
from libc.string cimport memcpy

from tf2_py._internal cimport (
    add_seq_cst,
    exchange_seq_cst,
    lock_acquire,
    lock_release,
    monotonic_ns,
    store_seq_cst,
    system_ns,
)
from tf2_ros._rcl cimport (
    RCL_RET_OK,
    RCL_RET_SUBSCRIPTION_TAKE_FAILED,
    MessageInfo,
    c_bool,
    rcl_allocator_t,
    rcl_clock_get_now,
    rcl_clock_t,
    rcl_is_enabled_ros_time_override,
    rcl_ret_t,
    rcl_serialized_message_t,
    rcl_subscription_set_on_new_message_callback,
    rcl_subscription_t,
    rcl_take_serialized_message,
    rcutils_get_default_allocator,
    rcutils_reset_error,
    require_rcl,
    rmw_message_info_t,
)
from tf2_ros._process.inbox cimport (
    SENDER_BYTES,
    Inboxes,
    ReceivedMessage,
    InboxSource,
    InboxState,
    inbox_arrived,
)

from tf2_ros._process.inbox import INBOXES

cdef enum:
    THRESHOLD = 16              # messages of a topic that may wait, which a lookup would have to insert first
    QUEUE_SHARE = 4             # nor may more wait than this part of the subscription's queue


cdef struct Arrivals:
    # Of one topic. The middleware's threads touch only `arrived`, `threshold` and `inbox`.
    uint32_t arrived            # atomic, and a hint: 0: no message waits
    uint32_t threshold          # messages that may wait
    InboxState* inbox           # NULL: nothing is taken any more
    # Guarded by the lock of all inboxes.
    bint has_more               # the last attempt to take a message found one, or failed
    const rcl_subscription_t* subscription      # NULL: nothing is taken
    Arrivals* following         # in the order in which they are taken
    size_t number               # of the topic, in `names` of the InboxSource
    uint32_t depth              # of the subscription's queue; 0: it is not known
    int64_t untaken             # messages reported less those taken; negative: some are still to be reported
    bint has_overflowed         # more were reported than the queue holds, and it was not found empty since
    uint64_t overwritten        # messages that newer ones have displaced from the queue; at least this many
    bint is_static
    uint64_t taken              # messages since the beginning
    int64_t taken_at_ns         # steady time of the last of these


cdef struct Subscribed:
    # Guarded by the lock of all inboxes.
    Arrivals* first             # of all topics
    bint is_recorded            # the inbox needs the sender and the time of each message
    rcl_clock_t* clock          # whose time is the time of reception while it is simulated; or NULL
    rcl_allocator_t allocator   # that of malloc, which learns how large a message is before it is copied


cdef void _arrived(const void* data, size_t count) noexcept nogil:
    # The middleware calls this, under its own locks, in any thread, perhaps with the GIL.
    # It takes neither a lock nor the GIL: `unsubscribe` holds the GIL while it waits for this to return.
    cdef Arrivals* topic = <Arrivals*>data
    cdef uint32_t before = add_seq_cst(&topic.arrived, <uint32_t>count)
    cdef InboxState* inbox = topic.inbox
    if inbox != NULL:
        inbox_arrived(inbox, before + count >= topic.threshold)


# Taking; with the lock held.

cdef uint32_t _count_arrived(Arrivals* topic) noexcept nogil:
    # Returns how many messages were reported since the last call. Each one is reported after its arrival, so
    # what is beyond the depth of the queue cannot be there any more.
    cdef uint32_t arrived = exchange_seq_cst(&topic.arrived, 0)
    topic.untaken += arrived
    if topic.depth and topic.untaken > topic.depth:
        topic.overwritten += <uint64_t>(topic.untaken - topic.depth)
        topic.untaken = topic.depth
        topic.has_overflowed = True
    return arrived


cdef void _found_empty(Arrivals* topic) noexcept nogil:
    # What was reported and not taken is lost; unless the queue never overflowed: then it was no message, such
    # as the end of a publisher.
    if topic.untaken > 0:
        if topic.has_overflowed:
            topic.overwritten += <uint64_t>topic.untaken
        topic.untaken = 0
    topic.has_overflowed = False


cdef void _note_reception(
    const Subscribed* source, const rmw_message_info_t* info, ReceivedMessage* received
) noexcept nogil:
    cdef c_bool is_simulated = False
    memcpy(received.sender, info.publisher_gid.data, SENDER_BYTES)
    if (source.clock != NULL
            and rcl_is_enabled_ros_time_override(source.clock, &is_simulated) == RCL_RET_OK and is_simulated
            and rcl_clock_get_now(source.clock, &received.received_ns) == RCL_RET_OK):
        return
    received.received_ns = info.received_timestamp if info.received_timestamp > 0 else system_ns()


cdef rcl_ret_t _take_message(
    const Subscribed* source, Arrivals* topic, ReceivedMessage* received
) noexcept nogil:
    cdef MessageInfo information
    cdef rcl_serialized_message_t message
    cdef rcl_ret_t result
    message.buffer, message.buffer_length, message.buffer_capacity = received.data, 0, received.capacity
    message.allocator = source.allocator
    result = rcl_take_serialized_message(
        topic.subscription, &message, &information.known if source.is_recorded else NULL, NULL)
    # rcl may have allocated more.
    received.data, received.size = message.buffer, message.buffer_length
    received.capacity = message.buffer_capacity
    if result != RCL_RET_OK:
        rcutils_reset_error()
        return result
    topic.taken += 1
    topic.untaken -= 1
    topic.taken_at_ns = monotonic_ns()
    received.topic, received.is_static = topic.number, topic.is_static
    if source.is_recorded:
        _note_reception(source, &information.known, received)
    return RCL_RET_OK


cdef class TopicArrivals:
    """
    What is received on one topic. The source and the buffer keep it; so it keeps no listener.

    :param inboxes: those of the inbox that takes the messages.
    """

    cdef Arrivals _arrivals
    cdef Inboxes _inboxes
    cdef object _handle         # of the subscription, in use as long as its address is used

    def __cinit__(self, Inboxes inboxes not None=INBOXES):
        self._inboxes = inboxes

    def count(self):
        """Count a message with which an executor has called the listener."""
        with nogil:
            lock_acquire(&self._inboxes.shared.lock)
            self._arrivals.taken += 1
            self._arrivals.taken_at_ns = monotonic_ns()
            lock_release(&self._inboxes.shared.lock)

    def taken(self):
        """Return how many messages there were, and the steady time of the last one in nanoseconds."""
        cdef uint64_t taken
        cdef int64_t at_ns
        with nogil:
            lock_acquire(&self._inboxes.shared.lock)
            taken, at_ns = self._arrivals.taken, self._arrivals.taken_at_ns
            lock_release(&self._inboxes.shared.lock)
        return taken, at_ns

    @property
    def is_received(self):
        """Whether its messages arrive without an executor."""
        return self._handle is not None

    def overwritten(self):
        """Return how many messages newer ones have displaced from the queue, as far as that is known."""
        cdef uint64_t overwritten
        with nogil:
            lock_acquire(&self._inboxes.shared.lock)
            overwritten = self._arrivals.overwritten
            lock_release(&self._inboxes.shared.lock)
        return overwritten


@cython.no_gc_clear     # its inbox needs it at its own end
cdef class Subscriptions(InboxSource):
    """
    Takes the messages of a listener's topics.

    :param is_recorded: the inbox records sender and time of each message.
    :param clock: the handle of a clock, whose time is that of reception while it is simulated; or None.
    """

    cdef Subscribed _subscribed
    cdef object _clock              # keeps the clock
    cdef list _topics               # in the order in which they were added
    cdef public bint has_reports    # whether the middleware reports arrivals to this object

    def __cinit__(self, bint is_recorded=False, clock=None):
        require_rcl()
        self.names, self._topics, self.has_reports = [], [], True
        self._clock = clock
        self._subscribed.is_recorded = is_recorded
        self._subscribed.allocator = rcutils_get_default_allocator()
        if clock is not None:
            self._subscribed.clock = <rcl_clock_t*><uintptr_t>clock.pointer

    def subscribe(self, TopicArrivals topic not None, handle, str name not None, bint is_static,
                  uint32_t depth):
        """
        Receive on a topic, once. Of several topics the last one is taken first.

        :param handle: of the subscription, whose ``pointer`` is the address of an ``rcl_subscription_t``.
        :param depth: of the subscription's queue; 0: it is not known.
        :raises RuntimeError: the middleware does not report arrivals.
        """
        cdef Arrivals* arrivals = &topic._arrivals
        cdef uintptr_t address = handle.pointer     # runs Python, which must not happen with the lock
        handle.__enter__()
        topic._handle = handle
        self._topics.append(topic)
        self.names.append(name)
        lock_acquire(&topic._inboxes.shared.lock)
        arrivals.number = len(self.names) - 1
        arrivals.is_static, arrivals.depth = is_static, depth
        arrivals.threshold = max(min(<uint32_t>THRESHOLD, depth // QUEUE_SHARE), 1) if depth else THRESHOLD
        arrivals.inbox = self.inbox
        arrivals.subscription = <const rcl_subscription_t*>address
        arrivals.following = self._subscribed.first
        self._subscribed.first = arrivals
        lock_release(&topic._inboxes.shared.lock)
        # Without the lock: what has arrived is reported at once.
        if rcl_subscription_set_on_new_message_callback(
                arrivals.subscription, _arrived, arrivals) != RCL_RET_OK:
            rcutils_reset_error()
            self.unsubscribe(topic)
            raise RuntimeError("the middleware does not report arrivals")

    def unsubscribe(self, TopicArrivals topic not None):
        """Receive nothing more on a topic; what was not inserted stays with its subscription."""
        cdef Arrivals* arrivals = &topic._arrivals
        handle, topic._handle = topic._handle, None     # several threads may do this
        if handle is None:
            return
        # The middleware waits for calls that are running, and these wait for nothing.
        if self.has_reports and rcl_subscription_set_on_new_message_callback(
                arrivals.subscription, NULL, NULL) != RCL_RET_OK:
            rcutils_reset_error()
        lock_acquire(&topic._inboxes.shared.lock)
        arrivals.subscription = NULL
        arrivals.inbox = NULL
        lock_release(&topic._inboxes.shared.lock)
        handle.__exit__(None, None, None)

    cdef bint next(self, ReceivedMessage* received) noexcept nogil:
        # Of the first topic that has one, so static messages come first.
        cdef Arrivals* topic = self._subscribed.first
        cdef rcl_ret_t result
        while topic != NULL:
            # First the count, then the message: `_arrived` is called after its message has arrived.
            if topic.subscription != NULL and (topic.has_more or _count_arrived(topic)):
                result = _take_message(&self._subscribed, topic, received)
                topic.has_more = result != RCL_RET_SUBSCRIPTION_TAKE_FAILED
                if result == RCL_RET_OK:
                    return True
                if topic.has_more:
                    # After an error, such as a lack of memory for one message, others may wait, and nothing
                    # reports them again. The next round tries, and not this thread at once, because the error
                    # may last.
                    store_seq_cst(&topic.inbox.unread, 1)
                else:
                    _found_empty(topic)
            topic = topic.following
        return False

    cdef void detach(self) noexcept:
        for topic in self._topics:
            self.unsubscribe(topic)
