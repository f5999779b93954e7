"""Transforms of one block of times at once, on plain arrays of doubles."""

from libc.stdint cimport int64_t, uint32_t

from tf2_py._core.cache cimport Cache
from tf2_py._core.types cimport Transform

cdef enum:
    BLOCK = 64              # times; all arrays of a Work stay in the first-level cache


cdef struct Block:
    # One transform per time: translation x y z in metres, rotation x y z w.
    double tx[BLOCK]
    double ty[BLOCK]
    double tz[BLOCK]
    double qx[BLOCK]
    double qy[BLOCK]
    double qz[BLOCK]
    double qw[BLOCK]


cdef struct Work "tf2_work":
    # Everything lies in one struct, so that the compiler knows that no two arrays overlap.
    Block older             # the samples before and after each time ...
    Block newer
    double ratio[BLOCK]     # ... and how far between them it lies, 0 .. 1
    double distance[BLOCK]  # slerp_distance of the two rotations
    double sign[BLOCK]
    Block hop               # of the frame in hand, child to parent
    Block source            # from the source up to where the two sides meet
    Block target            # from the target up, likewise
    Block result
    unsigned char missing[BLOCK]    # 1: some history does not answer for this time


# All BLOCK entries are computed; those from `count` on, and the missing ones, hold a filler. The numbers are
# those of the functions for one time in _cache and _geometry, to the last bit.
cdef void block_hop(Work* work, const Cache* cache, const int64_t* times_ns, uint32_t count,
                    uint32_t* hint) noexcept nogil
cdef void block_begin_source(Work* work) noexcept nogil         # source = hop
cdef void block_begin_source_identity(Work* work) noexcept nogil
cdef void block_begin_target(Work* work) noexcept nogil
cdef void block_climb_source(Work* work) noexcept nogil         # source = hop source
cdef void block_climb_target(Work* work) noexcept nogil
cdef void block_result(Work* work, bint with_target) noexcept nogil     # result = target^-1 source, finished
cdef void block_identity(Work* work) noexcept nogil             # result = identity
cdef void block_put(Work* work, uint32_t i, const Transform* value) noexcept nogil      # result, one of it
cdef void block_apply(Work* work, const Transform* outer) noexcept nogil    # result = outer result
cdef void block_store(const Work* work, uint32_t count, double* translations,
                      double* rotations) noexcept nogil
# Rows of three coordinates in metres, one for each time; `out` may be `points`.
cdef void block_carry(const Work* work, uint32_t count, const double* points, double* out) noexcept nogil
