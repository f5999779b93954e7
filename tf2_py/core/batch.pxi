# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Batches of transforms, and TFMessage in plain CDR, version 1 (OMG DDS-RTPS 2.5, clause 10)."""

cdef extern from *:
    """
    #if __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__
    #define TF2_IS_LITTLE_ENDIAN 1
    #else
    #define TF2_IS_LITTLE_ENDIAN 0
    #endif
    """
    const int TF2_IS_LITTLE_ENDIAN
    uint32_t __builtin_bswap32(uint32_t value) nogil
    uint64_t __builtin_bswap64(uint64_t value) nogil

cdef enum:
    HEADER_SIZE = 4             # representation id, options, 2 bytes each; alignment counts from its end
    # No transform is shorter than a stamp, two empty names and seven doubles, with padding.
    SMALLEST_TRANSFORM = 72


cdef struct Reader:
    const unsigned char* data       # the whole message, including the encapsulation header
    size_t size                     # bytes of the message
    size_t position                 # of the next byte to read, from `data`
    bint swapped                    # the message's byte order is not this machine's
    const char* problem             # NULL, or what is wrong with the message at `position`


cdef inline const unsigned char* _read_bytes(Reader* reader, size_t size, size_t alignment) noexcept nogil:
    # Every byte is read through here. NULL: the data ends before `size` bytes, or there was a problem before.
    cdef size_t start = reader.position + (0 - (reader.position - HEADER_SIZE)) % alignment
    if reader.problem != NULL:
        return NULL
    if start > reader.size or reader.size - start < size:
        reader.problem = "the data ends too early"
        return NULL
    reader.position = start + size
    return reader.data + start


cdef inline uint32_t _uint32(Reader* reader) noexcept nogil:
    cdef uint32_t value = 0
    cdef const unsigned char* at = _read_bytes(reader, 4, 4)
    if at != NULL:
        memcpy(&value, at, 4)
    return __builtin_bswap32(value) if reader.swapped else value


cdef inline void _numbers_of(Reader* reader, Transform* out) noexcept nogil:
    cdef const unsigned char* at = _read_bytes(reader, sizeof(Transform), 8)
    cdef uint64_t words[7]
    cdef int i
    if at == NULL:
        return
    memcpy(words, at, sizeof(Transform))
    if reader.swapped:
        for i in range(7):
            words[i] = __builtin_bswap64(words[i])
    memcpy(out, words, sizeof(Transform))


cdef void _string(Reader* reader, const char** text, size_t* size) noexcept nogil:
    # The length includes the terminating NUL; some writers send an empty string as length 0. What follows an
    # earlier NUL does not count, because ROS's messages in C and Python end there.
    cdef size_t length = _uint32(reader)
    cdef const unsigned char* at = _read_bytes(reader, length, 1)
    text[0] = ""
    size[0] = 0
    if at == NULL or length == 0:
        return
    if at[length - 1] != 0:
        reader.problem = "a string without its terminating NUL"
        return
    length = strlen(<const char*>at)
    if not is_utf8(at, length):
        reader.problem = "a string that is not UTF-8"
    else:
        text[0] = <const char*>at
        size[0] = length


cdef void _begin_to_read(Reader* reader, const unsigned char* data, size_t size) noexcept nogil:
    memset(reader, 0, sizeof(Reader))
    reader.data = data
    reader.size = size
    if size < HEADER_SIZE:
        reader.problem = "the data ends before its encapsulation header"
    elif data[0] != 0 or data[1] > 1:
        reader.problem = "the encapsulation header is not plain CDR"
    else:
        reader.position = HEADER_SIZE
        reader.swapped = data[1] != TF2_IS_LITTLE_ENDIAN


cdef bint _read_transform(Reader* reader, Incoming* out) noexcept nogil:
    # Its names point into the data. False: it is malformed.
    cdef int64_t sec = <int32_t>_uint32(reader)
    cdef int64_t nanosec = _uint32(reader)
    out.stamp_ns = stamp_join(sec, nanosec)
    _string(reader, &out.parent, &out.parent_size)
    _string(reader, &out.child, &out.child_size)
    _numbers_of(reader, &out.transform)
    return reader.problem == NULL


cdef struct Writer:
    unsigned char* data             # memory for the whole message; NULL: bytes are only counted
    size_t position                 # of the next byte to write, from `data`


cdef inline unsigned char* _next_bytes(Writer* writer, size_t size, size_t alignment) noexcept nogil:
    # Every byte is written through here. Returns where the next `size` bytes belong; NULL: count them only.
    cdef size_t padding = (0 - (writer.position - HEADER_SIZE)) % alignment
    if writer.data != NULL:
        memset(writer.data + writer.position, 0, padding)
    writer.position += padding + size
    return NULL if writer.data == NULL else writer.data + writer.position - size


cdef inline void _write(Writer* writer, const void* value, size_t size, size_t alignment) noexcept nogil:
    cdef unsigned char* at = _next_bytes(writer, size, alignment)
    if at != NULL:
        memcpy(at, value, size)


cdef void _write_string(Writer* writer, const char* text, size_t size) noexcept nogil:
    cdef uint32_t length = <uint32_t>(size + 1)
    cdef unsigned char end = 0
    _write(writer, &length, 4, 4)
    _write(writer, text, size, 1)
    _write(writer, &end, 1, 1)


cdef void _write_transform(Writer* writer, const Incoming* transform) noexcept nogil:
    cdef int64_t whole
    cdef uint32_t nanosec
    cdef int32_t sec
    stamp_split(transform.stamp_ns, &whole, &nanosec)
    sec = <int32_t>whole
    _write(writer, &sec, 4, 4)
    _write(writer, &nanosec, 4, 4)
    _write_string(writer, transform.parent, transform.parent_size)
    _write_string(writer, transform.child, transform.child_size)
    _write(writer, transform.transform.translation, 24, 8)
    _write(writer, transform.transform.rotation, 32, 8)


# Keep transforms in memory between their source and the tree.

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
    batch.done = batch.taken = batch.refused = batch.unnormalised = 0
    batch.no_memory = batch.needs_report = False
    batch.in_1970_ns = 0
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
    _begin_to_read(&reader, data, size)
    count = _uint32(&reader)
    if reader.problem == NULL and count > (size - reader.position) // SMALLEST_TRANSFORM:
        reader.problem = "the number of transforms exceeds the data"
    if reader.problem != NULL:
        count = 0
    if _make_room(batch, count) != 0:
        batch.no_memory = True
        return False
    for i in range(count):
        if not _read_transform(&reader, &batch.entries[batch.count + i].incoming):
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
    # Returns the size in bytes; `out` NULL: it only counts. In this machine's byte order, padded with zeros.
    cdef Writer writer
    cdef uint32_t count = <uint32_t>batch.count
    cdef size_t i
    writer.data = out
    writer.position = HEADER_SIZE
    if out != NULL:
        out[0] = out[2] = out[3] = 0
        out[1] = TF2_IS_LITTLE_ENDIAN
    _write(&writer, &count, 4, 4)
    for i in range(batch.count):
        _write_transform(&writer, &batch.entries[i].incoming)
    return writer.position


cdef bytes batch_cdr(const Batch* batch):
    cdef bytes data = PyBytes_FromStringAndSize(NULL, _write_batch(batch, NULL))
    _write_batch(batch, <unsigned char*><char*>data)
    return data


cdef object batch_error(const Batch* batch, size_t size):
    return ValueError(
        f"malformed TFMessage: {batch.problem.decode()}, at byte {batch.problem_at} of {size}"
    )
