# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The numbers of a sensor_msgs/PointField in memory: at any address, in either byte order."""

from libc.stdint cimport (
    INT32_MIN,
    INT64_MIN,
    int8_t,
    int16_t,
    int32_t,
    int64_t,
    uint8_t,
    uint16_t,
    uint32_t,
    uint64_t,
)
from libc.string cimport memcpy

cdef extern from *:
    uint16_t __builtin_bswap16(uint16_t bits) noexcept nogil
    uint32_t __builtin_bswap32(uint32_t bits) noexcept nogil
    uint64_t __builtin_bswap64(uint64_t bits) noexcept nogil


cdef enum Number:
    # The values of PointField.datatype, with OTHER_ORDER if the byte order is not that of this machine.
    INT8 = 1
    UINT8 = 2
    INT16 = 3
    UINT16 = 4
    INT32 = 5
    UINT32 = 6
    FLOAT32 = 7
    FLOAT64 = 8
    OTHER_ORDER = 16


cdef inline Py_ssize_t number_size(int number) noexcept nogil:
    # In bytes; 0 if it is not a number.
    number &= ~<int>OTHER_ORDER
    if number < INT8 or number > FLOAT64:
        return 0
    return 8 if number == FLOAT64 else 4 if number >= INT32 else 2 if number >= INT16 else 1


cdef inline uint64_t _bits(const char* place, int number) noexcept nogil:
    cdef uint8_t one
    cdef uint16_t two
    cdef uint32_t four
    cdef uint64_t eight
    cdef Py_ssize_t size = number_size(number)
    if size == 8:
        memcpy(&eight, place, 8)
        return __builtin_bswap64(eight) if number & OTHER_ORDER else eight
    if size == 4:
        memcpy(&four, place, 4)
        return __builtin_bswap32(four) if number & OTHER_ORDER else four
    if size == 2:
        memcpy(&two, place, 2)
        return __builtin_bswap16(two) if number & OTHER_ORDER else two
    memcpy(&one, place, 1)
    return one


cdef inline void _put_bits(char* place, int number, uint64_t bits) noexcept nogil:
    cdef uint8_t one = <uint8_t>bits
    cdef uint16_t two = <uint16_t>bits
    cdef uint32_t four = <uint32_t>bits
    cdef Py_ssize_t size = number_size(number)
    if size == 8:
        if number & OTHER_ORDER:
            bits = __builtin_bswap64(bits)
        memcpy(place, &bits, 8)
    elif size == 4:
        if number & OTHER_ORDER:
            four = __builtin_bswap32(four)
        memcpy(place, &four, 4)
    elif size == 2:
        if number & OTHER_ORDER:
            two = __builtin_bswap16(two)
        memcpy(place, &two, 2)
    else:
        memcpy(place, &one, 1)


cdef inline double number_load(const char* place, int number) noexcept nogil:
    cdef uint64_t bits = _bits(place, number)
    cdef uint32_t four = <uint32_t>bits
    cdef int kind = number & ~<int>OTHER_ORDER
    cdef float single
    cdef double value
    if kind == FLOAT32:
        memcpy(&single, &four, 4)
        return single
    if kind == FLOAT64:
        memcpy(&value, &bits, 8)
        return value
    if kind == INT32:
        return <int32_t>four
    if kind == INT16:
        return <int16_t>bits
    if kind == INT8:
        return <int8_t>bits
    return <double>bits


cdef inline int64_t _whole(double value, bint is_wide) noexcept nogil:
    # Rounded towards zero. Out of range, where C is undefined, as on x86, and so as NumPy there.
    if is_wide:
        return <int64_t>value if -9223372036854775808.0 <= value < 9223372036854775808.0 else INT64_MIN
    return <int64_t>value if -2147483649.0 < value < 2147483648.0 else INT32_MIN


cdef inline void number_store(char* place, int number, double value) noexcept nogil:
    cdef uint64_t bits = 0
    cdef uint32_t four
    cdef int kind = number & ~<int>OTHER_ORDER
    cdef float single = <float>value
    if kind == FLOAT32:
        memcpy(&four, &single, 4)
        bits = four
    elif kind == FLOAT64:
        memcpy(&bits, &value, 8)
    else:
        bits = <uint64_t>_whole(value, kind == UINT32)
    _put_bits(place, number, bits)
