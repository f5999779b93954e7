"""Copying the history of one frame into flat arrays, and back."""

from libc.stdint cimport int64_t, uint32_t

from tf2_py._core.cache cimport Cache

cdef enum:
    TRANSFORM_DOUBLES = 7       # per transform: translation x y z in metres, rotation x y z w

# `count` elements each, oldest first. The cache may be a pinned copy.
cdef void cache_export(const Cache* cache, int64_t* stamps, double* transforms,
                       uint32_t* parents) noexcept nogil
# Fills a cache that has a kind, memory for `count` samples at least, and no samples. Checks nothing: see
# cache_check.
cdef void cache_import(Cache* cache, uint32_t count, const int64_t* stamps, const double* transforms,
                       const uint32_t* parents) noexcept nogil
