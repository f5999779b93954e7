"""Memory for histories out of a segment, which other processes read."""

from libc.stddef cimport size_t
from libc.stdint cimport uint32_t, uint64_t

from tf2_py._core.condition cimport pthread_mutex_t
from tf2_py._core.segment cimport Segment

cdef enum:
    SIZE_CLASSES = 192


cdef struct FreeBlocks:
    # Of one size; in the owner's own memory, so that nobody else can spoil it.
    uint64_t* offsets
    uint32_t count
    uint32_t capacity


cdef struct Arena:
    # Guarded by its mutex: the last owner of a pinned ring frees it without the tree's lock.
    pthread_mutex_t mutex
    size_t top              # offset behind all blocks ever given out
    size_t committed        # offset behind the memory that is there
    size_t end              # offset behind the last byte that may be given out
    Segment* segment
    FreeBlocks free_blocks[SIZE_CLASSES]


# 0, or -1.
cdef int arena_init(Arena* arena, Segment* segment) noexcept nogil
cdef void arena_free(Arena* arena) noexcept nogil
# A block that begins with a line; NULL: there is no memory.
cdef void* arena_take(Arena* arena, size_t size) noexcept nogil
# `size`: as it was taken.
cdef void arena_give(Arena* arena, void* block, size_t size) noexcept nogil
