"""Owns the memory of transforms between their source and the tree."""

from libc.stddef cimport size_t
from libc.stdint cimport uint32_t
from libc.stdlib cimport free, malloc, realloc

from tf2_py._wire.cdr cimport Reader, reader_count, reader_finish, reader_init, reader_transform

cdef enum:
    KEPT_ENTRIES = 1024     # their memory is kept for the next message


cdef void batch_free(Batch* batch) noexcept nogil:
    if batch.capacity:
        free(batch.entries)
    batch.entries = NULL
    batch.count = batch.capacity = 0


cdef void batch_begin(Batch* batch) noexcept nogil:
    batch.done = batch.taken = batch.refused = 0
    batch.waking = batch.no_memory = batch.needs_report = False
    batch.ready.first = batch.ready.last = NULL


cdef int batch_reserve(Batch* batch, size_t count) noexcept nogil:
    # Memory for one large message is not kept for the small ones that follow.
    if count <= batch.capacity and 0 < batch.capacity <= max(count, <size_t>KEPT_ENTRIES) + 1:
        return 0
    batch_free(batch)
    batch.entries = <Entry*>malloc((count + 1) * sizeof(Entry))
    if batch.entries == NULL:
        return -1
    batch.capacity = count + 1
    return 0


cdef int _make_room(Batch* batch, size_t more) noexcept nogil:
    # Keeps the entries in use. 0, or -1: no memory.
    cdef size_t capacity
    cdef Entry* entries
    if batch.count == 0:
        return batch_reserve(batch, more)
    if batch.count + more <= batch.capacity:
        return 0
    capacity = 2 * (batch.count + more)
    entries = <Entry*>realloc(batch.entries, capacity * sizeof(Entry))
    if entries == NULL:
        return -1
    batch.entries = entries
    batch.capacity = capacity
    return 0


cdef bint batch_read_cdr(Batch* batch, const unsigned char* data, size_t size) noexcept nogil:
    batch.count = 0
    return batch_add_cdr(batch, data, size)


cdef bint batch_add_cdr(Batch* batch, const unsigned char* data, size_t size) noexcept nogil:
    cdef Reader reader
    cdef uint32_t count, i
    batch.problem = NULL
    batch.no_memory = False
    reader_init(&reader, data, size)
    count = reader_count(&reader)
    if _make_room(batch, count) != 0:
        batch.no_memory = True
        return False
    for i in range(count):
        if not reader_transform(&reader, &batch.entries[batch.count + i].incoming):
            break
    if not reader_finish(&reader):
        batch.problem = reader.problem
        batch.problem_at = reader.position
        return False
    batch.count += count
    return True


cdef object batch_error(const Batch* batch, size_t size):
    return ValueError(
        f"malformed TFMessage: {batch.problem.decode()}, at byte {batch.problem_at} of {size}"
    )
