# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Record the hops of a lookup, with the samples that have answered it."""

cdef void _describe_samples(const History* history, int64_t time_ns, const Policy* policy,
                            int64_t tolerance_ns, Hop* hop) noexcept nogil:
    # Of a history that answers for the time.
    cdef Neighbors around
    cdef uint32_t hint = NEWEST_HINT
    cdef int64_t found_ns = time_ns
    hop.data = history_beyond(history, policy, tolerance_ns, &found_ns)
    hop.weight = 0.0
    hop.parent = history_parent_at(history, found_ns)
    hop.older_ns = hop.newer_ns = history.newest_ns
    if history.kind == HISTORY_STATIC:
        hop.data = HOP_STATIC
    elif hop.data == HOP_EXTRAPOLATED and not history_has_velocity(history):
        hop.data = HOP_HELD
    elif hop.data == HOP_EXTRAPOLATED:
        hop.older_ns = history_stamp_of(history, history.count - 2)
        hop.weight = <double>(time_ns - hop.older_ns) / <double>(hop.newer_ns - hop.older_ns)
    elif hop.data == HOP_HELD:
        pass
    elif history_stamps_around(history, time_ns, &hop.older_ns, &hop.newer_ns):
        history_neighbors(history, time_ns, &hint, &around)
        hop.data = HOP_KEPT if around.older == around.newer else HOP_INTERPOLATED
        hop.weight = neighbors_ratio(&around, time_ns)
    else:
        hop.older_ns = hop.newer_ns = time_ns


cdef void _describe_hop(const Tree* tree, FrameId frame, bint is_down, int64_t time_ns, const Policy* policy,
                        Hop* hop) noexcept nogil:
    cdef const History* history = &tree.histories[frame]
    cdef int64_t tolerance_ns = policy_tolerance(tree, frame, policy)
    hop.frame = frame
    hop.is_down = is_down
    hop.newest_ns = history.newest_ns
    hop.authority = history.authority
    _describe_samples(history, time_ns, policy, tolerance_ns, hop)
    hop.used_ns = time_ns
    # As the lookup answers it, so that the hops are what it is composed of.
    if policy.is_given:
        history_transform_under(history, time_ns, policy, tolerance_ns, &hop.transform, &hop.used_ns)
    else:
        history_transform_at(history, time_ns, NEWEST_HINT, &hop.transform)


cdef int query_explain(const Tree* tree, const Query* query, Explained* out, Status* status) noexcept nogil:
    cdef QueryFrames frames
    cdef Path path
    cdef FrameId frame
    cdef bint is_down
    cdef uint32_t i
    memset(out, 0, sizeof(Explained))
    status[0] = query_answer(tree, query, &out.transform, &out.stamp_ns)
    if status.code != STATUS_OK:
        return 0
    query_find_frames(tree, query, &frames)
    out.time_ns = query.source_ns
    if out.time_ns == 0:
        walk_common_time(tree, frames.target, frames.source, &path, &out.time_ns)
    # Whether it is too old was judged above; at this later moment, that does not count.
    walk_lookup(tree, frames.target, frames.source, query.source_ns, &query.policy, &path, &out.transform,
                &out.stamp_ns)
    out.count = path.source_hops + path.target_hops
    out.hops = <Hop*>malloc((out.count + 1) * sizeof(Hop))
    if out.hops == NULL:
        return -1
    # One loop: with more copies of what is inlined here, gcc no longer inlines it into lookups.
    for i in range(out.count):
        is_down = i >= path.source_hops
        frame = path.target[out.count - 1 - i] if is_down else path.source[i]
        _describe_hop(tree, frame, is_down, out.time_ns, &query.policy, &out.hops[i])
    return 0
