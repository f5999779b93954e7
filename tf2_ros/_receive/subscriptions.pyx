"""
The subscriptions of a listener as the source of an inbox.

The middleware reports each arrival, which is only counted; messages are taken from a subscription when the
inbox is drained.
"""

cimport cython
from libc.stddef cimport size_t
from libc.stdint cimport int64_t, uint32_t, uint64_t, uintptr_t

from tf2_py._internal cimport (
    batch_prefix,
    monotonic_ns,
    system_ns,
    word_add,
    word_exchange,
    word_store,
)
from tf2_ros._rcl cimport (
    RCL_RET_OK,
    MessageInfo,
    RMW_GID_STORAGE_SIZE,
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
)
from tf2_ros._receive.inbox cimport (
    LARGE_BYTES,
    Parcel,
    Source,
    State,
    inbox_arrived,
    inbox_has_parcel,
    inbox_insert,
    inbox_read,
    inboxes_lock,
    inboxes_unlock,
    message_work,
)
from tf2_ros.records cimport Recording, Records, records_add, records_add_malformed

cdef enum:
    THRESHOLD = 16              # messages of a topic that may wait, which a lookup would have to insert first
    QUEUE_SHARE = 4             # nor may more wait than this part of the subscription's queue


cdef struct Arrivals:
    # Of one topic. The middleware's threads touch only `arrived`, `threshold` and `inbox`.
    uint32_t arrived            # atomic, and a hint: 0: no message waits
    uint32_t threshold          # messages that may wait
    State* inbox                # NULL: nothing is taken any more
    # Guarded by the lock of all inboxes.
    const rcl_subscription_t* subscription      # NULL: nothing is taken
    Arrivals* following         # in the order in which they are taken
    size_t number               # of the topic, in `names` of the Source
    bint is_static
    uint64_t taken              # messages since the beginning
    int64_t taken_at_ns         # steady time of the last of these


cdef struct Subscribed:
    # Guarded by the lock of all inboxes.
    Arrivals* first             # of all topics
    Records* records            # NULL: nothing is recorded
    const char* prefix          # of all names; NULL: they stay as they are
    size_t prefix_size
    rcl_clock_t* clock          # whose time is recorded while it is simulated; or NULL
    rcl_allocator_t allocator   # that of malloc
    # Of the message in the parcel.
    const Arrivals* topic
    MessageInfo information             # if it is recorded


cdef void _arrived(const void* data, size_t count) noexcept nogil:
    # The middleware calls this, under its own locks, in any thread, perhaps with the GIL.
    cdef Arrivals* topic = <Arrivals*>data
    cdef uint32_t before = word_add(&topic.arrived, <uint32_t>count)
    cdef State* inbox = topic.inbox
    if inbox != NULL:
        inbox_arrived(inbox, before + count >= topic.threshold)


# Taking; with the lock held.

cdef bint _simulated_now(rcl_clock_t* clock, int64_t* now_ns) noexcept nogil:
    # Returns whether the clock's time is simulated; only then, sets the time.
    cdef c_bool simulated = False
    if clock == NULL or rcl_is_enabled_ros_time_override(clock, &simulated) != RCL_RET_OK or not simulated:
        return False
    return rcl_clock_get_now(clock, now_ns) == RCL_RET_OK


cdef void _record(State* inbox, bint is_readable) noexcept nogil:
    cdef Subscribed* source = <Subscribed*>inbox.source
    cdef int64_t received_ns = source.information.known.received_timestamp
    if not is_readable:
        records_add_malformed(source.records)
        return
    # A simulated clock must be read when a message arrives.
    is_simulated = _simulated_now(source.clock, &received_ns)
    word_store(&inbox.wants_each, is_simulated)
    if not is_simulated and received_ns <= 0:
        received_ns = system_ns()
    records_add(source.records, &inbox.parcel.batch, received_ns, source.information.known.publisher_gid.data,
                RMW_GID_STORAGE_SIZE)


cdef bint _parse(State* inbox) noexcept nogil:
    # As in State.
    cdef Subscribed* source = <Subscribed*>inbox.source
    cdef bint is_readable = inbox_read(inbox, source.topic.number, source.topic.is_static)
    if is_readable and source.prefix != NULL:
        batch_prefix(&inbox.parcel.batch, source.prefix, source.prefix_size)
    if source.records != NULL:
        _record(inbox, is_readable)
    return is_readable


