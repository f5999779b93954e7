"""Which bytes are a text."""

from libc.stddef cimport size_t


cdef inline bint is_utf8(const unsigned char* text, size_t size) noexcept nogil:
    # Well-formed UTF-8 as in table 3-7 of the Unicode standard: no overlong forms, no surrogates.
    cdef size_t i = 0
    cdef size_t follow, k
    cdef unsigned char first, low, high
    while i < size:
        first = text[i]
        i += 1
        if first < 0x80:
            continue
        low = 0x80
        high = 0xBF
        if 0xC2 <= first <= 0xDF:
            follow = 1
        elif 0xE0 <= first <= 0xEF:
            follow = 2
            if first == 0xE0:
                low = 0xA0
            elif first == 0xED:
                high = 0x9F
        elif 0xF0 <= first <= 0xF4:
            follow = 3
            if first == 0xF0:
                low = 0x90
            elif first == 0xF4:
                high = 0x8F
        else:
            return False
        if size - i < follow or not low <= text[i] <= high:
            return False
        for k in range(1, follow):
            if not 0x80 <= text[i + k] <= 0xBF:
                return False
        i += follow
    return True
