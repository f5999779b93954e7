"""A table of names: UTF-8 bytes to small ids and back, usable without the GIL."""

from libc.stdint cimport uint32_t


cdef struct Name:
    size_t start            # offset of its first byte in `text`
    uint32_t size           # bytes
    uint32_t hash


cdef struct Names:
    char* text              # every name, one after the other, not terminated
    size_t text_size        # bytes in use
    size_t text_capacity    # bytes allocated
    Name* names             # by id
    uint32_t count          # ids in use: 0 .. count - 1
    uint32_t capacity       # ids allocated
    uint32_t* slots         # hash table of id + 1, 0: free; open addressing, linear probing
    uint32_t slot_mask      # slots allocated - 1; their number is a power of two
    size_t bytes            # memory allocated, for statistics


cdef enum:
    NAME_UNKNOWN = 0xFFFFFFFF
    NAME_NO_MEMORY = 0xFFFFFFFE

# Zero a Names before names_init; after a failed names_init, names_free is still due.
cdef int names_init(Names* names) noexcept nogil                                    # 0, or -1: no memory
cdef void names_free(Names* names) noexcept nogil
cdef uint32_t names_find(const Names* names, const char* text, size_t size) noexcept nogil
cdef uint32_t names_intern(Names* names, const char* text, size_t size) noexcept nogil
# A copy good for names_str alone, to be freed with names_free; -1: no memory, nothing to free.
cdef int names_copy(const Names* names, Names* out) noexcept nogil
cdef str names_str(const Names* names, uint32_t id)
