# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Names: one append-only text arena, one hash table from bytes to id."""

cdef enum:
    FIRST_SLOTS = 64
    FIRST_TEXT = 1024
    LAST_ID = 0x7FFFFFFE    # ids stay below 2^31: the tree keeps a flag in the bit above
    # In a table that is half full, a million names make a run this long by chance once in 10^15 tables.
    LONGEST_RUN = 256

cdef extern from "Python.h":
    ctypedef struct PyHash_FuncDef:
        Py_ssize_t (*hash)(const void* data, Py_ssize_t size) noexcept nogil
    PyHash_FuncDef* PyHash_GetFuncDef()

cdef PyHash_FuncDef* PYTHONS = PyHash_GetFuncDef()      # SipHash, with the secret of this process


cdef uint64_t name_hash(const char* text, size_t size) noexcept nogil:
    return <uint64_t>PYTHONS.hash(text, <Py_ssize_t>size)


cdef inline bint _is_name_of(const Names* names, uint32_t id, const char* text, size_t size) noexcept nogil:
    cdef const Name* name = &names.names[id]
    return name.size == size and memcmp(names.text + name.start, text, size) == 0


cdef inline uint32_t _find_hashed(const Names* names, const char* text, size_t size,
                                  uint32_t hash) noexcept nogil:
    cdef uint32_t slot = hash & names.slot_mask
    cdef uint32_t id
    while names.slots[slot]:
        id = names.slots[slot] - 1
        if names.names[id].hash == hash and _is_name_of(names, id, text, size):
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
    return _find_hashed(names, text, size, <uint32_t>name_hash(text, size))


cdef uint32_t names_find_guessed(const Names* names, const char* text, size_t size,
                                 uint32_t guess) noexcept nogil:
    if guess < names.count and _is_name_of(names, guess, text, size):
        return guess
    return names_find(names, text, size)


cdef inline size_t _text_capacity(const Names* names, size_t size) noexcept nogil:
    # Of the text, with another name of `size` bytes. Also for an empty name: memcpy must not get NULL.
    cdef size_t wanted = max(names.text_capacity, <size_t>FIRST_TEXT)
    while wanted < names.text_size + size:
        wanted *= 2
    return wanted


cdef inline uint32_t _capacity(const Names* names) noexcept nogil:
    # Of the ids, with another name.
    if names.count < names.capacity:
        return names.capacity
    return names.capacity * 2 if names.capacity else FIRST_SLOTS // 2


cdef inline uint32_t _slots(const Names* names) noexcept nogil:
    # With another name. At most half full: probes stay short.
    cdef uint32_t slots = names.slot_mask + 1
    return slots * 2 if (names.count + 1) * <size_t>2 > slots else slots


cdef size_t names_growth(const Names* names, size_t size) noexcept nogil:
    return (_text_capacity(names, size) - names.text_capacity
            + (_capacity(names) - names.capacity) * sizeof(Name)
            + (_slots(names) - names.slot_mask - 1) * sizeof(uint32_t))


cdef int _reserve(Names* names, size_t size) noexcept nogil:
    # Memory for one more name of `size` bytes. -1: there is none, and every name is where it was.
    cdef size_t wanted = _text_capacity(names, size)
    cdef uint32_t slot, id, capacity
    cdef void* grown
    if wanted > names.text_capacity:
        grown = realloc(names.text, wanted)
        if grown == NULL:
            return -1
        names.text = <char*>grown
        names.bytes += wanted - names.text_capacity
        names.text_capacity = wanted
    capacity = _capacity(names)
    if capacity > names.capacity:
        grown = realloc(names.names, capacity * sizeof(Name))
        if grown == NULL:
            return -1
        names.names = <Name*>grown
        names.bytes += (capacity - names.capacity) * sizeof(Name)
        names.capacity = capacity
    capacity = _slots(names)
    if capacity > names.slot_mask + 1:
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
    cdef uint32_t hash = <uint32_t>name_hash(text, size)
    cdef uint32_t id = _find_hashed(names, text, size, hash)
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


cdef void names_drop(Names* names, uint32_t count) noexcept nogil:
    # No probe for an earlier name passes the slot of a later one, so an emptied slot ends no probe too early.
    cdef uint32_t slot
    while names.count > count:
        names.count -= 1
        names.text_size -= names.names[names.count].size
        slot = names.names[names.count].hash & names.slot_mask
        while names.slots[slot] != names.count + 1:
            slot = (slot + 1) & names.slot_mask
        names.slots[slot] = 0


cdef const char* names_check(const Names* names) noexcept nogil:
    cdef uint32_t id, slot, run
    cdef const Name* name
    for id in range(names.count):
        name = &names.names[id]
        if name.start > names.text_size or name.size > names.text_size - name.start:
            return "a name beyond the text of all names"
        if name.hash != <uint32_t>name_hash(names.text + name.start, name.size):
            return "a name with the hash of another"
        slot = name.hash & names.slot_mask
        run = 0
        while names.slots[slot] != id + 1:
            if names.slots[slot] == 0:
                return "a name that its hash does not lead to"
            slot = (slot + 1) & names.slot_mask
            run += 1
            if run > LONGEST_RUN:
                return "names that collide in the hash table"
    return NULL
