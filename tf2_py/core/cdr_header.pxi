# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Read and write the transforms of a serialized tf2_msgs/TFMessage, one after the other."""

cdef enum:
    # No transform is shorter than a stamp, two empty names and seven doubles, with padding.
    SMALLEST_TRANSFORM = 72


cdef struct Reader:
    const unsigned char* data       # the whole message, including the encapsulation header
    size_t size                     # bytes of the message
    size_t position                 # of the next byte to read, from `data`
    bint swapped                    # the message's byte order is not this machine's
    const char* problem             # NULL, or what is wrong with the message at `position`


cdef struct Writer:
    unsigned char* data             # memory for the whole message; NULL: bytes are only counted
    size_t position                 # of the next byte to write, from `data`


# Reading. After the first problem, nothing more is read.
cdef void reader_begin(Reader* reader, const unsigned char* data, size_t size) noexcept nogil
cdef uint32_t reader_uint32(Reader* reader) noexcept nogil
# Its names point into the data. False: it is malformed, see `problem`.
cdef bint reader_transform(Reader* reader, Incoming* out) noexcept nogil

# Writing, in this machine's byte order, padded with zeros. `out` NULL: the bytes are only counted.
cdef void writer_begin(Writer* writer, unsigned char* out) noexcept nogil
cdef void writer_uint32(Writer* writer, uint32_t value) noexcept nogil
cdef void writer_transform(Writer* writer, const Incoming* transform) noexcept nogil