cdef size_t _take_message(State* inbox, Arrivals* topic, int64_t now_ns) noexcept nogil:
    # Takes one message, and inserts it unless it is large. Returns the work; 0: there was none.
    cdef Subscribed* source = <Subscribed*>inbox.source
    cdef Parcel* parcel = inbox.parcel
    cdef rcl_serialized_message_t message
    cdef rcl_ret_t result
    message.buffer, message.buffer_length, message.buffer_capacity = parcel.data, 0, parcel.capacity
    message.allocator = source.allocator
    result = rcl_take_serialized_message(
        topic.subscription, &message, &source.information.known if source.records != NULL else NULL, NULL)
    # rcl may have allocated more.
    parcel.data, parcel.size, parcel.capacity = message.buffer, message.buffer_length, message.buffer_capacity
    if result != RCL_RET_OK:
        rcutils_reset_error()
        return 0
    topic.taken += 1
    topic.taken_at_ns = now_ns
    source.topic = topic
    inbox.has_large = message.buffer_length > LARGE_BYTES
    if not inbox.has_large:
        inbox_insert(inbox, _parse(inbox))
    return message_work(message.buffer_length)


cdef size_t _take_subscribed(State* inbox, size_t most) noexcept nogil:
    cdef int64_t now_ns = monotonic_ns()
    cdef size_t left = most
    cdef size_t work
    cdef Arrivals* topic = (<Subscribed*>inbox.source).first
    while topic != NULL:
        # First the count, then the messages: `_arrived` is called after its message has arrived.
        if topic.subscription != NULL and word_exchange(&topic.arrived, 0):
            while left > 0 and inbox_has_parcel(inbox):
                work = _take_message(inbox, topic, now_ns)
                if work == 0:
                    break
                left -= min(left, work)     # nothing is left after a large message
            if left == 0 or not inbox_has_parcel(inbox):
                # Without memory, the next round tries again.
                word_store(&topic.arrived, 1)
                word_store(&inbox.pending, 1)
                break
        topic = topic.following
    return most - left


cdef class TopicArrivals:
    """What is received on one topic. Source and buffer keep it; so it keeps no listener."""

    cdef Arrivals _arrivals
    cdef object _handle         # of the subscription, in use as long as its address is used

    def count(self):
        """Count a message with which an executor has called the listener."""
        with nogil:
            inboxes_lock()
            self._arrivals.taken += 1
            self._arrivals.taken_at_ns = monotonic_ns()
            inboxes_unlock()

    def taken(self):
        """Return how many messages there were, and the steady time of the last one in nanoseconds."""
        cdef uint64_t count
        cdef int64_t at_ns
        with nogil:
            inboxes_lock()
            count, at_ns = self._arrivals.taken, self._arrivals.taken_at_ns
            inboxes_unlock()
        return count, at_ns


@cython.no_gc_clear     # topics, and so handles, must exist until the middleware no longer reports anything
cdef class Subscriptions(Source):
    """
    Takes the messages of a listener's topics.

    :param recording: notes the sender and time of each transform; or None.
    :param clock: the handle of a clock, whose time is recorded while it is simulated; or None.
    :param prefix: put before all names.
    """

    cdef Subscribed _subscribed
    cdef Recording _recording       # keeps the records
    cdef object _clock              # keeps the clock
    cdef bytes _prefix
    cdef list _topics               # in the order in which they were added
    cdef public bint is_told        # whether the middleware reports arrivals to this object

    def __cinit__(self, Recording recording=None, clock=None, str prefix=""):
        require_rcl()
        self.names, self._topics, self.is_told = [], [], True
        self.take, self.parse, self.data = _take_subscribed, _parse, &self._subscribed
        self._recording, self._clock, self._prefix = recording, clock, prefix.encode()
        self._subscribed.allocator = rcutils_get_default_allocator()
        if recording is not None:
            self._subscribed.records = &recording._records
        if clock is not None:
            self._subscribed.clock = <rcl_clock_t*><uintptr_t>clock.pointer
        if prefix:
            self._subscribed.prefix = self._prefix
            self._subscribed.prefix_size = len(self._prefix)

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
        # The first message says whether the clock is simulated.
        word_store(&self.inbox.wants_each, self._recording is not None)
        inboxes_lock()
        arrivals.number = len(self.names) - 1
        arrivals.is_static = is_static
        arrivals.threshold = max(min(<uint32_t>THRESHOLD, depth // QUEUE_SHARE), 1)
        arrivals.inbox = self.inbox
        arrivals.subscription = <const rcl_subscription_t*>address
        arrivals.following = self._subscribed.first
        self._subscribed.first = arrivals
        inboxes_unlock()
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
        if self.is_told and rcl_subscription_set_on_new_message_callback(
                arrivals.subscription, NULL, NULL) != RCL_RET_OK:
            rcutils_reset_error()
        inboxes_lock()
        arrivals.subscription = NULL
        arrivals.inbox = NULL
        inboxes_unlock()
        handle.__exit__(None, None, None)

    cdef void silence(self) noexcept:
        for topic in self._topics:
            self.unsubscribe(topic)
