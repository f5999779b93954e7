"""The owner's half of a ring: append what arrives, drop what is old, keep the newest static transforms."""

cdef enum:
    BATCH_ENTRIES = 64          # dynamic transforms in a record of what a program inserts
    # Bytes that are kept free for one record that is written again, and the padding before it.
    RESERVE = 2 * MOST_RECORD
    LIVE_PART = 4               # the newest static transforms may take this part of the ring

cdef int64_t MARGIN_NS = 2000000000             # for which records are kept beyond the cache time


cdef struct Static:
    uint64_t position           # of the child's newest record
    uint64_t length             # of that; 0: there is none


cdef struct Writing:
    # What the owner needs. Guarded by `lock`, except for what is mapped.
    Lock lock
    ForkedLock forked
    int descriptor              # -1: it has ended
    int lock_descriptor         # holds the lock on the file
    Head* head
    uint64_t capacity
    uint64_t oldest             # positions, as in the head
    uint64_t next
    uint64_t committed          # position up to which there is memory
    uint64_t given_back         # position up to which memory was given back
    Names children              # of static transforms
    Static* statics             # by their ids
    uint32_t statics_capacity
    uint64_t live               # bytes of the newest static records
    int64_t keep_ns             # for how long records are kept
    unsigned char* scratch      # for what follows a record; MOST_RECORD bytes


cdef uint64_t _gap_before(const Writing* writing, uint64_t length) noexcept nogil:
    # Bytes to the end of the file, if a record of this length does not fit there.
    cdef uint64_t left = writing.capacity - writing.next % writing.capacity
    return left if length > left else 0


cdef bint _write(Writing* writing, Record* record, const void* authority, const void* message,
                 int64_t now_ns) noexcept nogil:
    # Adds a record, whose kind, child and sizes are set. False: there is no memory for it.
    cdef Record padding
    cdef uint64_t length = record_length(record)
    cdef uint64_t gap = _gap_before(writing, length)
    cdef uint64_t end = writing.next + gap + length
    if length > MOST_RECORD or end > writing.committed or end - writing.oldest > writing.capacity:
        return False
    record.written_ns = now_ns
    if gap:
        memset(&padding, 0, sizeof(Record))
        padding.position = writing.next
        padding.written_ns = now_ns
        padding.kind = KIND_PADDING
        padding.size = <uint32_t>(gap - sizeof(Record))
        if write_file(writing.descriptor, &padding, sizeof(Record), NULL, 0, NULL, 0,
                      RING_AT + writing.next % writing.capacity) != 0:
            return False
    record.position = writing.next + gap
    if record.previous == 0:
        record.previous = record.position
    if write_file(writing.descriptor, record, sizeof(Record), authority, record.authority_size, message,
                  record.size, RING_AT + record.position % writing.capacity) != 0:
        return False
    writing.next = end
    store64(&writing.head.next, end)
    return True


cdef bint _read_oldest(Writing* writing, Record* record) noexcept nogil:
    # False: another process has written over it.
    return (read_file(writing.descriptor, record, sizeof(Record),
                      RING_AT + writing.oldest % writing.capacity) == 0
            and record.position == writing.oldest
            and record_length(record) <= min(writing.next - writing.oldest, <uint64_t>MOST_RECORD))


cdef bint _commit(Writing* writing, uint64_t end) noexcept nogil:
    # Have memory up to this position, not counting what still has to be given back; False: there is none.
    while writing.committed < end:
        if writing.committed + STEP - writing.given_back > writing.capacity:
            return False
        if commit_file(writing.descriptor, RING_AT + writing.committed % writing.capacity, STEP) != 0:
            return False
        writing.committed += STEP
    return True


cdef bint _write_again(Writing* writing, Record* record, int64_t now_ns) noexcept nogil:
    # The oldest record is the newest static transform of its child. False: there is no memory for it.
    cdef size_t size = <size_t>record.authority_size + record.size
    cdef uint64_t length = record_length(record)
    if read_file(writing.descriptor, writing.scratch, size,
                 RING_AT + record.position % writing.capacity + sizeof(Record)) != 0:
        return False
    # Where there is no more memory, the reserve is used up.
    _commit(writing, writing.next + _gap_before(writing, length) + length + RESERVE)
    record.previous = record.position
    if not _write(writing, record, writing.scratch, writing.scratch + record.authority_size, now_ns):
        return False
    writing.statics[record.child].position = record.position
    return True


