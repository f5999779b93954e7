"""Reading and writing serialised tf2_msgs/TFMessage."""

from libc.stddef cimport size_t
from libc.stdint cimport uint32_t

from tf2_py._core.types cimport Incoming


cdef struct Reader:
    const unsigned char* data       # the whole message, including the encapsulation header
    size_t size                     # bytes of the message
    size_t position                 # of the next byte to read, from `data`
    bint swapped                    # the message's byte order is not this machine's
    const char* problem             # NULL, or what is wrong with the message at `position`


# Begins to read a message, which must outlive the reader. On a bad header `problem` is set.
cdef void reader_init(Reader* reader, const unsigned char* data, size_t size) noexcept nogil
# How many transforms follow: no more than fit into the rest of the data. 0, and `problem` set: that is
# malformed.
cdef uint32_t reader_count(Reader* reader) noexcept nogil
# The next transform; its names point into the data. False, and `problem` set: it is malformed.
cdef bint reader_transform(Reader* reader, Incoming* out) noexcept nogil
# False, and `problem` set: bytes are left.
cdef bint reader_finish(Reader* reader) noexcept nogil


cdef struct Writer:
    unsigned char* data             # memory for the whole message; NULL: bytes are only counted
    size_t position                 # of the next byte to write, from `data`


# Begins a message of `count` transforms, all of which must follow. In this machine's byte order, padded with
# zeros.
cdef void writer_init(Writer* writer, unsigned char* data, uint32_t count) noexcept nogil
cdef void writer_transform(Writer* writer, const Incoming* transform) noexcept nogil
