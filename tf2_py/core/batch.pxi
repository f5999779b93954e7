# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Batches of transforms in memory, and the serialized TFMessages that they are read from and written to."""

cdef enum:
    KEPT_ENTRIES = 1024     # the memory of up to this many is kept for the next message


cdef void batch_free(Batch* batch) noexcept nogil:
    if batch.capacity:
        free(batch.entries)
    free(batch.names)
    batch.entries = NULL
    batch.names = NULL
    batch.count = batch.capacity = batch.names_capacity = 0


cdef void batch_begin(Batch* batch) noexcept nogil:
    batch.done = batch.taken = batch.refused = batch.unnormalized = 0
    batch.no_memory = batch.needs_report = False
    batch.in_1970_ns = 0
    batch.displaced = 0
    batch.problem = NULL
    links_init(&batch.ready)


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


cdef bytes unchanging_bytes(data):
    cdef Py_buffer view
    if type(data) is bytes:
        return data
    PyObject_GetBuffer(data, &view, PyBUF_SIMPLE)
    try:
        return PyBytes_FromStringAndSize(<const char*>view.buf, view.len)
    finally:
        PyBuffer_Release(&view)


cdef bint batch_read_cdr(Batch* batch, const unsigned char* data, size_t size) noexcept nogil:
    batch.count = 0
    return batch_add_cdr(batch, data, size)


cdef bint batch_add_cdr(Batch* batch, const unsigned char* data, size_t size) noexcept nogil:
    cdef Reader reader
    cdef uint32_t count, i
    batch.problem = NULL
    batch.no_memory = False
    reader_begin(&reader, data, size)
    count = reader_uint32(&reader)
    if reader.problem == NULL and count > (size - reader.position) // SMALLEST_TRANSFORM:
        reader.problem = "the number of transforms exceeds the data"
    if reader.problem != NULL:
        count = 0
    if _make_room(batch, count) != 0:
        batch.no_memory = True
        return False
    for i in range(count):
        if not reader_transform(&reader, &batch.entries[batch.count + i].incoming):
            break
    if reader.problem == NULL and reader.position != size:
        reader.problem = "extra bytes follow the last transform"
    if reader.problem != NULL:
        batch.problem = reader.problem
        batch.problem_at = reader.position
        return False
    batch.count += count
    return True


cdef char* _prefixed(const char** name, size_t* size, const char* prefix, size_t prefix_size,
                     char* out) noexcept nogil:
    name_strip(name, size)
    if size[0] == 0:
        return out
    memcpy(out, prefix, prefix_size)
    memcpy(out + prefix_size, name[0], size[0])
    name[0] = out
    size[0] += prefix_size
    return out + size[0]


cdef bint batch_prefix(Batch* batch, const char* prefix, size_t prefix_size) noexcept nogil:
    cdef Incoming* incoming
    cdef size_t needed = 0
    cdef size_t i
    cdef char* out
    for i in range(batch.count):
        incoming = &batch.entries[i].incoming
        needed += incoming.parent_size + incoming.child_size + 2 * prefix_size
    if needed > batch.names_capacity:
        free(batch.names)
        batch.names = <char*>malloc(needed)
        batch.names_capacity = needed if batch.names != NULL else 0
    if needed > batch.names_capacity:
        batch.count = 0
        batch.no_memory = True
        return False
    out = batch.names
    for i in range(batch.count):
        incoming = &batch.entries[i].incoming
        out = _prefixed(&incoming.parent, &incoming.parent_size, prefix, prefix_size, out)
        out = _prefixed(&incoming.child, &incoming.child_size, prefix, prefix_size, out)
    return True


cdef size_t _write_batch(const Batch* batch, unsigned char* out) noexcept nogil:
    # Returns the size in bytes; `out` NULL: it only counts.
    cdef Writer writer
    cdef size_t i
    writer_begin(&writer, out)
    writer_uint32(&writer, <uint32_t>batch.count)
    for i in range(batch.count):
        writer_transform(&writer, &batch.entries[i].incoming)
    return writer.position


cdef bytes batch_cdr(const Batch* batch):
    cdef bytes data = PyBytes_FromStringAndSize(NULL, _write_batch(batch, NULL))
    _write_batch(batch, <unsigned char*><char*>data)
    return data


cdef object batch_error(const Batch* batch, size_t size):
    return ValueError(
        f"malformed TFMessage: {batch.problem.decode()}, at byte {batch.problem_at} of {size}"
    )
