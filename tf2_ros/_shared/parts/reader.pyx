"""A reader's half of a ring: copy records, check them, and insert them. It trusts nothing in the file."""

cdef enum:
    CHUNK_BYTES = 1 << 15       # that a reader copies at once, or else one record


# Positions are below this, so that sums of positions and lengths do not wrap.
cdef uint64_t POSITIONS = <uint64_t>1 << 63


cdef enum Found:
    FOUND_NOTHING               # no record, or no memory for it
    FOUND_RECORD
    FOUND_LAPPED                # the owner has dropped the record at `tail`
    FOUND_DAMAGE                # what is not a record, or less memory than there was


cdef struct Reading:
    # Guarded by the lock of all inboxes, except for what is mapped and the words of the thread.
    int descriptor
    Head* head
    uint64_t capacity           # as found at first
    uint64_t begun              # position at which it began, or began again; it has read everything since
    uint64_t tail               # position of the next record to read; any number if the head is damaged
    unsigned char* chunk        # what was copied of the ring; MOST_RECORD bytes
    uint64_t chunk_from         # positions
    uint64_t chunk_to
    # Of the thread that follows the ring; atomic.
    uint32_t is_quiet           # it sleeps on `nudges`, because nothing needs it
    uint32_t nudges


cdef bint _is_inside(uint64_t position, uint64_t length, uint64_t end) noexcept nogil:
    # Whether a record of this length may be at this position, before this end. All three may be any numbers.
    return (position % UNIT == 0 and position < end < POSITIONS
            and length % UNIT == 0 and UNIT <= length <= min(end - position, <uint64_t>MOST_RECORD))


cdef Found _copy_chunk(Reading* reading, uint64_t size, uint64_t end) noexcept nogil:
    # Copies this many bytes from `tail` on, which are inside, and further records up to `end`. What the chunk
    # has is not copied again: it was checked, and may have changed since.
    cdef uint64_t further = min(end - reading.tail, reading.capacity - reading.tail % reading.capacity)
    cdef uint64_t had = 0
    if reading.chunk_from <= reading.tail < reading.chunk_to:
        had = reading.chunk_to - reading.tail
    if had >= size:
        return FOUND_RECORD
    if had > 0:
        memmove(reading.chunk, reading.chunk + (reading.tail - reading.chunk_from), had)
    size = max(size, min(further, <uint64_t>CHUNK_BYTES))
    reading.chunk_from = reading.chunk_to = reading.tail
    if not read_file(reading.descriptor, reading.chunk + had, size - had,
                     place_of(reading.tail, reading.capacity) + had):
        return FOUND_DAMAGE
    fence()
    if load64(&reading.head.oldest) > reading.tail:
        return FOUND_LAPPED
    reading.chunk_to = reading.tail + size
    return FOUND_RECORD


cdef const Record* _at_tail(const Reading* reading) noexcept nogil:
    return <const Record*>(reading.chunk + (reading.tail - reading.chunk_from))


cdef Found _find_record(Reading* reading) noexcept nogil:
    # Has the record at `tail`, with what follows it, in the chunk.
    cdef uint64_t end = load64(&reading.head.next)
    cdef Found found
    if end == reading.tail:
        return FOUND_NOTHING
    found = _copy_chunk(reading, UNIT, end) if _is_inside(reading.tail, UNIT, end) else FOUND_DAMAGE
    if found != FOUND_RECORD:
        return found
    if (_at_tail(reading).position != reading.tail
            or not _is_inside(reading.tail, record_length(_at_tail(reading)), end)):
        return FOUND_DAMAGE
    return _copy_chunk(reading, record_length(_at_tail(reading)), end)


cdef Found _take_record(State* inbox) noexcept nogil:
    # Inserts the record at `tail`, if it is new.
    cdef Reading* reading = <Reading*>inbox.source
    cdef Parcel* parcel = inbox.parcel
    cdef Found found = _find_record(reading)
    cdef const Record* record
    cdef unsigned char* content
    cdef bint is_readable
    if found != FOUND_RECORD:
        return found
    record = _at_tail(reading)
    # A record that was written again is new only to a reader that began after it was written before.
    if record.previous == record.position or record.previous < reading.begun:
        content = parcel_reserve(parcel, <size_t>record.size + record.authority_size)
        if content == NULL:
            return FOUND_NOTHING
        memcpy(content, <const char*>record + sizeof(Record), parcel.size)
        parcel.size = record.size
        if record.kind == KIND_REMOVAL:
            inbox_remove(inbox, <const char*>content if record.size else NULL, record.size)
        elif record.kind == KIND_STATIC or record.kind == KIND_DYNAMIC:
            is_readable = inbox_read(inbox, 0, record.kind == KIND_STATIC)
            if is_utf8(content + record.size, record.authority_size):
                parcel.batch.authority = <const char*>content + record.size
                parcel.batch.authority_size = record.authority_size
            inbox_insert(inbox, is_readable)
        else:
            return FOUND_DAMAGE
    # Only now: a thread that finds no new record relies on all of them being inserted.
    store64(&reading.tail, reading.tail + record_length(record))
    return FOUND_RECORD


