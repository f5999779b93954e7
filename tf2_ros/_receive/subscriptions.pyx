"""
The inbox of a listener's subscriptions.

The middleware reports each arrival, which is only counted; messages are taken from a subscription when the
inbox is drained.
"""

cimport cython
from libc.stddef cimport size_t
from libc.stdint cimport int64_t, uint32_t, uint64_t, uintptr_t

from tf2_py._internal cimport (
    Engine,
    batch_prefix,
    lock_acquire,
    lock_release,
    monotonic_ns,
    name_utf8,
    system_ns,
    word_add,
    word_exchange,
    word_store,
)
from tf2_ros._rcl cimport (
    RCL_RET_OK,
    RMW_GID_STORAGE_SIZE,
    c_bool,
    rcl_allocator_t,
    rcl_clock_get_now,
    rcl_clock_t,
    rcl_is_enabled_ros_time_override,
    rcl_last_error,
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
from tf2_ros._receive.inbox cimport (
    MessageInbox,
    Parcel,
    State,
    inbox_arrived,
    inbox_has_parcel,
    inbox_insert,
    inbox_read,
)
from tf2_ros.records cimport Recording, Records, records_add, records_add_malformed

cdef enum:
    MAX_TOPICS = 2              # of a listener: static and dynamic transforms
    THRESHOLD = 16              # messages of a topic that may wait, which a lookup would have to insert first
    QUEUE_SHARE = 4             # nor may more wait than this part of the subscription's queue


cdef struct Topic:
    # The middleware's threads touch only `arrived` and `inbox`.
    uint32_t arrived            # atomic, and a hint: 0: no message waits
    State* inbox
    const rcl_subscription_t* subscription      # NULL: executors take from it
    uint32_t threshold          # messages that may wait
    uint32_t depth              # of the subscription's queue
    uint64_t taken              # messages since the beginning
    int64_t taken_at_ns         # steady time of the last of these


cdef struct Subscriptions:
    # Guarded by the inbox's lock.
    Topic topics[MAX_TOPICS]    # by `topic_number`
    Records* records            # NULL: nothing is recorded
    const char* prefix          # of all names; NULL: they stay as they are
    size_t prefix_size
    rcl_clock_t* clock          # of the buffer, where something is recorded; or NULL
    rcl_allocator_t allocator   # that of malloc


cdef size_t topic_number(bint is_static) noexcept nogil:
    # Static transforms are taken first, because others may need them.
    return 0 if is_static else 1


cdef void _arrived(const void* data, size_t count) noexcept nogil:
    # The middleware calls this, under its own locks, in any thread, perhaps with the GIL.
    cdef Topic* topic = <Topic*>data
    cdef uint32_t before = word_add(&topic.arrived, <uint32_t>count)
    inbox_arrived(topic.inbox, before + count >= topic.threshold)


# Taking; with the inbox's lock held.

cdef bint _simulated_now(rcl_clock_t* clock, int64_t* now_ns) noexcept nogil:
    # Returns whether the clock's time is simulated; only then, sets the time.
    cdef c_bool simulated = False
    if clock == NULL or rcl_is_enabled_ros_time_override(clock, &simulated) != RCL_RET_OK or not simulated:
        return False
    return rcl_clock_get_now(clock, now_ns) == RCL_RET_OK


cdef void _record(State* inbox, const rmw_message_info_t* information, bint is_readable) noexcept nogil:
    cdef Subscriptions* source = <Subscriptions*>inbox.source
    cdef int64_t received_ns = information.received_timestamp
    if not is_readable:
        records_add_malformed(source.records)
        return
    # A simulated clock must be read when a message arrives.
    is_simulated = _simulated_now(source.clock, &received_ns)
    word_store(&inbox.wants_each, is_simulated)
    if not is_simulated and received_ns <= 0:
        received_ns = system_ns()
    records_add(source.records, &inbox.parcel.batch, received_ns, information.publisher_gid.data,
                RMW_GID_STORAGE_SIZE)


cdef bint _take_message(State* inbox, size_t number, int64_t now_ns) noexcept nogil:
    # Takes one message and inserts it; False if there was none.
    cdef Subscriptions* source = <Subscriptions*>inbox.source
    cdef Topic* topic = &source.topics[number]
    cdef Parcel* parcel = inbox.parcel
    cdef rmw_message_info_t information
    cdef rcl_serialized_message_t message
    cdef rcl_ret_t result
    cdef bint is_readable
    message.buffer, message.buffer_length, message.buffer_capacity = parcel.data, 0, parcel.capacity
    message.allocator = source.allocator
    result = rcl_take_serialized_message(
        topic.subscription, &message, &information if source.records != NULL else NULL, NULL)
    # rcl may have allocated more.
    parcel.data, parcel.size, parcel.capacity = message.buffer, message.buffer_length, message.buffer_capacity
    if result != RCL_RET_OK:
        rcutils_reset_error()
        return False
    topic.taken += 1
    topic.taken_at_ns = now_ns
    is_readable = inbox_read(inbox, number, number == topic_number(True))
    if is_readable and source.prefix != NULL:
        batch_prefix(&parcel.batch, source.prefix, source.prefix_size)
    if source.records != NULL:
        _record(inbox, &information, is_readable)
    inbox_insert(inbox, is_readable)
    return True


cdef size_t _take_subscribed(State* inbox, size_t most) noexcept nogil:
    cdef Subscriptions* source = <Subscriptions*>inbox.source
    cdef int64_t now_ns = monotonic_ns()
    cdef size_t number
    cdef size_t left = most
    cdef Topic* topic
    for number in range(MAX_TOPICS):
        topic = &source.topics[number]
        # First the count, then the messages: `_arrived` is called after its message has arrived.
        if topic.subscription == NULL or not word_exchange(&topic.arrived, 0):
            continue
        while left > 0 and inbox_has_parcel(inbox):
            if not _take_message(inbox, number, now_ns):
                break
            left -= 1
        else:
            # Without memory, the next round tries again.
            word_store(&topic.arrived, 1)
            word_store(&inbox.pending, 1)
            break
    return most - left


@cython.no_gc_clear     # the handles must exist until the middleware no longer reports anything
cdef class RclInbox(MessageInbox):
    """The inbox of a listener."""

    cdef Subscriptions _source
    cdef Recording _recording       # keeps the records
    cdef str _prefix                # keeps its UTF-8 alive
    cdef list _handles              # what the topics use, by their index

    def __cinit__(self, *_, **__):
        cdef size_t number
        require_rcl()
        self._handles = [None] * MAX_TOPICS
        self._names = [""] * MAX_TOPICS
        self._source.allocator = rcutils_get_default_allocator()
        self._state.take = _take_subscribed
        self._state.source = &self._source
        for number in range(MAX_TOPICS):
            self._source.topics[number].inbox = &self._state

    def set_up(self, str authority not None, rounds, Recording recording=None, str prefix=""):
        """
        Set this up once, before anything else.

        :param authority: of the transforms.
        :param rounds: of the executor that is informed of what arrives.
        :param recording: notes the sender and time of each transform; or None.
        :param prefix: put before all names.
        """
        cdef Py_ssize_t size
        if prefix:
            self._prefix = prefix
            self._source.prefix = name_utf8(prefix, &size)
            self._source.prefix_size = size
        self._set_authority(authority)
        self.inform(rounds)
        self._recording = recording
        self._source.records = NULL if recording is None else &recording._records
        self._state.is_closed = False
        self._enlist()

    def __dealloc__(self):
        self._discharge()

    cdef void _discharge(self) noexcept:
        cdef size_t number
        if self._state.is_closed:
            return
        for number in range(MAX_TOPICS):
            self._silence(number)
        MessageInbox._discharge(self)

    cdef void _silence(self, size_t number, bint is_told=True) noexcept:
        # The middleware waits for calls that are running, and these wait for nothing.
        cdef Topic* topic = &self._source.topics[number]
        if topic.subscription == NULL:
            return
        if is_told and rcl_subscription_set_on_new_message_callback(
                topic.subscription, NULL, NULL) != RCL_RET_OK:
            rcutils_reset_error()
        lock_acquire(&self._state.lock)
        topic.subscription = NULL
        lock_release(&self._state.lock)

    def subscribe(self, bint is_static, handle, subscription, str name not None, uint32_t depth):
        """
        Receive on a topic.

        :param is_static: whether the topic is that of static transforms.
        :param handle: of the subscription; kept as long as the address is used.
        :param subscription: address of an ``rcl_subscription_t``.
        :param depth: of the subscription's queue.
        :raises RuntimeError: the middleware does not report arrivals.
        """
        cdef size_t number = topic_number(is_static)
        cdef Topic* topic = &self._source.topics[number]
        self._handles[number] = handle
        self._names[number] = name
        lock_acquire(&self._state.lock)
        topic.depth = depth
        topic.threshold = max(min(<uint32_t>THRESHOLD, depth // QUEUE_SHARE), 1)
        topic.subscription = <const rcl_subscription_t*><uintptr_t>subscription
        lock_release(&self._state.lock)
        # Without the lock: what has arrived is reported at once.
        if rcl_subscription_set_on_new_message_callback(
                topic.subscription, _arrived, <void*>topic) != RCL_RET_OK:
            error = rcl_last_error()
            topic.subscription = NULL
            self._handles[number] = None
            raise RuntimeError(error)

    def unsubscribe(self, bint is_static, bint is_told):
        """
        Receive nothing more on a topic; what was not inserted stays with its subscription.

        :param is_told: whether the middleware still reports arrivals to this object.
        """
        if not self._state.is_closed:
            self._silence(topic_number(is_static), is_told)
            self._handles[topic_number(is_static)] = None

    def fill(self, Engine buffer not None, clock=0):
        """
        Insert from now on into this buffer, which is not kept alive.

        :param clock: address of its ``rcl_clock_t``, or 0. If it is simulated, what is recorded has its time.
        """
        cdef int64_t now_ns
        MessageInbox.fill(self, buffer)
        if self._recording is None or not clock:
            return
        lock_acquire(&self._state.lock)
        self._source.clock = <rcl_clock_t*><uintptr_t>clock
        word_store(&self._state.wants_each, _simulated_now(self._source.clock, &now_ns))
        lock_release(&self._state.lock)

    cdef void _engine_changed(self) noexcept:
        self._source.clock = NULL
        word_store(&self._state.wants_each, 0)

    cdef int64_t _arrived_by_now(self) noexcept:
        cdef int64_t count = 0
        cdef size_t number
        for number in range(MAX_TOPICS):
            count += self._source.topics[number].depth
        return count

    def taken(self, bint is_static):
        """Return how many messages of a topic were taken, and the steady time of the last in nanoseconds."""
        cdef const Topic* topic = &self._source.topics[topic_number(is_static)]
        cdef uint64_t count
        cdef int64_t at_ns
        lock_acquire(&self._state.lock)
        count, at_ns = topic.taken, topic.taken_at_ns
        lock_release(&self._state.lock)
        return count, at_ns
