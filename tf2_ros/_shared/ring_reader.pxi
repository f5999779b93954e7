"""A reader's half of a ring: copy records, check them, and insert them. It trusts nothing in the file."""

# Uses: no chapter.

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
    uint64_t following          # of the one behind that which `_next` has filled into a parcel last
    unsigned char* chunk        # what was copied of the ring; MOST_RECORD bytes
    uint64_t chunk_from         # positions
    uint64_t chunk_to
    uint64_t overruns           # how often the owner had displaced what was not read yet
    uint64_t room_ns            # how old that had become, the last time
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
    fence_seq_cst()
    if load64_acquire(&reading.head.oldest) > reading.tail:
        return FOUND_LAPPED
    reading.chunk_to = reading.tail + size
    return FOUND_RECORD


cdef const RingRecord* _at_tail(const Reading* reading) noexcept nogil:
    return <const RingRecord*>(reading.chunk + (reading.tail - reading.chunk_from))


cdef Found _find_record(Reading* reading) noexcept nogil:
    # Has the record at `tail`, with what follows it, in the chunk.
    cdef uint64_t end = load64_acquire(&reading.head.next)
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


cdef bint _fill(Reading* reading, const RingRecord* record, Parcel* parcel) noexcept nogil:
    # Copies a record; False: there is no memory.
    cdef unsigned char* content = parcel_reserve(parcel, <size_t>record.size + record.authority_size)
    if content == NULL:
        return False
    memcpy(content, <const char*>record + sizeof(RingRecord), parcel.size)
    parcel.size, parcel.authority_size, parcel.has_authority = record.size, record.authority_size, True
    parcel.is_static = record.kind == KIND_STATIC
    parcel.kind = PARCEL_REMOVAL if record.kind == KIND_REMOVAL else PARCEL_MESSAGE
    return True


cdef void _begin_anew(Reading* reading, Parcel* parcel) noexcept nogil:
    # At the oldest record. Of what was dropped for its age, only a clear and static transforms matter, and
    # those were written again.
    cdef uint64_t cleared
    if reading.tail < load64_acquire(&reading.head.displaced):
        reading.overruns += 1
        reading.room_ns = load64_acquire(&reading.head.room_ns)
    reading.begun = load64_acquire(&reading.head.oldest)
    # Only now: the ring may be cleared and lapped in between.
    cleared = load64_acquire(&reading.head.cleared)
    if reading.tail < cleared <= reading.begun:
        parcel.kind = PARCEL_REMOVAL
    reading.following = reading.begun


cdef void _skip_damage(Reading* reading, Parcel* parcel) noexcept nogil:
    # Continue behind it, as after a malformed message.
    parcel.kind, parcel.problem = PARCEL_DAMAGE, "the shared memory is damaged"
    reading.following = reading.begun = load64_acquire(&reading.head.next)