cdef void _begin_anew(State* inbox) noexcept nogil:
    # At the oldest record. Of what was before it, only a clear and static transforms matter, and those were
    # written again.
    cdef Reading* reading = <Reading*>inbox.source
    cdef uint64_t cleared
    reading.begun = load64(&reading.head.oldest)
    cleared = load64(&reading.head.cleared)     # only now: the ring may be cleared and lapped in between
    if reading.tail < cleared <= reading.begun:
        inbox_remove(inbox, NULL, 0)
    store64(&reading.tail, reading.begun)


cdef size_t _take(State* inbox, size_t most) noexcept nogil:
    cdef Reading* reading = <Reading*>inbox.source
    cdef size_t taken = 0
    cdef uint64_t tail
    cdef Found found
    while taken < most and inbox_has_parcel(inbox):
        tail = reading.tail
        found = _take_record(inbox)
        if found == FOUND_NOTHING:
            break
        if found == FOUND_RECORD:
            taken += message_work(reading.tail - tail)
            continue
        if found == FOUND_LAPPED:
            _begin_anew(inbox)
        elif found == FOUND_DAMAGE:
            # Continue behind it, as after a malformed message.
            inbox_refuse(inbox, 0, "the shared memory is damaged")
            reading.begun = load64(&reading.head.next)
            store64(&reading.tail, reading.begun)
        taken += 1
    return taken


cdef void _want(Reading* reading) noexcept nogil:
    store64(&reading.head.wanted_until_ns, <uint64_t>(monotonic_ns() + WANTED_NS))


cdef void _nudge(Reading* reading) noexcept nogil:
    word_store(&reading.nudges, reading.nudges + 1)
    futex_wake(&reading.nudges)


cdef void _catch_up(State* inbox) noexcept nogil:
    cdef bint is_behind = True
    while is_behind:
        word_store(&inbox.pending, 1)
        inboxes_lock()
        is_behind = inbox_serve(inbox)
        inboxes_unlock()


cdef void _follow(State* inbox) noexcept nogil:
    # Inserts each message at once while something waits; otherwise it sleeps.
    cdef Reading* reading = <Reading*>inbox.source
    cdef uint32_t seen, nudges
    while inbox.engine != NULL:
        nudges = word_load(&reading.nudges)
        seen = word_load(&reading.head.arrivals)
        if inbox_wants_all(inbox):
            _want(reading)
            _catch_up(inbox)
            futex_wait(&reading.head.arrivals, seen, ROUND_NS)      # returns if the count has changed
        else:
            # First this, then the need; `asked` does this in the opposite order.
            word_store(&reading.is_quiet, 1)
            if not inbox_wants_all(inbox) and inbox.engine != NULL:
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
        if not read_file(descriptor, &found, sizeof(Head), 0) or found.magic != MAGIC:
            raise ValueError("it is not a shared buffer")
        if found.layout != LAYOUT:
            raise ValueError("it is of another version of this package")
        if found.capacity % STEP or not 0 < found.capacity <= os.fstat(descriptor).st_size - OTHER_BYTES:
            raise ValueError("its size is wrong")
        reading.capacity = found.capacity
        reading.head = map_head(descriptor)
        reading.begun = load64(&reading.head.oldest)
        reading.tail = reading.begun

    def __dealloc__(self):
        # The thread refers to this object, so there is no thread; nor is there an inbox.
        if self._reading.head != NULL:
            munmap(self._reading.head, MAPPED_BYTES)
        free(self._reading.chunk)
        if self._reading.descriptor >= 0:
            close(self._reading.descriptor)

    cdef void redirected(self) noexcept:
        _nudge(&self._reading)
        futex_wake(&self._reading.head.arrivals)

    cdef bint asked(self) except -1:
        cdef bint has_new = load64(&self._reading.head.next) != load64(&self._reading.tail)
        _want(&self._reading)
        if inbox_wants_all(self.inbox) and word_load(&self._reading.is_quiet):
            _nudge(&self._reading)
        return has_new

    def follow(self, Inbox inbox not None):
        """
        Keep the buffer up to date while something waits, until it or the inbox ends.

        :param inbox: that of this, which fills a buffer already; kept meanwhile.
        """
        with nogil:
            _follow(self.inbox)

    @property
    def descriptor(self):
        """Of the file."""
        return self._reading.descriptor
