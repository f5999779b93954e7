# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A table of names: UTF-8 bytes to small ids and back, usable without the GIL."""

cdef struct Name:
    size_t start            # offset of its first byte in `text`
    uint32_t size           # bytes
    uint32_t hash           # the lower 32 bits of its name_hash


cdef struct Names:
    char* text              # every name, one after the other, not terminated
    size_t text_size        # bytes in use
    size_t text_capacity    # bytes allocated
    Name* names             # by id
    uint32_t count          # ids in use: 0 .. count - 1
    uint32_t capacity       # ids allocated
    uint32_t* slots         # hash table of id + 1; 0: free; open addressing, linear probing
    uint32_t slot_mask      # slots allocated - 1; their number is a power of two
    size_t bytes            # memory allocated, for statistics


cdef enum:
    # No ids.
    NAME_UNKNOWN = 0xFFFFFFFF
    NAME_NO_MEMORY = 0xFFFFFFFE


cdef inline bint name_is_invalid(const char* text, size_t size) noexcept nogil:
    # Empty, or beginning with '/': every lookup refuses such a name. Inserting removes the '/' first.
    return size == 0 or text[0] == b"/"


cdef inline void name_strip(const char** text, size_t* size) noexcept nogil:
    # Without one leading '/', as tf2 stores names.
    if size[0] and text[0][0] == b"/":
        text[0] += 1
        size[0] -= 1


# As Python hashes bytes: with a secret of this process, so that nobody can choose names that collide.
cdef uint64_t name_hash(const char* text, size_t size) noexcept nogil

# Zero a Names before names_init; after a failed names_init, names_free is still due.
cdef int names_init(Names* names) noexcept nogil                                    # 0, or -1: no memory
cdef void names_free(Names* names) noexcept nogil
# NAME_UNKNOWN: there is no such name.
cdef uint32_t names_find(const Names* names, const char* text, size_t size) noexcept nogil
# The same, without hashing the name if `guess`, any number, is its id.
cdef uint32_t names_find_guessed(const Names* names, const char* text, size_t size,
                                 uint32_t guess) noexcept nogil
# The id of the name, a new one if it is unknown. NAME_NO_MEMORY: there is no memory for it, or no free id.
# By how many bytes the memory grows if another name is added.
cdef size_t names_growth(const Names* names, size_t size) noexcept nogil
cdef uint32_t names_intern(Names* names, const char* text, size_t size) noexcept nogil
# Forgets the names interned last, until `count` are left. Their memory is kept for the next ones.
cdef void names_drop(Names* names, uint32_t count) noexcept nogil
cdef const char* names_check(const Names* names) noexcept nogil     # NULL, or which invariant does not hold


# Which bytes are a text.

cdef extern from *:
    """
    #define TF2_HIGH_BITS 0x8080808080808080ULL
    """
    const uint64_t HIGH_BITS "TF2_HIGH_BITS"


cdef inline bint is_utf8(const unsigned char* text, size_t size) noexcept nogil:
    # Well-formed UTF-8 as in table 3-7 of the Unicode standard: no overlong forms, no surrogates.
    cdef size_t i = 0
    cdef size_t follow, k
    cdef unsigned char first, low, high
    cdef uint64_t eight
    while i < size:
        if size - i >= 8:
            memcpy(&eight, text + i, 8)
            if not eight & HIGH_BITS:   # ASCII
                i += 8
                continue
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