cdef void _forget_static(Writing* writing, uint32_t child) noexcept nogil:
    # Do not write it again.
    writing.live -= writing.statics[child].length
    writing.statics[child].position = writing.statics[child].length = 0


cdef void _forget_static_of(Writing* writing, const char* child, size_t size) noexcept nogil:
    # The same by name, without a leading '/'; without effect if the child has no static transform.
    cdef uint32_t number = names_find(&writing.children, child, size)
    if number < writing.statics_capacity and writing.statics[number].length:
        _forget_static(writing, number)


cdef void _count_missing(Writing* writing) noexcept nogil:
    store64(&writing.head.missing, writing.head.missing + 1)


cdef int64_t _drop_oldest(Writing* writing, int64_t now_ns) noexcept nogil:
    # Returns when it was written.
    cdef Record record
    cdef int64_t written_ns = 0
    cdef uint64_t oldest = writing.next
    if _read_oldest(writing, &record):
        written_ns = record.written_ns
        oldest = record.position + record_length(&record)
        # First this, then `oldest`: between the two, readers find it twice, and never not at all.
        if (record.kind == KIND_STATIC and record.child < writing.statics_capacity
                and writing.statics[record.child].position == record.position
                and not _write_again(writing, &record, now_ns)):
            _forget_static(writing, record.child)
            _count_missing(writing)
    writing.oldest = oldest
    store64(&writing.head.oldest, oldest)
    fence()     # before anything is written where readers may still read
    while writing.given_back + STEP <= oldest:
        give_back(writing.descriptor, RING_AT + writing.given_back % writing.capacity, STEP)
        writing.given_back += STEP
    return written_ns


cdef void _drop_old(Writing* writing, int64_t now_ns) noexcept nogil:
    cdef Record record
    while writing.oldest < writing.next:
        if _read_oldest(writing, &record) and record.written_ns >= now_ns - writing.keep_ns:
            return
        _drop_oldest(writing, now_ns)
        store64(&writing.head.short_ns, 0)


cdef bint _make_room(Writing* writing, uint64_t length, int64_t now_ns) noexcept nogil:
    # Memory for a record behind the newest one; False: there is none.
    cdef uint64_t until = writing.next      # by then, only static transforms that were written again are left
    cdef uint64_t end
    cdef int64_t written_ns
    while length <= MOST_RECORD:
        end = writing.next + _gap_before(writing, length) + length + RESERVE
        # Two steps less than all, so that what is given back does not hold the newest record.
        if end - writing.oldest <= writing.capacity - 2 * STEP and _commit(writing, end):
            return True
        if writing.oldest >= until:
            return False
        written_ns = _drop_oldest(writing, now_ns)
        if written_ns > now_ns - writing.keep_ns:
            store64(&writing.head.short_ns, max(now_ns - written_ns, <int64_t>1))
    return False


cdef bint _append(Writing* writing, Record* record, const Batch* batch, size_t start, size_t end,
                  const void* message, int64_t now_ns) noexcept nogil:
    # With `message` NULL, these transforms of the batch are serialised.
    if not _make_room(writing, record_length(record), now_ns):
        return False
    if message == NULL:
        batch_write_cdr(batch, start, end, writing.scratch)
        message = writing.scratch
    return _write(writing, record, batch.authority, message, now_ns)


cdef uint32_t _child_id(Writing* writing, const Incoming* transform) noexcept nogil:
    # NAME_NO_MEMORY: there is no memory.
    cdef const char* child = transform.child
    cdef size_t size = transform.child_size
    cdef uint32_t number, capacity
    cdef void* memory
    name_strip(&child, &size)
    number = names_intern(&writing.children, child, size)
    if number != NAME_NO_MEMORY and number >= writing.statics_capacity:
        capacity = 2 * (number + 8)
        memory = realloc(writing.statics, capacity * sizeof(Static))
        if memory == NULL:
            return NAME_NO_MEMORY
        writing.statics = <Static*>memory
        memset(&writing.statics[writing.statics_capacity], 0,
               (capacity - writing.statics_capacity) * sizeof(Static))
        writing.statics_capacity = capacity
    return number


