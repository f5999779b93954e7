# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
The lookup: the query, the walk between two frames, and the answer along their path.

All functions read the tree only; the caller holds its lock.
"""

cdef struct Path:
    # The frames whose samples lie between two frames: each hop leads from the frame named to its parent.
    FrameId source[MAX_HOPS + 1]    # up from the source; one entry more than hops count
    FrameId target[MAX_HOPS + 1]    # up from the target; the same
    uint32_t source_hops            # 0: the source is the top
    uint32_t target_hops            # 0: the target is the top
    FrameId top                     # the common ancestor at which the two sides meet


cdef inline int64_t _oldest_of_newest(const Tree* tree, const FrameId* frames, uint32_t hops,
                                      int64_t common_ns) noexcept nogil:
    # Static frames and those whose newest stamp is 0 do not count.
    cdef uint32_t i
    cdef int64_t newest_ns
    for i in range(hops):
        newest_ns = tree.histories[frames[i]].newest_ns
        if newest_ns != 0 and newest_ns < common_ns:
            common_ns = newest_ns
    return common_ns


cdef inline int64_t path_common_time(const Tree* tree, const Path* path) noexcept nogil:
    # The newest time that the history of every dynamic frame on the path covers; 0 if none is dynamic.
    cdef int64_t common_ns = INT64_MAX
    common_ns = _oldest_of_newest(tree, path.source, path.source_hops, common_ns)
    common_ns = _oldest_of_newest(tree, path.target, path.target_hops, common_ns)
    return 0 if common_ns == INT64_MAX else common_ns


# Walks through the tree, and answers along the path found. `time_ns` 0 means the latest common time. If `out`
# is NULL, only the status is computed. `stamp_ns` receives the time looked up. `path` is scratch
# memory and holds the path after a successful lookup.
cdef Status walk_lookup(const Tree* tree, FrameId target, FrameId source, int64_t time_ns,
                        const Policy* policy, Path* path, Transform* out, int64_t* stamp_ns) noexcept nogil
cdef Status walk_common_time(const Tree* tree, FrameId target, FrameId source, Path* path,
                             int64_t* common_ns) noexcept nogil
# The times for which a lookup answers, without a break up to the latest common time; where nothing moves, up
# to MAX_STAMP_NS. The status is that of a lookup at the latest common time. Both frames are pinned.
cdef Status walk_time_range(const PinnedTree* pinned, FrameId target, FrameId source,
                            TimeRange* answered) noexcept nogil


# `index` receives which of `named` it is, if it is one of them.
cdef int64_t limit_of_name(const FrameLimits* limits, const char* name, size_t size,
                           uint32_t* index) noexcept nogil


cdef struct Lack:
    # What one side of a path lacks for a time. NULL: no such frame.
    const History* first        # of the first frame without an answer, on the way up
    const History* furthest     # of the frame whose data is furthest from the time
    FrameId furthest_frame
    const History* refused      # of the first frame whose answer the policy refuses
    FrameId refused_frame
    Gap refusal                 # why the policy refuses it


cdef void lack_init(Lack* lack) noexcept nogil
# Adds a frame, in the order of the way up, if its history has no answer.
cdef void lack_check(Lack* lack, const History* history, FrameId frame, int64_t time_ns, const Policy* policy,
                     int64_t tolerance_ns) noexcept nogil
# The status of a lookup along a path whose sides lack this; STATUS_OK: they lack nothing.
cdef Status lack_status(const Lack* source, const Lack* target, int64_t time_ns) noexcept nogil


cdef struct Query:
    const char* target          # names as UTF-8, owned by the caller's objects
    Py_ssize_t target_size      # bytes
    const char* source          # the same
    Py_ssize_t source_size
    const char* fixed           # NULL: a simple lookup
    Py_ssize_t fixed_size
    int64_t target_ns           # the target's time in a two-time lookup; 0: the latest common time
    int64_t source_ns           # the source's time, or the time of a simple lookup; 0: the latest common time
    Policy policy


cdef struct QueryFrames:
    FrameId target
    FrameId source
    FrameId fixed               # of a two-time lookup
    uint32_t bad_limit          # the first limit that could never apply, as in Status; UINT32_MAX: none
    FrameId badly_limited       # its frame; NO_FRAME: not known


cdef inline bint asks_for_1970(const Query* query, const Status* status) noexcept nogil:
    # Whether it fails because it asks for a time in 1970, and the data is of this century: the time is in
    # another unit, or of another clock.
    return (status.code == STATUS_EXTRAPOLATION and status.gap in (GAP_PAST, GAP_SINGLE)
            and status.requested_ns in (query.source_ns, query.target_ns)
            and 0 < status.requested_ns < YEAR_NS and status.edge_ns > 30 * YEAR_NS)


# If `out` is NULL, only the status is computed. `stamp_ns` receives the time looked up or, if a policy let a
# frame stay at its newest sample, the oldest stamp of such samples.
cdef Status query_answer(const Tree* tree, const Query* query, Transform* out,
                         int64_t* stamp_ns) noexcept nogil
# The same in three steps: a bad status if a name is invalid or unknown, and whether a limit could never
# apply; then an answer without the names; then the status of that under these limits.
cdef Status query_find_frames(const Tree* tree, const Query* query, QueryFrames* frames) noexcept nogil
cdef Status query_answer_between(const Tree* tree, const Query* query, const QueryFrames* frames,
                                 Transform* out, int64_t* stamp_ns) noexcept nogil
cdef Status query_judge_limits(const QueryFrames* frames, Status answered) noexcept nogil
# The ids of the target and the source; a bad status if one of the names is invalid or unknown.
cdef Status query_end_frames(const Tree* tree, const Query* query, FrameId* target,
                             FrameId* source) noexcept nogil
# Whether this is a simple lookup between equal names, for which the frame need not be known.
cdef bint query_is_identity(const Query* query) noexcept nogil
