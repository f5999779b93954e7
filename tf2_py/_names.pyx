"""Owns names: one append-only text arena, one hash table from bytes to id."""

from libc.stdint cimport UINT32_MAX, uint32_t, uint64_t
from libc.stdlib cimport calloc, free, malloc, realloc
from libc.string cimport memcmp, memcpy, memset


cdef enum:
    FIRST_SLOTS = 64
    FIRST_TEXT = 1024
    LAST_ID = 0x7FFFFFFE    # ids stay below 2^31: the tree keeps a flag in the bit above


cdef inline uint32_t _hash(const char* text, size_t size) noexcept nogil:
    # Eight bytes at a time, folded by multiplication; the multiplier is 2^64 / golden ratio.
    cdef uint64_t mixed = size
    cdef uint64_t word
    while size >= 8:
        memcpy(&word, text, 8)
        mixed = (mixed ^ word) * <uint64_t>0x9E3779B97F4A7C15
        mixed ^= mixed >> 32
        text += 8
        size -= 8
    if size:
        word = 0
        memcpy(&word, text, size)
        mixed = (mixed ^ word) * <uint64_t>0x9E3779B97F4A7C15
        mixed ^= mixed >> 32
    return <uint32_t>mixed


cdef inline uint32_t _find(const Names* names, const char* text, size_t size, uint32_t hash) noexcept nogil:
    cdef uint32_t slot = hash & names.slot_mask
    cdef uint32_t id
    cdef const Name* name
    while names.slots[slot]:
        id = names.slots[slot] - 1
        name = &names.names[id]
        if name.hash == hash and name.size == size and memcmp(names.text + name.start, text, size) == 0:
            return id
        slot = (slot + 1) & names.slot_mask
    return NAME_UNKNOWN


cdef int names_init(Names* names) noexcept nogil:
    names.slots = <uint32_t*>calloc(FIRST_SLOTS, sizeof(uint32_t))
    if names.slots == NULL:
        return -1
    names.slot_mask = FIRST_SLOTS - 1
    names.bytes = FIRST_SLOTS * sizeof(uint32_t)
    return 0


cdef void names_free(Names* names) noexcept nogil:
    free(names.text)
    free(names.names)
    free(names.slots)


cdef uint32_t names_find(const Names* names, const char* text, size_t size) noexcept nogil:
    return _find(names, text, size, _hash(text, size))


cdef int _reserve(Names* names, size_t size) noexcept nogil:
    # Room for one more name of `size` bytes; on failure every name is where it was.
    cdef size_t wanted
    cdef uint32_t slot, id, capacity
    cdef void* grown
    if names.text_size + size > names.text_capacity:
        wanted = names.text_capacity * 2 if names.text_capacity else FIRST_TEXT
        while wanted < names.text_size + size:
            wanted *= 2
        grown = realloc(names.text, wanted)
        if grown == NULL:
            return -1
        names.text = <char*>grown
        names.bytes += wanted - names.text_capacity
        names.text_capacity = wanted
    if names.count == names.capacity:
        capacity = names.capacity * 2 if names.capacity else FIRST_SLOTS // 2
        grown = realloc(names.names, capacity * sizeof(Name))
        if grown == NULL:
            return -1
        names.names = <Name*>grown
        names.bytes += (capacity - names.capacity) * sizeof(Name)
        names.capacity = capacity
    if (names.count + 1) * <size_t>2 > names.slot_mask + <size_t>1:
        # More than half full: probes stay short.
        capacity = (names.slot_mask + 1) * 2
        grown = calloc(capacity, sizeof(uint32_t))
        if grown == NULL:
            return -1
        free(names.slots)
        names.slots = <uint32_t*>grown
        names.bytes += (capacity - names.slot_mask - 1) * sizeof(uint32_t)
        names.slot_mask = capacity - 1
        for id in range(names.count):
            slot = names.names[id].hash & names.slot_mask
            while names.slots[slot]:
                slot = (slot + 1) & names.slot_mask
            names.slots[slot] = id + 1
    return 0


cdef uint32_t names_intern(Names* names, const char* text, size_t size) noexcept nogil:
    cdef uint32_t hash = _hash(text, size)
    cdef uint32_t id = _find(names, text, size, hash)
    cdef uint32_t slot
    if id != NAME_UNKNOWN:
        return id
    if names.count == LAST_ID or size > UINT32_MAX or _reserve(names, size) != 0:
        return NAME_NO_MEMORY
    id = names.count
    memcpy(names.text + names.text_size, text, size)
    names.names[id].start = names.text_size
    names.names[id].size = <uint32_t>size
    names.names[id].hash = hash
    names.text_size += size
    names.count += 1
    slot = hash & names.slot_mask
    while names.slots[slot]:
        slot = (slot + 1) & names.slot_mask
    names.slots[slot] = id + 1
    return id


cdef int names_copy(const Names* names, Names* out) noexcept nogil:
    memset(out, 0, sizeof(Names))
    out.text = <char*>malloc(names.text_size + 1)
    out.names = <Name*>malloc((names.count + 1) * sizeof(Name))
    if out.text == NULL or out.names == NULL:
        names_free(out)
        return -1
    memcpy(out.text, names.text, names.text_size)
    memcpy(out.names, names.names, names.count * sizeof(Name))
    out.count = names.count
    return 0


cdef str names_str(const Names* names, uint32_t id):
    cdef const Name* name = &names.names[id]
    return (names.text + name.start)[:name.size].decode("utf-8")
