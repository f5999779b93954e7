"""Serialised tf2_msgs/TFMessage and the structs of the engine."""

from libc.stddef cimport size_t
from libc.stdint cimport uint32_t

from tf2_py._core.types cimport Incoming


cdef struct Reader:
    const unsigned char* data       # the whole message, encapsulation header included
    size_t size                     # bytes
    size_t position                 # of the next byte to read
    bint swapped                    # the message's byte order is not this machine's
    const char* problem             # NULL, or what is wrong with the message at `position`


# Begins to read a message; on a bad header `problem` is set.
cdef void reader_init(Reader* reader, const unsigned char* data, size_t size) noexcept nogil
# How many transforms follow; bounded by what fits into the rest of the data.
cdef uint32_t reader_count(Reader* reader) noexcept nogil
# The next transform; its names point into the data. False, and `problem` set, where it is malformed.
cdef bint reader_transform(Reader* reader, Incoming* out) noexcept nogil
# False, and `problem` set, where bytes are left.
cdef bint reader_finish(Reader* reader) noexcept nogil


cdef struct Writer:
    unsigned char* data             # room for the whole message; NULL: only `position` is counted
    size_t position                 # where the next byte goes


# A message of `count` transforms begins; that many are to follow. In this machine's byte order, padded with
# zeros.
cdef void writer_init(Writer* writer, unsigned char* data, uint32_t count) noexcept nogil
cdef void writer_transform(Writer* writer, const Incoming* transform) noexcept nogil
