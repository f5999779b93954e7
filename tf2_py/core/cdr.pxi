# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Read and write transforms of a tf2_msgs/TFMessage in plain CDR, version 1 (OMG DDS-RTPS 2.5, clause 10)."""

cdef extern from *:
    uint32_t __builtin_bswap32(uint32_t value) nogil
    uint64_t __builtin_bswap64(uint64_t value) nogil

cdef enum:
    HEADER_SIZE = 4             # representation id, options, 2 bytes each; alignment counts from its end
    CDR_LE = 1                  # second byte of the representation id: little-endian, as this machine; else 0


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


cdef uint32_t reader_uint32(Reader* reader) noexcept nogil:
    return _uint32(reader)


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


cdef void reader_begin(Reader* reader, const unsigned char* data, size_t size) noexcept nogil:
    memset(reader, 0, sizeof(Reader))
    reader.data = data
    reader.size = size
    if size < HEADER_SIZE:
        reader.problem = "the data ends before its encapsulation header"
    elif data[0] != 0 or data[1] > 1:
        reader.problem = "the encapsulation header is not plain CDR"
    else:
        reader.position = HEADER_SIZE
        reader.swapped = data[1] != CDR_LE


cdef bint reader_transform(Reader* reader, Incoming* out) noexcept nogil:
    cdef int64_t sec = <int32_t>_uint32(reader)
    cdef int64_t nanosec = _uint32(reader)
    out.stamp_ns = stamp_join(sec, nanosec)
    _string(reader, &out.parent, &out.parent_size)
    _string(reader, &out.child, &out.child_size)
    _numbers_of(reader, &out.transform)
    return reader.problem == NULL


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


cdef void writer_begin(Writer* writer, unsigned char* out) noexcept nogil:
    writer.data = out
    writer.position = HEADER_SIZE
    if out != NULL:
        out[0] = out[2] = out[3] = 0
        out[1] = CDR_LE


cdef void writer_uint32(Writer* writer, uint32_t value) noexcept nogil:
    _write(writer, &value, 4, 4)


cdef void _write_string(Writer* writer, const char* text, size_t size) noexcept nogil:
    cdef unsigned char end = 0
    writer_uint32(writer, <uint32_t>(size + 1))
    _write(writer, text, size, 1)
    _write(writer, &end, 1, 1)


cdef void writer_transform(Writer* writer, const Incoming* transform) noexcept nogil:
    cdef int64_t whole
    cdef uint32_t nanosec
    cdef int32_t sec
    stamp_split(transform.stamp_ns, &whole, &nanosec)
    sec = <int32_t>whole
    _write(writer, &sec, 4, 4)
    writer_uint32(writer, nanosec)
    _write_string(writer, transform.parent, transform.parent_size)
    _write_string(writer, transform.child, transform.child_size)
    _write(writer, transform.transform.translation, 24, 8)
    _write(writer, transform.transform.rotation, 32, 8)
