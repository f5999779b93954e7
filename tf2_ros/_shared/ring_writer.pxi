"""The owner's half of a ring: append what arrives, drop what is old, keep the newest static transforms."""

# Uses: no chapter.

cdef enum:
    # Bytes of a serialized transform without its names, at most, and of what precedes the first one.
    MOST_OTHER = 2 * UNIT
    # Bytes that are kept free: for a record that is written again, and for what is not given back yet.
    RESERVE = MOST_RECORD + STEP
    COPY_SLICE = 512            # transforms that are copied before other threads may write

cdef int64_t MARGIN_NS = 2000000000             # for which records are kept beyond the cache time


cdef struct Writing:
    # What the owner needs. Guarded by `lock`, except for what is mapped.
    Lock lock
    ForkedLock forked
    int descriptor              # holds the lock on the file; -1: it has ended
    bint has_failed             # there was no memory, or no room: nothing is written any more
    Head* head
    uint64_t capacity
    uint64_t oldest             # positions, as in the head
    uint64_t next
    uint64_t given_back         # position up to which memory was given back
    Names children              # of static transforms
    uint64_t* statics           # positions of their newest records, by their ids; 0: there is none
    uint32_t statics_capacity
    int64_t keep_ns             # for how long records are kept
    int64_t room_ns             # for how long some were, at last, for lack of room; 0: always for `keep_ns`
    uint64_t too_long           # transforms whose names fit no record
    RingRecord* record          # with what follows it; MOST_RECORD bytes


cdef void _write(Writing* writing, uint32_t kind, uint32_t child, size_t size, size_t authority_size,
                 uint64_t previous, int64_t now_ns) noexcept nogil:
    # Adds a record, for which there is room. What follows it is behind `record`. `previous`: 0 if it is new.
    cdef RingRecord* record = writing.record
    cdef size_t written = sizeof(RingRecord) + size + authority_size
    record.position = writing.next
    record.previous = previous if previous else writing.next
    record.written_ns = now_ns
    record.kind, record.child = kind, child
    record.size, record.authority_size = <uint32_t>size, <uint32_t>authority_size
    if pwrite(writing.descriptor, record, written,
              place_of(record.position, writing.capacity)) != <ssize_t>written:
        writing.has_failed = True
        return
    writing.next += record_length(record)
    store64_release(&writing.head.next, writing.next)
    if child != NO_CHILD:
        writing.statics[child] = record.position


cdef bint _read_oldest(Writing* writing, RingRecord* record) noexcept nogil:
    # False: another process has written over it.
    cdef int64_t place = place_of(writing.oldest, writing.capacity)
    return (read_file(writing.descriptor, record, sizeof(RingRecord), place)
            and record.position == writing.oldest
            and record_length(record) <= min(writing.next - writing.oldest, <uint64_t>MOST_RECORD))


cdef void _write_again(Writing* writing, const RingRecord* oldest, int64_t now_ns) noexcept nogil:
    # The oldest record is the newest static transform of its child.
    if read_file(writing.descriptor, writing.record, record_length(oldest),
                 place_of(oldest.position, writing.capacity)):
        _write(writing, KIND_STATIC, oldest.child, oldest.size, oldest.authority_size, oldest.position,
               now_ns)
    else:
        writing.has_failed = True


cdef void _drop_until(Writing* writing, uint64_t position) noexcept nogil:
    writing.oldest = position
    store64_release(&writing.head.oldest, position)
    fence_seq_cst()     # before anything is written where readers may still read
    while writing.given_back + STEP <= position:
        give_back(writing.descriptor, place_of(writing.given_back, writing.capacity), STEP)
        writing.given_back += STEP


cdef bint _make_room(Writing* writing, uint64_t length, int64_t now_ns) noexcept nogil:
    # Drops what is too old, and more until a record fits behind the newest one. False: it cannot.
    cdef RingRecord oldest
    cdef uint64_t until = writing.next      # by then, only static transforms that were written again are left
    cdef bint fits
    if length > MOST_RECORD:
        return False
    while writing.oldest < writing.next and not writing.has_failed:
        fits = writing.next + length + RESERVE - writing.given_back <= writing.capacity
        if not _read_oldest(writing, &oldest):
            _drop_until(writing, writing.next)
        elif oldest.written_ns >= now_ns - writing.keep_ns and fits:
            break
        elif writing.oldest >= until:
            writing.has_failed = True
        else:
            # First this, then `oldest`: between the two, readers find it twice, and never not at all.
            if (oldest.kind == KIND_STATIC and oldest.child < writing.statics_capacity
                    and writing.statics[oldest.child] == oldest.position):
                _write_again(writing, &oldest, now_ns)
            elif (oldest.kind != KIND_STATIC
                    and oldest.written_ns > now_ns - (writing.keep_ns - MARGIN_NS)):
                writing.room_ns = now_ns - oldest.written_ns
                store64_release(&writing.head.room_ns, <uint64_t>writing.room_ns)
                store64_release(&writing.head.displaced, oldest.position + record_length(&oldest))
            _drop_until(writing, oldest.position + record_length(&oldest))
    return not writing.has_failed


