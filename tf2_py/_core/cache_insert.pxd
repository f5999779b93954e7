"""Changing the history of one frame, and what a change means for lookups."""

from libc.stdint cimport int64_t, uint32_t

from tf2_py._core.cache cimport Cache
from tf2_py._core.cache_memory cimport CacheInsert
from tf2_py._core.types cimport FrameId, Sample


cdef struct TimeRange:
    # Both included; empty where first > last.
    int64_t first           # ns, as all times
    int64_t last


cdef struct CacheChange:
    # What an insert has changed; the ranges may be larger than the change.
    TimeRange covered       # had no samples around them before, and have now
    TimeRange lost          # the other way round
    TimeRange relinked      # another parent may answer for them
    uint32_t moved          # samples copied to other slots


# `growth_limit`: by how many bytes the memory may grow. `change` is filled whatever the outcome: pruning
# comes before all that may fail. `stamp_ns` >= 0, a unit rotation in `sample`.
cdef CacheInsert cache_insert(Cache* cache, int64_t stamp_ns, const Sample* sample, int64_t cache_time_ns,
                              size_t growth_limit, CacheChange* change) noexcept nogil
cdef CacheInsert cache_set_static(Cache* cache, int64_t stamp_ns, const Sample* sample, size_t growth_limit,
                                  CacheChange* change) noexcept nogil
cdef const char* cache_check(const Cache* cache) noexcept nogil     # NULL, or which invariant does not hold
# Of a history of any origin, keeps what is sound; it must lie in memory of its own. `child`: its frame;
# `frames`: how many ids there are.
cdef void cache_mend(Cache* cache, FrameId child, uint32_t frames) noexcept nogil
