"""A table of names: UTF-8 bytes to small ids and back, usable without the GIL."""

from libc.stdint cimport uint32_t, uint64_t


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
    # Empty, or beginning with '/': no lookup ever accepts such a name. What is inserted loses the '/' first.
    return size == 0 or text[0] == b"/"


cdef inline void name_strip(const char** text, size_t* size) noexcept nogil:
    # Without one leading '/', as tf2 stores names.
    if size[0] and text[0][0] == b"/":
        text[0] += 1
        size[0] -= 1


# Keyed with a secret of this process, so that nobody can choose names that collide.
cdef uint64_t name_hash(const char* text, size_t size) noexcept nogil

# Zero a Names before names_init; after a failed names_init, names_free is still due.
cdef int names_init(Names* names) noexcept nogil                                    # 0, or -1: no memory
cdef void names_free(Names* names) noexcept nogil
# NAME_UNKNOWN: there is no such name.
cdef uint32_t names_find(const Names* names, const char* text, size_t size) noexcept nogil
# The name's id, a new one where it is unknown. NAME_NO_MEMORY: there is no memory for it, or no free id.
cdef uint32_t names_intern(Names* names, const char* text, size_t size) noexcept nogil
# Forgets names until there are only so many: those that were interned last. Memory is kept for the next ones.
cdef void names_drop(Names* names, uint32_t count) noexcept nogil
cdef const char* names_check(const Names* names) noexcept nogil     # NULL, or which invariant does not hold
