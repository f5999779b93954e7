"""A reader's half of a ring: copy records, check them, and insert them. It trusts nothing in the file."""

cdef enum:
    LEAST_STEPS = 16            # of a ring
    CHUNK_BYTES = 1 << 15       # that a reader copies at once, or else one record
    TRIES = 100                 # to find head and records consistent
    LAPS = 3                    # for how often the owner may overtake a reader within one round

cdef uint64_t MOST_BYTES = 1 << 40              # of a ring

cdef struct Reading:
    # Guarded by the lock of all inboxes, except for what is mapped and the words of the thread.
    int descriptor
    const Head* head
    uint64_t capacity           # as found at first
    uint64_t begun              # position at which it began, or began again; it has read everything since
    uint64_t tail               # position of the next record to read
    unsigned char* chunk        # what was copied of the ring; MOST_RECORD bytes
    uint64_t chunk_from         # positions
    uint64_t chunk_to
    const char* problem         # why what was found cannot be read; or NULL
    bint is_lapped              # the owner has dropped the record at `tail`
    # Of the thread that follows the ring; atomic.
    uint32_t is_stopping        # it must end
    uint32_t is_quiet           # it sleeps on `nudges`, because nothing needs it
    uint32_t nudges


cdef bint _has_new(Reading* reading) noexcept nogil:
    return load64(&reading.head.next) != load64(&reading.tail)


cdef void _move_to(Reading* reading, uint64_t position) noexcept nogil:
    store64(&reading.tail, position)
    reading.chunk_from = reading.chunk_to = position


cdef bint _fill_chunk(Reading* reading, uint64_t size) noexcept nogil:
    # Copies this many bytes from the tail on; False: see `problem`, or it was lapped.
    reading.chunk_from = reading.chunk_to = reading.tail
    if read_file(reading.descriptor, reading.chunk, size, RING_AT + reading.tail % reading.capacity) != 0:
        reading.problem = "the shared memory was truncated"
        return False
    fence()
    if load64(&reading.head.oldest) > reading.tail:
        return False
    reading.chunk_to = reading.tail + size
    return True


cdef const Record* _next_record(Reading* reading) noexcept nogil:
    # NULL: there is none, or see `problem` and `is_lapped`. The record stays valid until the next call.
    cdef const Head* head = reading.head
    cdef uint64_t capacity = reading.capacity
    cdef uint64_t oldest, end, most, copied, length
    cdef const Record* record
    for _ in range(TRIES):
        end = load64(&head.next)
        oldest = load64(&head.oldest)
        if end == reading.tail:
            return NULL
        if oldest > end or end - oldest > capacity or reading.tail > end:
            continue        # the owner has just written; or this never becomes right
        if reading.tail < oldest:
            reading.is_lapped = True
            return NULL
        most = min(end - reading.tail, capacity - reading.tail % capacity)
        if most % UNIT or reading.tail % UNIT:
            break
        copied = reading.chunk_to - reading.tail
        record = <const Record*>(reading.chunk + (reading.tail - reading.chunk_from))
        length = UNIT if copied < UNIT else record_length(record)
        if length > min(most, <uint64_t>MOST_RECORD):
            break
        if length > copied:
            if not _fill_chunk(reading, min(most, max(length, <uint64_t>CHUNK_BYTES))) and (
                    reading.problem != NULL):
                break
        elif record.position == reading.tail:
            return record
        else:
            break
    if reading.problem == NULL:
        reading.problem = "the shared memory holds what is not a record"
    return NULL


cdef bint _take_record(State* inbox, const Record* record) noexcept nogil:
    # Inserts the record at the tail, if it is new; False: there is no memory.
    cdef Reading* reading = <Reading*>inbox.source
    cdef Parcel* parcel = inbox.parcel
    cdef size_t size = record.size
    cdef size_t authority_size = record.authority_size
    cdef uint32_t kind = record.kind
    cdef const unsigned char* content = <const unsigned char*>record + sizeof(Record)
    cdef unsigned char* memory
    # A record that was written again is new only to a reader that began after it was written before.
    if kind != KIND_PADDING and (record.previous == record.position or record.previous < reading.begun):
        memory = parcel_reserve(parcel, size + authority_size)
        if memory == NULL:
            return False
        # The copy of the authority follows that of the message, and so exists as long.
        memcpy(memory, content + authority_size, size)
        memcpy(memory + size, content, authority_size)
        parcel.size = size
        if kind == KIND_REMOVAL:
            inbox_remove(inbox, <const char*>memory if size else NULL, size)
        elif kind == KIND_STATIC or kind == KIND_DYNAMIC:
            is_readable = inbox_read(inbox, 0, kind == KIND_STATIC)
            if is_utf8(memory + size, authority_size):
                parcel.batch.authority = <const char*>memory + size
                parcel.batch.authority_size = authority_size
            inbox_insert(inbox, is_readable)
        else:
            inbox_refuse(inbox, 0, "the shared memory holds a record of an unknown kind")
    # Only now: a thread that finds no new record relies on all of them being inserted.
    store64(&reading.tail, reading.tail + record_length(record))
    return True


cdef void _begin_anew(State* inbox) noexcept nogil:
    # At the oldest record. Of what was before it, only a clear and static transforms matter, and those were
    # written again.
    cdef Reading* reading = <Reading*>inbox.source
    cdef uint64_t cleared
    reading.is_lapped = False
    reading.begun = load64(&reading.head.oldest)
    cleared = load64(&reading.head.cleared)     # only now: the ring may be cleared and lapped in between
    if reading.tail < cleared <= reading.begun:
        inbox_remove(inbox, NULL, 0)
    _move_to(reading, reading.begun)