cdef uint32_t _child_id(Writing* writing, const char* child, size_t size) noexcept nogil:
    # Of a static transform. NAME_NO_MEMORY: there is no memory.
    cdef uint32_t number = names_intern(&writing.children, child, size)
    cdef uint32_t capacity
    cdef void* memory
    if number != NAME_NO_MEMORY and number >= writing.statics_capacity:
        capacity = 2 * (number + 8)
        memory = realloc(writing.statics, capacity * sizeof(uint64_t))
        if memory == NULL:
            return NAME_NO_MEMORY
        writing.statics = <uint64_t*>memory
        memset(&writing.statics[writing.statics_capacity], 0,
               (capacity - writing.statics_capacity) * sizeof(uint64_t))
        writing.statics_capacity = capacity
    return number


cdef void _forget_static(Writing* writing, const char* child, size_t size) noexcept nogil:
    # Do not write the static transform of a child again, if there is one.
    cdef uint32_t number = names_find(&writing.children, child, size)
    if number < writing.statics_capacity:
        writing.statics[number] = 0


cdef void _append(
    Writing* writing, const Batch* batch, size_t start, size_t end, int64_t now_ns
) noexcept nogil:
    # Adds some transforms of a batch as one record, or as several if they are too large for one.
    cdef unsigned char* content = <unsigned char*>writing.record + sizeof(RingRecord)
    cdef uint64_t most = sizeof(RingRecord) + <uint64_t>batch.authority_size
    cdef Incoming clean
    cdef uint32_t child = NO_CHILD
    cdef size_t size, i
    for i in range(start, end):
        clean = batch.entries[i].incoming
        most += MOST_OTHER + <uint64_t>clean.parent_size + clean.child_size
    if most > MOST_RECORD and end - start > 1:
        i = (start + end) // 2
        _append(writing, batch, start, i, now_ns)
        _append(writing, batch, i, end, now_ns)
        return
    if most > MOST_RECORD:
        writing.too_long += 1
        return
    if batch.is_static and not incoming_refusals(&clean):
        child = _child_id(writing, clean.child, clean.child_size)
        if child == NAME_NO_MEMORY:
            writing.has_failed = True
            return
    if not _make_room(writing, most, now_ns):
        return
    size = batch_write_cdr(batch, start, end, content)
    memcpy(content + size, batch.authority, batch.authority_size)
    _write(writing, KIND_STATIC if batch.is_static else KIND_DYNAMIC, child, size, batch.authority_size, 0,
           now_ns)


cdef void _copy_slice(
    Writing* writing, const Batch* batch, size_t start, size_t end, int64_t now_ns
) noexcept nogil:
    # Also copies what this buffer refuses: readers refuse, count and log it, too.
    cdef Incoming clean
    cdef size_t i
    for i in range(start, end):
        clean = batch.entries[i].incoming
        if batch.is_static:
            _append(writing, batch, i, i + 1, now_ns)       # a record of its own
        elif writing.statics != NULL and not incoming_refusals(&clean):
            # A static transform that is written again would precede what is dynamic from now on.
            _forget_static(writing, clean.child, clean.child_size)
    if start < end and not batch.is_static:
        _append(writing, batch, start, end, now_ns)


cdef void _copy_removal(Writing* writing, const char* name, size_t size, int64_t now_ns) noexcept nogil:
    # With a name, of one frame; otherwise of all dynamic transforms.
    if name != NULL:
        _forget_static(writing, name, size)
    if not _make_room(writing, sizeof(RingRecord) + <uint64_t>size + UNIT, now_ns):
        return
    if name != NULL:
        memcpy(<char*>writing.record + sizeof(RingRecord), name, size)
    _write(writing, KIND_REMOVAL, NO_CHILD, size, 0, 0, now_ns)
    if name == NULL:
        store64_release(&writing.head.cleared, writing.next)