cdef bint _append_static(Writing* writing, Record* record, const Batch* batch, size_t number,
                         int64_t now_ns) noexcept nogil:
    cdef uint64_t length = record_length(record)
    cdef uint64_t live
    cdef Static* static
    record.child = NO_CHILD
    if incoming_refusals(&batch.entries[number].incoming):
        return _append(writing, record, batch, number, number + 1, NULL, now_ns)
    record.child = _child_id(writing, &batch.entries[number].incoming)
    if record.child == NAME_NO_MEMORY:
        return False
    live = writing.live - writing.statics[record.child].length + length
    if live > writing.capacity // LIVE_PART:
        return False
    if not _append(writing, record, batch, number, number + 1, NULL, now_ns):
        return False
    static = &writing.statics[record.child]
    writing.live += length - static.length
    static.position, static.length = record.position, length
    return True


cdef void _forget_statics(Writing* writing, const Batch* batch) noexcept nogil:
    # Of children that are dynamic from now on: a static transform that is written again would precede them.
    cdef const char* child
    cdef size_t size, i
    for i in range(batch.count):
        if incoming_refusals(&batch.entries[i].incoming):
            continue
        child, size = batch.entries[i].incoming.child, batch.entries[i].incoming.child_size
        name_strip(&child, &size)
        _forget_static_of(writing, child, size)


cdef bint _copy_batch(Writing* writing, const Batch* batch, const void* message, size_t size,
                      int64_t now_ns) noexcept nogil:
    # With `message`, which may be NULL, its bytes are copied. Also copies what this buffer refuses: readers
    # refuse, count and log it, too.
    cdef Record record
    cdef bint is_kept = True
    cdef size_t start = 0
    cdef size_t end = 0
    cdef size_t most = BATCH_ENTRIES
    if batch.is_static:
        most, message = 1, NULL
    else:
        if writing.live:
            _forget_statics(writing, batch)
        if message != NULL:
            most = batch.count
    while end < batch.count:
        start, end = end, min(end + most, batch.count)
        memset(&record, 0, sizeof(Record))
        record.kind = KIND_STATIC if batch.is_static else KIND_DYNAMIC
        record.authority_size = <uint32_t>batch.authority_size
        record.size = <uint32_t>(size if message != NULL else batch_write_cdr(batch, start, end, NULL))
        if batch.is_static:
            is_kept = _append_static(writing, &record, batch, start, now_ns) and is_kept
        else:
            is_kept = _append(writing, &record, batch, start, end, message, now_ns) and is_kept
    return is_kept


cdef bint _copy_removal(Writing* writing, const char* name, size_t size, int64_t now_ns) noexcept nogil:
    cdef Record record
    memset(&record, 0, sizeof(Record))
    record.kind = KIND_REMOVAL
    record.size = <uint32_t>size
    if name != NULL:
        _forget_static_of(writing, name, size)
    if not _make_room(writing, record_length(&record), now_ns) or not _write(
            writing, &record, NULL, name, now_ns):
        return False
    if name == NULL:
        store64(&writing.head.cleared, writing.next)
    return True


cdef void _share(Writing* writing, const Batch* batch, const void* message, size_t size) noexcept nogil:
    # Copies a batch or, if `batch` is NULL, a removal, of which `message` is the name. Wakes the readers that
    # sleep.
    cdef int64_t now_ns
    cdef bint is_kept
    lock_acquire(&writing.lock)
    if writing.descriptor >= 0:
        now_ns = monotonic_ns()
        _drop_old(writing, now_ns)
        if batch == NULL:
            is_kept = _copy_removal(writing, <const char*>message, size, now_ns)
        else:
            is_kept = _copy_batch(writing, batch, message, size, now_ns)
        if not is_kept:
            _count_missing(writing)
        word_store(&writing.head.arrivals, writing.head.arrivals + 1)
        if word_exchange(&board_of(writing.head).sleeps, 0):
            futex_wake(&writing.head.arrivals)
    lock_release(&writing.lock)


cdef void _copy(Copier* copier, const Parcel* parcel) noexcept nogil:
    cdef bint is_whole = not parcel.batch.is_prefixed and parcel.size < STEP
    _share(<Writing*>copier.data, &parcel.batch, parcel.data if is_whole else NULL, parcel.size)


