"""
One frame's history: a ring of samples sorted by stamp.

Only this file and the modules named cache_* know how samples lie in memory; all others call the functions.
Those that read or change a Cache are called with the tree's lock held, but for a pinned copy.
"""

from libc.stdint cimport int64_t, uint32_t

from tf2_py._core.arena cimport Arena
from tf2_py._core.types cimport NO_FRAME, FrameId, Sample, Transform

cdef enum CacheKind:
    CACHE_NONE              # the frame was never a child: no samples, no memory
    CACHE_DYNAMIC
    CACHE_STATIC            # one sample, for every time


cdef struct Ring:
    # The first bytes of the memory that holds a frame's samples.
    uint32_t owners             # the cache and its pinned copies; read and written atomically
    uint32_t pinned_from        # slot of the oldest sample of a pinned copy; valid where owners > 1
    size_t bytes                # allocated, this head included


cdef struct Cache:
    # The ring, for the modules named cache_* alone. The oldest sample has the index 0 and lies in slot
    # `head`; slot 0 follows slot `capacity - 1`. Two parallel arrays, so that a search reads little memory.
    # Equal stamps lie in order of arrival.
    Ring* ring                  # the memory of both arrays; NULL: capacity 0
    int64_t* stamps             # ns, by slot
    Sample* samples             # by slot; each is one 64-byte line
    uint32_t capacity           # slots allocated
    uint32_t head               # slot of the oldest sample
    uint32_t mostly_empty_for   # inserts since the ring was last a quarter full
    Arena* arena                # that gives memory for the ring; NULL: malloc does
    # Of a copy of this struct: whether the samples still lie where it says. Both wrap.
    uint32_t appended           # samples ever put behind the newest one
    uint32_t disturbed          # how often samples were moved, replaced or dropped but for the oldest
    # What others may read.
    uint32_t count              # samples
    uint32_t parent_changes     # how many neighbours have different parents; 0: one parent at all times
    CacheKind kind
    int64_t newest_ns           # stamp of the newest sample; 0 where there is none, and in a static cache
    int64_t oldest_ns           # likewise, of the oldest sample
    # What the tree writes.
    uint32_t authority          # id of the sender of the last sample; NAME_UNKNOWN: there was none
    bint is_parent              # a sample of some frame has named this frame as its parent


cdef enum:
    NEWEST_HINT = 0x7FFFFFFF    # begin the search at the newest sample: most lookups ask for a recent time
    PREFETCH_FROM = 16          # samples; in a shorter history any search is as quick


cdef inline uint32_t cache_slot(const Cache* cache, uint32_t index) noexcept nogil:
    # For the modules named cache_* alone. The sum cannot wrap: capacities stay below 2^31.
    cdef uint32_t slot = cache.head + index
    return slot if slot < cache.capacity else slot - cache.capacity


cdef inline size_t cache_bytes(const Cache* cache) noexcept nogil:
    # Allocated for its samples.
    return 0 if cache.ring == NULL else cache.ring.bytes


cdef inline FrameId cache_parent_of(const Cache* cache, uint32_t index) noexcept nogil:
    # The parent that one sample names; `index` < `count`, 0 is the oldest.
    return cache.samples[cache_slot(cache, index)].parent


cdef inline FrameId cache_newest_parent(const Cache* cache) noexcept nogil:
    # NO_FRAME: there are no samples.
    return NO_FRAME if cache.count == 0 else cache_parent_of(cache, cache.count - 1)


cdef inline const Transform* cache_newest_transform(const Cache* cache) noexcept nogil:
    # Of a cache with samples; of a static one, its only transform.
    return &cache.samples[cache_slot(cache, cache.count - 1)].transform