cdef size_t _take(State* inbox, size_t most) noexcept nogil:
    cdef Reading* reading = <Reading*>inbox.source
    cdef const Record* record
    cdef size_t taken = 0
    cdef int laps = 0
    while taken < most and inbox_has_parcel(inbox):
        record = _next_record(reading)
        if record != NULL:
            if not _take_record(inbox, record):
                return taken
            taken += 1
        elif reading.is_lapped and laps < LAPS:
            _begin_anew(inbox)
            laps += 1
        elif reading.problem != NULL:
            # Continue behind it, as after a malformed message.
            inbox_refuse(inbox, 0, reading.problem)
            reading.problem = NULL
            reading.begun = load64(&reading.head.next)
            _move_to(reading, reading.begun)
            taken += 1
        else:
            break
    return taken


cdef void _want(Reading* reading) noexcept nogil:
    store64(&board_of(reading.head).wanted_until_ns, <uint64_t>(coarse_ns() + WANTED_NS))


cdef void _nudge(Reading* reading) noexcept nogil:
    word_store(&reading.nudges, reading.nudges + 1)
    futex_wake(&reading.nudges)


cdef void _catch_up(State* inbox) noexcept nogil:
    cdef Reading* reading = <Reading*>inbox.source
    cdef bint is_behind = True
    while is_behind and not word_load(&reading.is_stopping):
        word_store(&inbox.pending, 1)
        inboxes_lock()
        is_behind = inbox_serve(inbox)
        inboxes_unlock()


cdef bint _has_ended(State* inbox) noexcept nogil:
    return inbox.engine == NULL or word_load(&(<Reading*>inbox.source).is_stopping)


cdef void _follow(State* inbox) noexcept nogil:
    # Inserts each message at once while something waits; otherwise it sleeps.
    cdef Reading* reading = <Reading*>inbox.source
    cdef uint32_t seen, nudges
    while not _has_ended(inbox):
        nudges = word_load(&reading.nudges)
        seen = word_load(&reading.head.arrivals)
        if inbox_wants_all(inbox):
            _want(reading)
            _catch_up(inbox)
            # First this, then the count; the owner does this in the opposite order.
            word_store(&board_of(reading.head).sleeps, 1)
            if word_load(&reading.head.arrivals) == seen:
                futex_wait(&reading.head.arrivals, seen, ROUND_NS)
        else:
            # First this, then the need; `asked` does this in the opposite order.
            word_store(&reading.is_quiet, 1)
            if not inbox_wants_all(inbox) and not _has_ended(inbox):
                futex_wait(&reading.nudges, nudges, INT64_MAX)
            word_store(&reading.is_quiet, 0)


cdef class RingReader(Source):
    """
    Receives what another process shares.

    :param descriptor: of its file; it is closed with this object.
    :raises ValueError: the file is not that of a shared buffer; the text says why.
    :raises OSError: it cannot be mapped.
    """

    cdef Reading _reading

    def __cinit__(self, *_, **__):
        self._reading.descriptor = -1
        self._reading.chunk = <unsigned char*>malloc(MOST_RECORD)
        if self._reading.chunk == NULL:
            raise MemoryError
        self.names = ["shared memory"]
        self.take, self.data = _take, &self._reading
        self.serves_itself = True

    def __init__(self, int descriptor):
        cdef Reading* reading = &self._reading
        cdef Head found
        reading.descriptor = descriptor
        if read_file(descriptor, &found, sizeof(Head), 0) != 0 or found.magic != MAGIC:
            raise ValueError("it is not a shared buffer")
        if found.layout != LAYOUT:
            raise ValueError("it is of another version of this package")
        if found.capacity < LEAST_STEPS * STEP or found.capacity > MOST_BYTES or found.capacity % STEP:
            raise ValueError("its sizes are wrong")
        if os.fstat(descriptor).st_size < RING_AT + found.capacity:
            raise ValueError("it was truncated")
        reading.capacity = found.capacity
        reading.head = map_head(descriptor)
        reading.begun = load64(&reading.head.oldest)
        _move_to(reading, reading.begun)

    def __dealloc__(self):
        # The thread refers to this object, so there is no thread; nor is there an inbox.
        unmap_file(<void*>self._reading.head)
        free(self._reading.chunk)
        if self._reading.descriptor >= 0:
            close_file(self._reading.descriptor)

    cdef void redirected(self) noexcept:
        _nudge(&self._reading)

    cdef int64_t count(self) noexcept:
        # No record is shorter. What the file says may be wrong.
        return min((load64(&self._reading.head.next) - self._reading.tail) // UNIT + 1,
                   self._reading.capacity // UNIT)

    cdef bint asked(self) except -1:
        cdef bint has_new = _has_new(&self._reading)
        _want(&self._reading)
        if inbox_wants_all(self.inbox) and word_load(&self._reading.is_quiet):
            _nudge(&self._reading)
        return has_new

    def follow(self, Inbox inbox not None):
        """
        Keep the buffer up to date while something waits, until it ends or :meth:`stop` is called.

        :param inbox: that of this, which fills a buffer already; kept meanwhile.
        """
        with nogil:
            _follow(self.inbox)

    def stop(self):
        """Have :meth:`follow` return soon, and for good."""
        word_store(&self._reading.is_stopping, 1)
        _nudge(&self._reading)
        if self._reading.head != NULL:
            futex_wake(&self._reading.head.arrivals)

    @property
    def problem(self):
        """Why nothing arrives any more, whether or not the owner exists; or None."""
        if os.fstat(self._reading.descriptor).st_size < RING_AT + self._reading.capacity:
            return "its memory was truncated"
        return None

    @property
    def descriptor(self):
        """Of the file."""
        return self._reading.descriptor

    @property
    def shortage(self):
        """See ``shortage_of``."""
        return shortage_of(self._reading.head)