cdef bint _next(Reading* reading, Parcel* parcel) noexcept nogil:
    cdef const RingRecord* record
    cdef Found found
    # Only now: a thread that finds no new record relies on all of them being inserted.
    store64_release(&reading.tail, reading.following)
    found = _find_record(reading)
    if found == FOUND_NOTHING:
        return False
    if found == FOUND_LAPPED:
        _begin_anew(reading, parcel)
        return True
    if found == FOUND_RECORD:
        record = _at_tail(reading)
        if record.kind in (KIND_DYNAMIC, KIND_STATIC, KIND_REMOVAL):
            # One that was written again is new only to a reader that began after it was written before.
            if record.previous == record.position or record.previous < reading.begun:
                if not _fill(reading, record, parcel):
                    return False
            reading.following = reading.tail + record_length(record)
            return True
    _skip_damage(reading, parcel)
    return True


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

    def __init__(self, int descriptor):
        cdef Reading* reading = &self._reading
        cdef Head found
        reading.descriptor = descriptor
        if not read_file(descriptor, &found, sizeof(Head), 0) or found.magic != MAGIC:
            raise ValueError("it is not a shared buffer")
        if found.layout != LAYOUT:
            raise ValueError("another version of tf2-ros-cython made it: use the same one in all processes")
        if found.capacity % STEP or not 0 < found.capacity <= os.fstat(descriptor).st_size - OTHER_BYTES:
            raise ValueError("the size in its header is wrong")
        reading.capacity = found.capacity
        reading.head = map_head(descriptor)
        reading.begun = load64_acquire(&reading.head.oldest)
        reading.tail = reading.following = reading.begun

    def __dealloc__(self):
        # The thread refers to this object, so there is no thread; nor is there an inbox.
        if self._reading.head != NULL:
            munmap(self._reading.head, MAPPED_BYTES)
        free(self._reading.chunk)
        if self._reading.descriptor >= 0:
            close(self._reading.descriptor)

    cdef bint next(self, Parcel* parcel) noexcept nogil:
        return _next(&self._reading, parcel)

    # What a PolledInbox needs, without a lock. Readers and the owner wake each other by words in the memory.

    cdef bint has_message(self) noexcept nogil:
        # A program reads the buffer. First this: the owner must not miss that each message is wanted at once
        # from now on.
        cdef Head* head = self._reading.head
        cdef bint has_new = load64_acquire(&head.next) != load64_acquire(&self._reading.tail)
        store64_release(&head.wanted_until_ns, <uint64_t>(monotonic_ns() + WANTED_NS))
        return has_new

    cdef uint64_t watch(self) noexcept nogil:
        # What changes with each message and each nudge.
        cdef uint64_t nudges = load_seq_cst(&self._reading.nudges)
        return nudges << 32 | load_seq_cst(&self._reading.head.arrivals)

    cdef void rest(self, uint64_t watched, bint is_wanted) noexcept nogil:
        # Until another message is there, if each is wanted at once, and otherwise until a nudge; not if
        # either has happened since `watch`: both sleeps return at once if the word has changed.
        cdef Reading* reading = &self._reading
        if is_wanted:
            store64_release(&reading.head.wanted_until_ns, <uint64_t>(monotonic_ns() + WANTED_NS))
            futex_wait(&reading.head.arrivals, <uint32_t>watched, ROUND_NS)
        else:
            store_seq_cst(&reading.is_quiet, 1)
            futex_wait(&reading.nudges, <uint32_t>(watched >> 32), INT64_MAX)
            store_seq_cst(&reading.is_quiet, 0)

    cdef void nudge(self, bint at_once) noexcept nogil:
        # Ends a rest; `at_once`: also one that waits for a message.
        cdef Reading* reading = &self._reading
        add_seq_cst(&reading.nudges, 1)
        if load_seq_cst(&reading.is_quiet):
            futex_wake(&reading.nudges)
        if at_once:
            futex_wake(&reading.head.arrivals)

    @property
    def descriptor(self):
        """Of the file."""
        return self._reading.descriptor

    def overruns(self):
        """
        Return how often the owner had displaced what was not read yet, for lack of room, and how many seconds
        old that had become, the last time.
        """
        cdef uint64_t count, room_ns
        with nogil:
            lock_acquire(&self.inbox.drain.lock)
            count, room_ns = self._reading.overruns, self._reading.room_ns
            lock_release(&self.inbox.drain.lock)
        return count, room_ns / 1e9


@cython.final
@cython.no_gc_clear
cdef class PolledInbox(InboxBase):
    """Inserts what is in a ring, to which nothing reports arrivals: each read of the buffer looks there."""

    cdef RingReader _ring

    def __cinit__(self, RingReader source not None, *_, **__):
        self._ring = source
        self.state.pending = 1      # always

    def follow(self):
        """Insert each message at once while something waits, until there is no buffer; for a thread."""
        cdef uint64_t watched
        cdef bint is_wanted
        with nogil:
            while self.state.engine != NULL:
                # A read does this in the opposite order: it first wants messages, and then nudges.
                watched = self._ring.watch()
                lock_acquire(&self.state.drain.lock)    # against `withdraw`
                is_wanted = inbox_is_awaited(&self.state)
                lock_release(&self.state.drain.lock)
                while is_wanted and self.step():
                    pass
                lock_acquire(&self.state.drain.lock)
                inbox_wake_executors(&self.state)
                lock_release(&self.state.drain.lock)
                if self.state.engine != NULL:
                    self._ring.rest(watched, is_wanted)

    def await_round(self, *_):
        """Insert what there is, and have the thread insert what follows, because an executor is armed."""
        self.catch_up()

    def withdraw(self, Informed informed not None):
        """Undo :meth:`inform`. The middleware, which takes no lock, does not look at what this removes."""
        cdef InformedLink** link = &self.state.informed
        cdef InformedLink* found
        lock_acquire(&self.state.drain.lock)
        while link[0] != NULL and link[0].informed != <void*>informed:
            link = &link[0].next
        found = link[0]
        if found != NULL:
            link[0] = found.next
        lock_release(&self.state.drain.lock)
        free(found)
        self._used.discard(informed)
        informed.inboxes.discard(self)

    cdef int drain(self) except -1:
        cdef bint has_message = self._ring.has_message()
        if inbox_is_awaited(&self.state):       # with the GIL, as `withdraw`
            self._ring.nudge(False)
        return self.read_all() if has_message else 0

    cdef void refilled(self) noexcept:
        self._ring.nudge(True)