cdef void _share(Writing* writing, const Batch* batch, const char* name, size_t size) noexcept nogil:
    # Copies a batch or, if that is NULL, the removal of a name, and wakes the readers that sleep.
    cdef int64_t now_ns
    cdef size_t start = 0
    cdef size_t end
    cdef bint is_behind = True
    while is_behind:
        end = 0 if batch == NULL else min(start + COPY_SLICE, batch.count)
        lock_acquire(&writing.lock)
        if writing.descriptor >= 0 and not writing.has_failed:
            now_ns = monotonic_ns()
            if batch == NULL:
                _copy_removal(writing, name, size, now_ns)
            else:
                _copy_slice(writing, batch, start, end, now_ns)
            store_seq_cst(&writing.head.arrivals, writing.head.arrivals + 1)
            futex_wake(&writing.head.arrivals)
        lock_release(&writing.lock)
        start = end
        is_behind = batch != NULL and start < batch.count


cdef void _close(void* data) noexcept nogil:
    # Also in a forked child: the parent remains the owner, because its descriptor has the lock, too.
    cdef Writing* writing = <Writing*>data
    if writing.descriptor >= 0:
        close(writing.descriptor)
        writing.descriptor = -1


@cython.no_gc_clear
cdef class RingWriter(Tap):
    """
    Copies what a buffer receives, and what its program inserts, into a new file.

    :param descriptor: of the empty file, which holds its lock; it is closed with this object.
    :param size: how many bytes the file may have.
    :param buffer: whose cache time messages are kept, if there is memory for them.
    :raises OSError: there is no memory, or the process may not have a file of this size.
    """

    cdef Writing _writing

    def __cinit__(self, *_, **__):
        self._writing.descriptor = -1
        self._writing.record = <RingRecord*>malloc(MOST_RECORD)
        if self._writing.record == NULL or lock_init(
                &self._writing.lock) != 0 or names_init(&self._writing.children) != 0:
            raise MemoryError
        self._writing.forked.in_child = _close
        self._writing.forked.owner = <void*>&self._writing
        fork_watch(&self._writing.forked, &self._writing.lock)

    def __init__(self, int descriptor, uint64_t size, Engine buffer not None):
        cdef Writing* writing = &self._writing
        size -= size % STEP
        writing.descriptor = descriptor
        writing.keep_ns = min(<int64_t>buffer.cache_time_ns, (<int64_t>1 << 62) - MARGIN_NS) + MARGIN_NS
        os.ftruncate(descriptor, size)
        os.pwrite(descriptor, bytes(MAPPED_BYTES), 0)     # memory for what is mapped
        writing.head = map_head(descriptor)
        writing.capacity = writing.head.capacity = size - OTHER_BYTES
        # Positions begin here, so that 0 is none.
        writing.oldest = writing.next = writing.given_back = writing.capacity
        writing.head.oldest = writing.head.next = writing.capacity
        writing.head.layout = LAYOUT
        writing.head.magic = MAGIC
        buffer._tap = self

    def __dealloc__(self):
        _close(&self._writing)
        if self._writing.head != NULL:
            munmap(self._writing.head, MAPPED_BYTES)
        fork_forget(&self._writing.forked)
        names_free(&self._writing.children)
        free(self._writing.statics)
        free(self._writing.record)
        lock_free(&self._writing.lock)

    def write(self, bytes data not None, int64_t position):
        """Write into the file outside the ring, unless sharing has ended."""
        cdef Writing* writing = &self._writing
        lock_acquire(&writing.lock)
        if writing.descriptor >= 0 and pwrite(
                writing.descriptor, <const char*>data, len(data), position) != len(data):
            writing.has_failed = True
        lock_release(&writing.lock)

    def close(self):
        """End sharing."""
        lock_acquire(&self._writing.lock)
        _close(&self._writing)
        lock_release(&self._writing.lock)

    @property
    def descriptor(self):
        """Of the file; -1 after the end, and in a forked child."""
        return self._writing.descriptor

    @property
    def has_failed(self):
        """Whether it has stopped sharing for lack of memory."""
        return self._writing.has_failed

    @property
    def room_s(self):
        """For how long it kept messages when it last had no room for its cache time; 0: it always had."""
        return self._writing.room_ns / 1e9

    @property
    def too_long(self):
        """How many transforms have names that are too long to be shared."""
        return self._writing.too_long

    cdef void copy(self, const Batch* batch) noexcept nogil:
        _share(&self._writing, batch, NULL, 0)

    cdef void removed(self, const char* name, size_t size) noexcept:
        _share(&self._writing, NULL, name, size)

    cdef bint is_wanted(self) noexcept nogil:
        # A reader may have written anything there.
        cdef int64_t left_ns = <int64_t>(
            load64_acquire(&self._writing.head.wanted_until_ns) - <uint64_t>monotonic_ns())
        return 0 < left_ns <= WANTED_NS
