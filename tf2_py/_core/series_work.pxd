"""Transforms of one batch of times at once, on plain arrays of doubles."""

from libc.stdint cimport int64_t, uint32_t

from tf2_py._core.cache cimport Cache
from tf2_py._core.types cimport Transform

cdef enum:
    BATCH_TIMES = 64              # times; all arrays of a Work stay in the first-level cache


cdef struct Columns:
    # One transform per time: translation x y z in metres, rotation x y z w.
    double tx[BATCH_TIMES]
    double ty[BATCH_TIMES]
    double tz[BATCH_TIMES]
    double qx[BATCH_TIMES]
    double qy[BATCH_TIMES]
    double qz[BATCH_TIMES]
    double qw[BATCH_TIMES]


cdef struct Work "tf2_work":
    # Everything lies in one struct, so that the compiler knows that no two arrays overlap.
    Columns older             # the samples before and after each time ...
    Columns newer
    double ratio[BATCH_TIMES]     # ... and how far between them it lies, 0 .. 1
    double distance[BATCH_TIMES]  # slerp_distance of the two rotations
    double sign[BATCH_TIMES]
    Columns hop               # of the frame in hand, child to parent
    Columns source            # from the source up to where the two sides meet
    Columns target            # from the target up, likewise
    Columns result
    unsigned char missing[BATCH_TIMES]    # 1: some history does not answer for this time


# All BATCH_TIMES entries are computed; those from `count` on, and the missing ones, hold a filler. The
# numbers are those of the functions for one time in _cache and _geometry, to the last bit.
cdef void work_hop(Work* work, const Cache* cache, const int64_t* times_ns, uint32_t count,
                   uint32_t* hint) noexcept nogil
cdef void work_begin_source(Work* work) noexcept nogil         # source = hop
cdef void work_begin_source_identity(Work* work) noexcept nogil
cdef void work_begin_target(Work* work) noexcept nogil
cdef void work_climb_source(Work* work) noexcept nogil         # source = hop source
cdef void work_climb_target(Work* work) noexcept nogil
cdef void work_result(Work* work, bint with_target) noexcept nogil     # result = target^-1 source, finished
cdef void work_identity(Work* work) noexcept nogil             # result = identity
cdef void work_put(Work* work, uint32_t i, const Transform* value) noexcept nogil      # result, one of it
cdef void work_apply(Work* work, const Transform* outer) noexcept nogil    # result = outer result
cdef void work_store(const Work* work, uint32_t count, double* translations, double* rotations) noexcept nogil
# Rows of three coordinates in metres, one for each time; `out` may be `points`.
cdef void work_carry(const Work* work, uint32_t count, const double* points, double* out) noexcept nogil
