"""Owns the order of the samples of one frame in flat arrays."""

from libc.stdint cimport int64_t, uint32_t
from libc.string cimport memcpy

from tf2_py._core.cache cimport CACHE_DYNAMIC, Cache, cache_slot
from tf2_py._core.types cimport Sample, Transform


cdef inline void _export_run(const Cache* cache, uint32_t slot, uint32_t count, int64_t* stamps,
                             double* transforms, uint32_t* parents) noexcept nogil:
    # Samples that lie in one piece.
    cdef const Sample* sample = cache.samples + slot
    cdef uint32_t i
    memcpy(stamps, cache.stamps + slot, count * sizeof(int64_t))
    for i in range(count):
        memcpy(transforms + <size_t>i * TRANSFORM_DOUBLES, &sample[i].transform, sizeof(Transform))
        parents[i] = sample[i].parent


cdef void cache_export(const Cache* cache, int64_t* stamps, double* transforms,
                       uint32_t* parents) noexcept nogil:
    cdef uint32_t first = min(cache.count, cache.capacity - cache.head)
    if cache.count == 0:
        return
    _export_run(cache, cache.head, first, stamps, transforms, parents)
    _export_run(cache, 0, cache.count - first, stamps + first,
                transforms + <size_t>first * TRANSFORM_DOUBLES, parents + first)


cdef void cache_import(Cache* cache, uint32_t count, const int64_t* stamps, const double* transforms,
                       const uint32_t* parents) noexcept nogil:
    cdef uint32_t i
    cdef Sample* sample
    cache.count = count
    if count == 0:
        return
    memcpy(cache.stamps, stamps, count * sizeof(int64_t))
    for i in range(count):
        sample = cache.samples + i
        memcpy(&sample.transform, transforms + <size_t>i * TRANSFORM_DOUBLES, sizeof(Transform))
        sample.parent = parents[i]
        cache.parent_changes += i > 0 and sample.parent != cache.samples[i - 1].parent
    if cache.kind == CACHE_DYNAMIC:
        cache.oldest_ns = cache.stamps[cache_slot(cache, 0)]
        cache.newest_ns = cache.stamps[cache_slot(cache, count - 1)]
