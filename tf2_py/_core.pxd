# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
The core: structs, and functions on them. It keeps no Python objects and knows nothing of ROS.

One extension, composed of chapters. Each has a header, included here, and, if that declares more than inline
functions, its code, included by ``_core.pyx``. A chapter uses those before it, in this order; what only later
chapters of the core use is not in a header, but has no underscore.
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
from libc.string cimport memchr, memcmp, memcpy, memset, strlen
from posix.mman cimport munmap
from posix.time cimport CLOCK_MONOTONIC, CLOCK_REALTIME, clock_gettime, timespec

include "core/types_header.pxi"
include "core/geometry_header.pxi"
include "core/sync_header.pxi"
include "core/forked_locks_header.pxi"
include "core/names_header.pxi"
include "core/history_header.pxi"
include "core/tree_header.pxi"
include "core/frozen_format_header.pxi"
include "core/lookup_header.pxi"
include "core/explained_header.pxi"
include "core/series_header.pxi"
include "core/piecewise_linear_header.pxi"
include "core/waiters_header.pxi"
include "core/cdr_header.pxi"
include "core/batch_header.pxi"
include "core/replacing_header.pxi"
