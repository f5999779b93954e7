"""Owns the wire format of TFMessage: CDR as in OMG DDS-RTPS 2.5, clause 10 (plain CDR, version 1)."""

from libc.stddef cimport size_t
from libc.stdint cimport int32_t, int64_t, uint32_t, uint64_t
from libc.string cimport memchr, memcpy, memset

from tf2_py._core.stamp cimport stamp_join, stamp_split
from tf2_py._core.types cimport Incoming
from tf2_py._core.utf8 cimport is_utf8

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
    # A stamp, two empty names and seven doubles, with padding: no transform is shorter.
    SMALLEST_TRANSFORM = 72


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


cdef inline void _doubles(Reader* reader, double* out, uint32_t count) noexcept nogil:
    cdef const unsigned char* at = _read_bytes(reader, 8 * <size_t>count, 8)
    cdef uint64_t word
    cdef uint32_t i
    if at == NULL:
        return
    memcpy(out, at, 8 * <size_t>count)
    if reader.swapped:
        for i in range(count):
            memcpy(&word, &out[i], 8)
            word = __builtin_bswap64(word)
            memcpy(&out[i], &word, 8)


cdef void _string(Reader* reader, const char** text, size_t* size) noexcept nogil:
    # The length counts the terminating NUL; some writers send an empty string as length 0.
    cdef size_t length = _uint32(reader)
    cdef const unsigned char* at = _read_bytes(reader, length, 1)
    text[0] = ""
    size[0] = 0
    if at == NULL or length == 0:
        return
    if at[length - 1] != 0:
        reader.problem = "a string without its terminating NUL"
    elif memchr(at, 0, length - 1) != NULL:
        reader.problem = "a string with a NUL inside"
    elif not is_utf8(at, length - 1):
        reader.problem = "a string that is not UTF-8"
    else:
        text[0] = <const char*>at
        size[0] = length - 1


cdef void reader_init(Reader* reader, const unsigned char* data, size_t size) noexcept nogil:
    reader.data = data
    reader.size = size
    reader.position = HEADER_SIZE
    reader.swapped = False
    reader.problem = NULL
    if size < HEADER_SIZE:
        reader.position = 0
        reader.problem = "the data ends before its encapsulation header"
    elif data[0] != 0 or data[1] > 1:
        reader.position = 0
        reader.problem = "the encapsulation header is not plain CDR"
    else:
        reader.swapped = data[1] != TF2_IS_LITTLE_ENDIAN


cdef uint32_t reader_count(Reader* reader) noexcept nogil:
    cdef uint32_t count = _uint32(reader)
    if reader.problem == NULL and count > (reader.size - reader.position) // SMALLEST_TRANSFORM:
        reader.problem = "more transforms are announced than the data can hold"
    return 0 if reader.problem != NULL else count


cdef bint reader_transform(Reader* reader, Incoming* out) noexcept nogil:
    cdef int64_t sec = <int32_t>_uint32(reader)
    cdef int64_t nanosec = _uint32(reader)
    out.stamp_ns = stamp_join(sec, nanosec)
    _string(reader, &out.parent, &out.parent_size)
    _string(reader, &out.child, &out.child_size)
    _doubles(reader, out.transform.translation, 3)
    _doubles(reader, out.transform.rotation, 4)
    return reader.problem == NULL


cdef bint reader_finish(Reader* reader) noexcept nogil:
    if reader.problem == NULL and reader.position != reader.size:
        reader.problem = "bytes are left behind the last transform"
    return reader.problem == NULL


cdef inline unsigned char* _next_bytes(Writer* writer, size_t size, size_t alignment) noexcept nogil:
    # Every byte is written through here: where the next `size` bytes belong. NULL: they are only counted.
    cdef size_t padding = (0 - (writer.position - HEADER_SIZE)) % alignment
    if writer.data != NULL:
        memset(writer.data + writer.position, 0, padding)
    writer.position += padding + size
    return NULL if writer.data == NULL else writer.data + writer.position - size


cdef inline void _put(Writer* writer, const void* value, size_t size, size_t alignment) noexcept nogil:
    cdef unsigned char* at = _next_bytes(writer, size, alignment)
    if at != NULL:
        memcpy(at, value, size)


cdef void _put_string(Writer* writer, const char* text, size_t size) noexcept nogil:
    cdef uint32_t length = <uint32_t>(size + 1)
    cdef unsigned char end = 0
    _put(writer, &length, 4, 4)
    _put(writer, text, size, 1)
    _put(writer, &end, 1, 1)


cdef void writer_init(Writer* writer, unsigned char* data, uint32_t count) noexcept nogil:
    writer.data = data
    writer.position = HEADER_SIZE
    if data != NULL:
        data[0] = data[2] = data[3] = 0
        data[1] = TF2_IS_LITTLE_ENDIAN
    _put(writer, &count, 4, 4)


cdef void writer_transform(Writer* writer, const Incoming* transform) noexcept nogil:
    cdef int64_t whole
    cdef uint32_t nanosec
    cdef int32_t sec
    stamp_split(transform.stamp_ns, &whole, &nanosec)
    sec = <int32_t>whole
    _put(writer, &sec, 4, 4)
    _put(writer, &nanosec, 4, 4)
    _put_string(writer, transform.parent, transform.parent_size)
    _put_string(writer, transform.child, transform.child_size)
    _put(writer, transform.transform.translation, 24, 8)
    _put(writer, transform.transform.rotation, 32, 8)
