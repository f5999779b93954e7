"""Owns the memory of a segment that holds histories: blocks of few sizes, kept for the next of their size."""

from libc.stddef cimport size_t
from libc.stdint cimport uint32_t, uint64_t
from libc.stdlib cimport free, realloc

from tf2_py._core.condition cimport (
    pthread_mutex_destroy,
    pthread_mutex_init,
    pthread_mutex_lock,
    pthread_mutex_unlock,
)
from tf2_py._core.segment cimport RINGS_SIXTEENTH, Segment, segment_part
from tf2_py._core.types cimport LINE_BYTES

cdef enum:
    COMMIT_BYTES = 262144       # at once, at least: a call of the system for each block would cost more
    PAGE_BYTES = 4096


cdef int arena_init(Arena* arena, Segment* segment) noexcept nogil:
    arena.segment = segment
    arena.top = arena.committed = segment_part(segment, RINGS_SIXTEENTH)
    arena.end = segment.size
    return -1 if pthread_mutex_init(&arena.mutex, NULL) != 0 else 0


cdef void arena_free(Arena* arena) noexcept nogil:
    cdef uint32_t i
    for i in range(<uint32_t>SIZE_CLASSES):
        free(arena.free_blocks[i].offsets)
    pthread_mutex_destroy(&arena.mutex)


cdef inline uint32_t _size_class(size_t size, size_t* rounded) noexcept nogil:
    # Four sizes for each doubling: at most a fifth of a block is lost.
    cdef size_t lines = max((size + LINE_BYTES - 1) // LINE_BYTES, <size_t>1)
    cdef uint32_t shift = 0
    while lines >> shift >= 8:
        shift += 1
    lines = (lines + (<size_t>1 << shift) - 1) >> shift
    if lines == 8:
        lines = 4
        shift += 1
    rounded[0] = (lines << shift) * LINE_BYTES
    return shift * 4 + <uint32_t>lines


cdef inline bint _commit(Arena* arena, size_t size) noexcept nogil:
    # Memory for so many bytes from `top` on.
    cdef size_t wanted
    if size > arena.end - arena.top:
        return False
    if arena.top + size <= arena.committed:
        return True
    wanted = max(arena.top + size - arena.committed, <size_t>COMMIT_BYTES)
    wanted = min((wanted + PAGE_BYTES - 1) // PAGE_BYTES * PAGE_BYTES, arena.end - arena.committed)
    if arena.segment.commit(arena.segment, arena.committed, wanted) != 0:
        return False
    arena.committed += wanted
    return True


cdef void* arena_take(Arena* arena, size_t size) noexcept nogil:
    cdef size_t rounded
    cdef FreeBlocks* blocks = &arena.free_blocks[_size_class(size, &rounded)]
    cdef void* block = NULL
    pthread_mutex_lock(&arena.mutex)
    if blocks.count:
        blocks.count -= 1
        block = arena.segment.base + blocks.offsets[blocks.count]
    elif _commit(arena, rounded):
        block = arena.segment.base + arena.top
        arena.top += rounded
    pthread_mutex_unlock(&arena.mutex)
    return block


cdef void arena_give(Arena* arena, void* block, size_t size) noexcept nogil:
    cdef size_t rounded
    cdef FreeBlocks* blocks = &arena.free_blocks[_size_class(size, &rounded)]
    cdef uint32_t capacity
    cdef void* grown
    pthread_mutex_lock(&arena.mutex)
    if blocks.count == blocks.capacity:
        capacity = blocks.capacity * 2 if blocks.capacity else 16
        grown = realloc(blocks.offsets, capacity * sizeof(uint64_t))
        # Without memory for the note the block is lost, and nothing else.
        if grown != NULL:
            blocks.offsets = <uint64_t*>grown
            blocks.capacity = capacity
    if blocks.count < blocks.capacity:
        blocks.offsets[blocks.count] = <uint64_t>(<char*>block - arena.segment.base)
        blocks.count += 1
    pthread_mutex_unlock(&arena.mutex)
