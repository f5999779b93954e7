"""
The engine: structs, and functions on them. It keeps no Python objects and knows nothing of ROS.

One extension, composed of chapters. Each is a contract (``.pxd``) and, if that declares more than inline
functions, its code (``.pyx``). A chapter uses those before it, in this order.
"""

from libc.float cimport DBL_MAX, DBL_MIN
from libc.math cimport NAN, acos, atan2, ceil, cos, fabs, isfinite, isnan, sin, sqrt
from libc.stddef cimport size_t
from libc.stdint cimport (
    INT64_MAX,
    INT64_MIN,
    UINT32_MAX,
    UINT64_MAX,
    int32_t,
    int64_t,
    uint16_t,
    uint32_t,
    uint64_t,
)
from libc.stdlib cimport calloc, free, malloc, qsort, realloc
from libc.string cimport memchr, memcmp, memcpy, memset
from posix.mman cimport munmap
from posix.time cimport CLOCK_MONOTONIC, CLOCK_REALTIME, clock_gettime, timespec

include "core/types.pxd"
include "core/geometry.pxd"
include "core/sync.pxd"
include "core/names.pxd"
include "core/history.pxd"
include "core/tree.pxd"
include "core/frozen.pxd"
include "core/lookup.pxd"
include "core/series.pxd"
include "core/waiters.pxd"
include "core/cdr.pxd"