cdef bint _is_wanted(Copier* copier) noexcept nogil:
    # A reader may have written anything there.
    cdef int64_t left_ns = <int64_t>(
        load64(&board_of((<Writing*>copier.data).head).wanted_until_ns) - <uint64_t>monotonic_ns())
    return 0 < left_ns <= WANTED_NS


cdef void _end_in_child(void* owner) noexcept nogil:
    # The parent remains the owner. The kernel releases the file's lock with the last descriptor.
    cdef Writing* writing = <Writing*>owner
    if writing.descriptor >= 0:
        close_file(writing.descriptor)
        close_file(writing.lock_descriptor)
        writing.descriptor = writing.lock_descriptor = -1


@cython.no_gc_clear
cdef class RingWriter(Copying):
    """
    Copies what a buffer receives, and what its program inserts, into a new file.

    :param descriptor: of the empty file; it is closed with this object.
    :param lock_descriptor: another descriptor of the file, which holds the lock; closed in the same way.
    :param size: how many bytes the file may have.
    :param keep_ns: how long messages are kept, in nanoseconds, if there is memory for them.
    :raises OSError: there is no memory, or the process may not have a file of this size.
    """

    cdef Writing _writing

    def __cinit__(self, *_, **__):
        self._writing.descriptor = self._writing.lock_descriptor = -1
        self._writing.scratch = <unsigned char*>malloc(MOST_RECORD)
        if self._writing.scratch == NULL or lock_init(
                &self._writing.lock) != 0 or names_init(&self._writing.children) != 0:
            raise MemoryError
        self._writing.forked.in_child = _end_in_child
        self._writing.forked.owner = <void*>&self._writing
        fork_watch(&self._writing.forked, &self._writing.lock)
        self.copier.data = &self._writing
        self.copier.copy = _copy
        self.copier.is_wanted = _is_wanted

    def __init__(self, int descriptor, int lock_descriptor, uint64_t size, int64_t keep_ns):
        cdef Writing* writing = &self._writing
        writing.descriptor, writing.lock_descriptor = descriptor, lock_descriptor
        writing.keep_ns = min(keep_ns, (<int64_t>1 << 62) - MARGIN_NS) + MARGIN_NS
        os.ftruncate(descriptor, size // STEP * STEP)
        if commit_file(descriptor, 0, RING_AT) != 0:
            raise OSError(errors.ENOSPC, os.strerror(errors.ENOSPC))
        writing.head = map_head(descriptor)
        writing.capacity = writing.head.capacity = size // STEP * STEP - RING_AT
        # Positions begin here, so that 0 is none.
        writing.oldest = writing.next = writing.committed = writing.given_back = writing.capacity
        writing.head.oldest = writing.head.next = writing.capacity
        writing.head.layout = LAYOUT
        writing.head.magic = MAGIC

    def __dealloc__(self):
        self._end()
        unmap_file(self._writing.head)
        fork_forget(&self._writing.forked)
        names_free(&self._writing.children)
        free(self._writing.statics)
        free(self._writing.scratch)
        lock_free(&self._writing.lock)

    cdef void _end(self) noexcept:
        lock_acquire(&self._writing.lock)
        if self._writing.descriptor >= 0:
            close_file(self._writing.descriptor)
            close_file(self._writing.lock_descriptor)
            self._writing.descriptor = self._writing.lock_descriptor = -1
        lock_release(&self._writing.lock)

    def tap(self, Engine buffer not None):
        """Copy from now on what the program inserts into this buffer, and what its listeners receive."""
        buffer._tap = self

    def describe(self, bytes text not None):
        """Publish a description of the owner, at most 4 kB."""
        if self._writing.descriptor >= 0:
            os.pwrite(
                self._writing.descriptor, struct.pack("=II", len(text), zlib.crc32(text)) + text, TEXT_AT)

    def close(self):
        """End sharing."""
        self._end()

    @property
    def is_open(self):
        """Whether this process still shares the buffer; false in a forked child."""
        return self._writing.descriptor >= 0

    @property
    def shortage(self):
        """See ``shortage_of``."""
        return shortage_of(self._writing.head)

    cdef void inserting(self, const Batch* batch) noexcept:
        _share(&self._writing, batch, NULL, 0)

    cdef void removed(self, const char* name, size_t size) noexcept:
        _share(&self._writing, NULL, name, size)
