"""Transforms of one batch of times at once, on plain arrays of doubles."""

from libc.stdint cimport int64_t, uint32_t

from tf2_py._core.cache cimport Cache
from tf2_py._core.types cimport Transform

cdef enum:
    BATCH_TIMES = 64        # times; all arrays of a SeriesWork fit into the first-level cache


cdef struct Columns:
    # One transform per time: translation x y z in metres, rotation x y z w.
    double tx[BATCH_TIMES]
    double ty[BATCH_TIMES]
    double tz[BATCH_TIMES]
    double qx[BATCH_TIMES]
    double qy[BATCH_TIMES]
    double qz[BATCH_TIMES]
    double qw[BATCH_TIMES]


cdef struct SeriesWork "tf2_work":
    # All arrays are in one struct, so that the compiler knows that no two of them overlap. Each has one entry
    # per time.
    Columns older                   # the sample before the time ...
    Columns newer                   # ... the one after it ...
    double ratio[BATCH_TIMES]       # ... and how far between them the time lies, 0 .. 1
    double distance[BATCH_TIMES]    # slerp_distance of the two rotations
    double sign[BATCH_TIMES]        # of their dot product: 1 or -1
    Columns hop                     # of the current frame, child to parent
    Columns source                  # from the source up to the current frame's parent
    Columns target                  # likewise, from the target
    Columns result                  # the answers
    unsigned char missing[BATCH_TIMES]      # 1: some history does not answer for this time


# All BATCH_TIMES entries are computed; those from `count` on, and the missing ones, hold a filler. The
# numbers are those of cache_transform_at and of the functions in geometry.pxd, to the last bit.
# hop = the frame's transforms at the times. `hint`: as in cache_neighbours.
cdef void work_hop(SeriesWork* work, const Cache* cache, const int64_t* times_ns, uint32_t count,
                   uint32_t* hint) noexcept nogil
cdef void work_begin_source(SeriesWork* work) noexcept nogil         # source = hop
cdef void work_begin_source_identity(SeriesWork* work) noexcept nogil      # source = identity
cdef void work_begin_target(SeriesWork* work) noexcept nogil   # target = hop
cdef void work_climb_source(SeriesWork* work) noexcept nogil         # source = hop source
cdef void work_climb_target(SeriesWork* work) noexcept nogil   # target = hop target
# result = target^-1 source, or source; with unit length and canonical sign.
cdef void work_result(SeriesWork* work, bint with_target) noexcept nogil
cdef void work_identity(SeriesWork* work) noexcept nogil             # result = identity
cdef void work_put(SeriesWork* work, uint32_t i, const Transform* value) noexcept nogil      # result[i]
cdef void work_apply(SeriesWork* work, const Transform* after) noexcept nogil    # result = after result
# The first `count` results, to rows of three and four numbers.
cdef void work_store(const SeriesWork* work, uint32_t count, double* translations,
                     double* rotations) noexcept nogil
# Each point with the result of its own time: rows of x y z in metres; `out` may be `points`.
cdef void work_transform_points(const SeriesWork* work, uint32_t count, const double* points,
                                double* out) noexcept nogil
