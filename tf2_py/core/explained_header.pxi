# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The hops of a lookup: which samples of which frames have answered it."""

cdef struct Hop:
    FrameId frame
    FrameId parent          # in these samples
    bint is_down            # the walk goes from the parent to the frame, by the inverse of `transform`
    HopData data
    # Their stamps, the same of a single one. Of HOP_KEPT, those on both sides of the time; of HOP_STATIC, 0.
    int64_t older_ns
    int64_t newer_ns
    int64_t used_ns         # the time; of HOP_HELD without extrapolation, the stamp of the sample
    double weight           # of the newer one; above 1: extrapolated; 0: a single sample has answered
    int64_t newest_ns       # the newest stamp of the frame; 0 in a static one
    uint32_t authority      # who sent the last sample that was inserted, which may be another one
    Transform transform     # frame to parent


cdef struct Explained:
    Hop* hops               # up from the source, then down to the target
    uint32_t count          # of `hops`
    int64_t time_ns         # looked up; if that is 0, the latest common time
    int64_t stamp_ns        # as walk_lookup
    Transform transform     # source to target


# Answers a query of one time, and explains the answer, from one state of the tree. 0, or -1 without memory.
# Call explained_free in any case.
cdef int query_explain(const Tree* tree, const Query* query, Explained* out, Status* status) noexcept nogil


cdef inline void explained_free(Explained* explained) noexcept nogil:
    free(explained.hops)
