# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Look a transform up: names to frames, the path between them, and what is computed along it."""

# Which of the frames that lack data an error describes. tf2 quotes the nearest stamp of one of them: of the
# first one on a side, and where both sides lack data, of the side whose frame has the newer data. That may
# be any of them, so the error also describes the one whose data is furthest away.

cdef void lack_init(Lack* lack) noexcept nogil:
    lack.first = lack.furthest = lack.refused = NULL
    lack.furthest_frame = lack.refused_frame = NO_FRAME


cdef Gap _gap_and_edge(const History* history, int64_t time_ns, int64_t* edge_ns) noexcept nogil:
    # `edge_ns`: the stamp nearest to the time; 0 without samples.
    cdef Gap gap = history_gap(history, time_ns)
    edge_ns[0] = history.oldest_ns if gap == GAP_PAST else history.newest_ns
    return gap


cdef uint64_t _missing_ns(const History* history, int64_t time_ns) noexcept nogil:
    cdef int64_t edge_ns
    if _gap_and_edge(history, time_ns, &edge_ns) == GAP_EMPTY:
        return UINT64_MAX
    return <uint64_t>max(time_ns, edge_ns) - <uint64_t>min(time_ns, edge_ns)


cdef void _lack_add(Lack* lack, const History* history, FrameId frame, int64_t time_ns) noexcept nogil:
    if lack.first == NULL:
        lack.first = history
    elif _missing_ns(history, time_ns) <= _missing_ns(lack.furthest, time_ns):
        return
    lack.furthest = history
    lack.furthest_frame = frame


cdef void lack_check(Lack* lack, const History* history, FrameId frame, int64_t time_ns, const Policy* policy,
                     int64_t tolerance_ns) noexcept nogil:
    cdef Transform not_needed
    cdef int64_t used_ns
    cdef Gap gap
    if policy.is_given:
        gap = history_transform_under(history, time_ns, policy, tolerance_ns, &not_needed, &used_ns)
    else:
        gap = history_gap(history, time_ns)
    if gap == GAP_NONE:
        return
    if gap < GAP_LONG:
        _lack_add(lack, history, frame, time_ns)
    elif lack.refused == NULL:
        lack.refused = history
        lack.refused_frame = frame
        lack.refusal = gap


cdef Status _extrapolation(const Lack* source, const Lack* target, int64_t time_ns) noexcept nogil:
    # At least one of the two has a `first`.
    cdef Status status = status_of(STATUS_EXTRAPOLATION)
    cdef const History* quoted = source.first
    cdef Lack both = source[0]
    if quoted == NULL or (target.first != NULL and target.first.newest_ns > quoted.newest_ns):
        quoted = target.first
    if target.first != NULL:
        _lack_add(&both, target.furthest, target.furthest_frame, time_ns)
    status.requested_ns = time_ns
    status.quoted_gap = _gap_and_edge(quoted, time_ns, &status.other_ns)
    status.child = both.furthest_frame
    status.gap = _gap_and_edge(both.furthest, time_ns, &status.edge_ns)
    if status.gap == GAP_PAST:
        status.parent = history_oldest_parent(both.furthest)
    else:
        status.parent = history_newest_parent(both.furthest)
    return status


cdef Status _refused(const Lack* lack, int64_t time_ns) noexcept nogil:
    cdef Status status = status_of(STATUS_EXTRAPOLATION)
    status.gap = lack.refusal
    status.child = lack.refused_frame
    status.parent = NO_FRAME
    status.requested_ns = time_ns
    history_stamps_around(lack.refused, time_ns, &status.edge_ns, &status.other_ns)
    return status


cdef Status lack_status(const Lack* source, const Lack* target, int64_t time_ns) noexcept nogil:
    if source.first != NULL or target.first != NULL:
        return _extrapolation(source, target, time_ns)
    if target.refused != NULL:
        return _refused(target, time_ns)
    if source.refused != NULL:
        return _refused(source, time_ns)
    return status_of(STATUS_OK)


# The limit of a frame, by its name: a policy may be older than the frame, and serves several buffers.

cdef int64_t limit_of_name(const FrameLimits* limits, const char* name, size_t size,
                           uint32_t* index) noexcept nogil:
    cdef uint32_t i
    for i in range(limits.count):
        if <size_t>limits.named[i].size == size and memcmp(limits.named[i].name, name, size) == 0:
            index[0] = i
            return limits.named[i].limit_ns
    return limits.others_ns


cdef int64_t _limit_ns(const Tree* tree, const FrameLimits* limits, FrameId frame,
                       uint32_t* index) noexcept nogil:
    cdef const Name* name = &tree.names.names[frame]
    return limit_of_name(limits, tree.names.text + name.start, name.size, index)


cdef inline int64_t policy_tolerance(const Tree* tree, FrameId frame, const Policy* policy) noexcept nogil:
    cdef uint32_t index
    return _limit_ns(tree, &policy.tolerance, frame, &index) if policy.is_given else 0


# Along a known path: the composed transform, or which histories do not answer.

cdef inline void _check_side(const Tree* tree, const FrameId* frames, uint32_t hops, int64_t time_ns,
                             const Policy* policy, Lack* lack) noexcept nogil:
    cdef int64_t tolerance_ns
    cdef uint32_t i
    lack_init(lack)
    for i in range(hops):
        tolerance_ns = policy_tolerance(tree, frames[i], policy)
        lack_check(lack, &tree.histories[frames[i]], frames[i], time_ns, policy, tolerance_ns)


cdef Status _path_lack(const Tree* tree, const Path* path, int64_t time_ns,
                       const Policy* policy) noexcept nogil:
    # STATUS_OK: every history of the path has an answer.
    cdef Lack source, target
    _check_side(tree, path.source, path.source_hops, time_ns, policy, &source)
    _check_side(tree, path.target, path.target_hops, time_ns, policy, &target)
    return lack_status(&source, &target, time_ns)


cdef inline void _prefetch_side(const Tree* tree, const FrameId* frames, uint32_t hops, int64_t time_ns,
                                uint32_t* hints) noexcept nogil:
    cdef uint32_t i
    for i in range(hops):
        hints[i] = history_prefetch(&tree.histories[frames[i]], time_ns)


cdef inline bint _hop(const Tree* tree, FrameId frame, int64_t time_ns, uint32_t hint, const Policy* policy,
                      Transform* out, int64_t* stamp_ns) noexcept nogil:
    # `policy` may be NULL; under one, `stamp_ns` falls to the oldest stamp used. False: no answer.
    cdef const History* history = &tree.histories[frame]
    cdef int64_t used_ns
    if policy == NULL:
        return history_transform_at(history, time_ns, hint, out) == GAP_NONE
    if history_transform_under(
            history, time_ns, policy, policy_tolerance(tree, frame, policy), out, &used_ns) != GAP_NONE:
        return False
    stamp_ns[0] = min(stamp_ns[0], used_ns)
    return True


cdef inline bint _compose_side(const Tree* tree, const FrameId* frames, const uint32_t* hints, uint32_t hops,
                               int64_t time_ns, const Policy* policy, Transform* out,
                               int64_t* stamp_ns) noexcept nogil:
    # From frames[0] up all hops, as _hop; hops > 0. False, and `out` undefined: a history does not answer.
    # Composed from the top down: so a hop's translation waits only for the rotation above it, not for the
    # translations of all other hops.
    cdef Transform hop
    cdef uint32_t i = hops - 1
    if not _hop(tree, frames[i], time_ns, hints[i], policy, out, stamp_ns):
        return False
    while i:
        i -= 1
        if not _hop(tree, frames[i], time_ns, hints[i], policy, &hop, stamp_ns):
            return False
        transform_compose(out, &hop, out)
    return True


cdef Status _path_transform(const Tree* tree, const Path* path, int64_t time_ns, const Policy* policy,
                            Transform* out, int64_t* stamp_ns) noexcept nogil:
    # From the source to the target at a time; with `out` NULL, only whether every history answers.
    cdef Transform source_side, target_side
    cdef uint32_t source_hints[MAX_HOPS + 1]
    cdef uint32_t target_hints[MAX_HOPS + 1]
    cdef const Policy* given = policy if policy.is_given else NULL
    if out == NULL:
        return _path_lack(tree, path, time_ns, policy)
    transform_identity(&source_side)
    transform_identity(&target_side)
    _prefetch_side(tree, path.target, path.target_hops, time_ns, target_hints)
    _prefetch_side(tree, path.source, path.source_hops, time_ns, source_hints)
    if path.target_hops and not _compose_side(
            tree, path.target, target_hints, path.target_hops, time_ns, given, &target_side, stamp_ns):
        return _path_lack(tree, path, time_ns, policy)
    if path.source_hops and not _compose_side(
            tree, path.source, source_hints, path.source_hops, time_ns, given, &source_side, stamp_ns):
        return _path_lack(tree, path, time_ns, policy)
    if path.target_hops:
        transform_between(&target_side, &source_side, out)
    else:
        out[0] = source_side
    # Rounding makes long chains drift from unit length.
    quaternion_normalize(out.rotation)
    quaternion_canonicalize(out.rotation)
    return status_of(STATUS_OK)


# The path between two different frames. All walks take tf2's order: up from the source to its root, then up
# from the target until that is met. The order decides what a tree that contains a loop answers.

cdef FrameId _parent_within(const Tree* tree, FrameId frame, int64_t time_ns,
                            const Policy* policy) noexcept nogil:
    # NO_FRAME: it has no answer, neither at the time nor within its tolerance before it.
    cdef const History* history = &tree.histories[frame]
    history_beyond(history, policy, policy_tolerance(tree, frame, policy), &time_ns)
    return history_parent_at(history, time_ns)


cdef inline FrameId _parent_by_link(const Tree* tree, FrameId frame, int64_t time_ns, const Policy* policy,
                                    bint* mixed) noexcept nogil:
    cdef uint32_t parent = tree.parents[frame]
    if not parent & MIXED_PARENTS:
        return parent
    mixed[0] = True
    if time_ns == NEWEST:
        return parent & ~<uint32_t>MIXED_PARENTS
    return _parent_within(tree, frame, time_ns, policy)


cdef inline Status _met_at_top(Path* path, uint32_t source_hops, uint32_t target_hops) noexcept nogil:
    # Both sides of the path lead to the same frame. Above their lowest common ancestor they are the same.
    while source_hops and target_hops and path.source[source_hops - 1] == path.target[target_hops - 1]:
        source_hops -= 1
        target_hops -= 1
    path.source_hops = source_hops
    path.target_hops = target_hops
    path.top = path.source[source_hops]
    return status_of(STATUS_OK)


cdef Status _walk_path(const Tree* tree, FrameId target, FrameId source, int64_t time_ns,
                       const Policy* policy, Path* path, bint* mixed) noexcept nogil:
    # Only the path, at a time or at NEWEST, by the parents that frames have where they have data. `mixed` is
    # set if a visited frame had several parents, so that the path may differ at other times.
    cdef FrameId frame = source
    cdef FrameId top
    cdef uint32_t source_hops = 0
    cdef uint32_t hops = 0
    cdef Status unconnected
    while True:
        __builtin_prefetch(&tree.histories[frame])
        path.source[source_hops] = top = frame
        frame = NO_FRAME if top == target else _parent_by_link(tree, top, time_ns, policy, mixed)
        if frame == NO_FRAME:
            break
        if source_hops == MAX_HOPS:
            return status_of(STATUS_LOOP)
        source_hops += 1
    frame = target
    while frame != top:
        __builtin_prefetch(&tree.histories[frame])
        path.target[hops] = frame
        if frame == source:
            return _met_at_top(path, 0, hops)
        frame = _parent_by_link(tree, frame, time_ns, policy, mixed)
        if frame == NO_FRAME:
            unconnected = status_of(STATUS_UNCONNECTED)
            unconnected.child, unconnected.parent = top, path.target[hops]
            return unconnected
        if hops == MAX_HOPS:
            return status_of(STATUS_LOOP)
        hops += 1
    return _met_at_top(path, source_hops, hops)


cdef Status _walk_to_gaps(const Tree* tree, FrameId target, FrameId source, int64_t time_ns,
                          const Policy* policy, Path* path) noexcept nogil:
    # The walk of tf2, which ends at the first frame without an answer, also above the path. It finds why
    # there is none, and in a loop perhaps another path.
    cdef FrameId frame = source
    cdef FrameId top = source
    cdef FrameId parent
    cdef Lack source_lack, target_lack
    cdef Status unconnected
    cdef uint32_t source_hops = 0
    cdef uint32_t hops = 0
    lack_init(&source_lack)
    lack_init(&target_lack)
    while True:
        path.source[source_hops] = top = frame
        if tree.histories[frame].kind == HISTORY_NONE:
            break
        frame = _parent_within(tree, top, time_ns, policy)
        if frame == NO_FRAME:
            _lack_add(&source_lack, &tree.histories[top], top, time_ns)
            break
        if top == target:
            break
        if source_hops == MAX_HOPS:
            return status_of(STATUS_LOOP)
        source_hops += 1
    frame = target
    while frame != top and tree.histories[frame].kind != HISTORY_NONE:
        path.target[hops] = frame
        parent = _parent_within(tree, frame, time_ns, policy)
        if parent == NO_FRAME:
            _lack_add(&target_lack, &tree.histories[frame], frame, time_ns)
            return _extrapolation(&source_lack, &target_lack, time_ns)
        if frame == source:
            return _met_at_top(path, 0, hops)
        if hops == MAX_HOPS:
            return status_of(STATUS_LOOP)
        hops += 1
        frame = parent
    if frame == top:
        return _met_at_top(path, source_hops, hops)
    if source_lack.first != NULL:
        return _extrapolation(&source_lack, &target_lack, time_ns)
    unconnected = status_of(STATUS_UNCONNECTED)
    unconnected.child, unconnected.parent = top, frame
    return unconnected


cdef Status _walk_common_time(const Tree* tree, FrameId target, FrameId source, Path* path,
                              int64_t* common_ns, bint* mixed) noexcept nogil:
    cdef Policy nothing
    cdef Status status
    nothing.is_given = False
    status = _walk_path(tree, target, source, NEWEST, &nothing, path, mixed)
    if status.code == STATUS_OK:
        common_ns[0] = path_common_time(tree, path)
    return status


cdef Status walk_common_time(const Tree* tree, FrameId target, FrameId source, Path* path,
                             int64_t* common_ns) noexcept nogil:
    cdef bint mixed = False
    if target == source:
        common_ns[0] = tree.histories[source].newest_ns
        return status_of(STATUS_OK)
    return _walk_common_time(tree, target, source, path, common_ns, &mixed)


cdef bint _is_stale(const Tree* tree, FrameId frame, int64_t now_ns, const Policy* policy,
                    int64_t* excess_ns, Status* status) noexcept nogil:
    # Whether the newest sample is too old, by more than `excess_ns`, which then rises; `status` is about it.
    cdef const History* history = &tree.histories[frame]
    cdef uint32_t index = 0
    cdef int64_t limit_ns = _limit_ns(tree, &policy.max_age, frame, &index)
    cdef int64_t age_ns
    if limit_ns == INT64_MAX:
        return False
    if history.kind == HISTORY_STATIC:
        # Without an age, it would pass, and the caller would believe that old data is refused.
        if policy.max_age.count:
            excess_ns[0] = INT64_MAX
            status.code = STATUS_BAD_LIMIT
            status.gap = GAP_NONE
            status.child = frame
            status.parent = policy.tolerance.count + index
        return False
    age_ns = age_at(history.newest_ns, now_ns)
    if age_ns - limit_ns <= excess_ns[0]:
        return False
    excess_ns[0] = age_ns - limit_ns
    status[0] = status_of(STATUS_EXTRAPOLATION)
    status.gap = GAP_STALE
    status.child = frame
    status.parent = history_newest_parent(history)
    status.requested_ns = now_ns
    status.edge_ns = history.newest_ns
    status.other_ns = limit_ns
    return True


cdef Status _judge_ages(const Tree* tree, FrameId target, FrameId source, const Policy* policy,
                        const Path* path, Status status) noexcept nogil:
    # The status of a lookup of the latest time, once the ages of the moving frames are judged: it names the
    # frame that is furthest beyond its limit. A lookup that fails because there is no common time does so
    # mostly because a frame is stale, so staleness is the better reason. The stale frame may be only on the
    # newest path: where a frame has changed its parent, or in a loop, the answer may be that of another path.
    cdef int64_t now_ns = system_ns() if policy.clock.is_system else policy.clock.now_ns
    cdef int64_t excess_ns = 0
    cdef int64_t common_ns
    cdef Path newest
    cdef Status stale = status
    if status.code not in (STATUS_OK, STATUS_EXTRAPOLATION):
        return status
    if status.code == STATUS_OK:
        _judge_path(tree, path, now_ns, policy, &excess_ns, &stale)
    if walk_common_time(tree, target, source, &newest, &common_ns).code == STATUS_OK:
        _judge_path(tree, &newest, now_ns, policy, &excess_ns, &stale)
    return stale


cdef void _judge_path(const Tree* tree, const Path* path, int64_t now_ns, const Policy* policy,
                      int64_t* excess_ns, Status* status) noexcept nogil:
    cdef uint32_t i
    for i in range(path.target_hops):
        _is_stale(tree, path.target[i], now_ns, policy, excess_ns, status)
    for i in range(path.source_hops):
        _is_stale(tree, path.source[i], now_ns, policy, excess_ns, status)


cdef Status _answer_at(const Tree* tree, FrameId target, FrameId source, int64_t time_ns, bint found,
                       const Policy* policy, Path* path, Transform* out, int64_t* stamp_ns) noexcept nogil:
    # At a time for which the links of the frames lead along `path`, if that was found.
    cdef Status status = status_of(STATUS_UNCONNECTED)
    cdef Status met
    if found:
        stamp_ns[0] = time_ns
        status = _path_transform(tree, path, time_ns, policy, out, stamp_ns)
        if status.code == STATUS_OK:
            return status
    stamp_ns[0] = time_ns
    met = _walk_to_gaps(tree, target, source, time_ns, policy, path)
    if met.code == STATUS_OK:
        return _path_transform(tree, path, time_ns, policy, out, stamp_ns)
    # Of what is missing, the first walk knows better: the second one may meet a gap above the path.
    return status if found and met.code == STATUS_EXTRAPOLATION else met


cdef Status walk_lookup(const Tree* tree, FrameId target, FrameId source, int64_t time_ns,
                        const Policy* policy, Path* path, Transform* out, int64_t* stamp_ns) noexcept nogil:
    cdef bint mixed = False
    cdef bint found
    cdef Status status
    stamp_ns[0] = time_ns
    if target == source:
        path.source_hops = path.target_hops = 0
        path.top = source
        if time_ns == 0:
            stamp_ns[0] = tree.histories[source].newest_ns
        if out != NULL:
            transform_identity(out)
        return status_of(STATUS_OK)
    if time_ns:
        found = _walk_path(tree, target, source, time_ns, policy, path, &mixed).code == STATUS_OK
        return _answer_at(tree, target, source, time_ns, found, policy, path, out, stamp_ns)
    status = _walk_common_time(tree, target, source, path, &time_ns, &mixed)
    if status.code != STATUS_OK:
        return status
    # At the common time a frame may have another parent than at its newest stamp.
    found = not mixed or _walk_path(tree, target, source, time_ns, policy, path, &mixed).code == STATUS_OK
    status = _answer_at(tree, target, source, time_ns, found, policy, path, out, stamp_ns)
    if policy.is_given and policy.judges_age:
        return _judge_ages(tree, target, source, policy, path, status)
    return status


cdef int64_t _unchanged_since(const PinnedTree* pinned, int64_t time_ns) noexcept nogil:
    # The earliest time, at least 1, from which on a walk between pinned frames is the same as at `time_ns`.
    # Frames above the path count, too: a walk in tf2's order passes them, and may meet a loop there.
    cdef int64_t since_ns = 1
    cdef uint32_t i
    for i in range(pinned.count):
        since_ns = max(since_ns, history_unchanged_since(&pinned.view.histories[pinned.frames[i]], time_ns))
    return since_ns


cdef int64_t _begin_of_side(const Tree* tree, const FrameId* frames, uint32_t hops) noexcept nogil:
    cdef int64_t begin_ns = INT64_MIN
    cdef uint32_t i
    for i in range(hops):
        if tree.histories[frames[i]].kind == HISTORY_DYNAMIC:
            begin_ns = max(begin_ns, tree.histories[frames[i]].oldest_ns)
    return begin_ns


cdef int64_t _path_begin(const Tree* tree, const Path* path) noexcept nogil:
    # The newest of the oldest stamps of the moving frames; INT64_MIN: none of them moves.
    return max(_begin_of_side(tree, path.source, path.source_hops),
               _begin_of_side(tree, path.target, path.target_hops))


cdef Status walk_time_range(const PinnedTree* pinned, FrameId target, FrameId source,
                            TimeRange* answered) noexcept nogil:
    cdef const Tree* tree = &pinned.view
    cdef Policy nothing
    cdef Path path
    cdef int64_t stamp_ns
    cdef Status status
    nothing.is_given = False
    status = walk_lookup(tree, target, source, 0, &nothing, &path, NULL, &answered.last)
    if status.code != STATUS_OK:
        return status
    if _path_begin(tree, &path) == INT64_MIN:
        answered.last = MAX_STAMP_NS
    answered.first = answered.last
    while answered.first > 0:
        answered.first = _unchanged_since(pinned, answered.first)
        if answered.first == 1:
            # The lookup at 0 asks for the latest time, so samples decide whether 0 belongs to the range.
            walk_lookup(tree, target, source, 1, &nothing, &path, NULL, &stamp_ns)
            answered.first = _path_begin(tree, &path) > 0
            break
        if walk_lookup(tree, target, source, answered.first - 1, &nothing, &path, NULL,
                       &stamp_ns).code != STATUS_OK:
            break
        answered.first -= 1
    return status


# The query: names to frames, the halves of a two-time lookup.

cdef inline FrameId _query_frame(const Tree* tree, const char* name, Py_ssize_t size) noexcept nogil:
    return NO_FRAME if name_is_invalid(name, size) else tree_frame(tree, name, size)


cdef Status query_end_frames(const Tree* tree, const Query* query, FrameId* target,
                             FrameId* source) noexcept nogil:
    target[0] = _query_frame(tree, query.target, query.target_size)
    source[0] = _query_frame(tree, query.source, query.source_size)
    if target[0] == NO_FRAME:
        return status_of(STATUS_BAD_TARGET)
    if source[0] == NO_FRAME:
        return status_of(STATUS_BAD_SOURCE)
    return status_of(STATUS_OK)


cdef bint query_is_identity(const Query* query) noexcept nogil:
    return (query.fixed == NULL and query.target_size == query.source_size
            and memcmp(query.target, query.source, query.source_size) == 0)


cdef bint _has_bad_limit(const Tree* tree, const FrameLimits* limits, uint32_t first,
                         QueryFrames* frames) noexcept nogil:
    # Whether a frame of a limit was never a child. `first`: the index of the first limit, as in Status.
    cdef uint32_t i
    for i in range(limits.count):
        frames.badly_limited = tree_frame(tree, limits.named[i].name, limits.named[i].size)
        if tree.histories[frames.badly_limited].kind == HISTORY_NONE:
            frames.bad_limit = first + i
            return True
    return False


cdef Status query_find_frames(const Tree* tree, const Query* query, QueryFrames* frames) noexcept nogil:
    cdef Status status
    frames.fixed = NO_FRAME
    frames.bad_limit = UINT32_MAX
    if query.policy.is_given and not _has_bad_limit(tree, &query.policy.tolerance, 0, frames):
        _has_bad_limit(tree, &query.policy.max_age, query.policy.tolerance.count, frames)
    if query_is_identity(query):
        frames.target = frames.source = tree_frame(tree, query.source, query.source_size)
        return status_of(STATUS_OK)
    status = query_end_frames(tree, query, &frames.target, &frames.source)
    if status.code == STATUS_OK and query.fixed != NULL:
        frames.fixed = _query_frame(tree, query.fixed, query.fixed_size)
        if frames.fixed == NO_FRAME:
            return status_of(STATUS_BAD_FIXED)
    return status


cdef Status query_answer(const Tree* tree, const Query* query, Transform* out,
                         int64_t* stamp_ns) noexcept nogil:
    cdef QueryFrames frames
    cdef Status status = query_find_frames(tree, query, &frames)
    if status.code != STATUS_OK:
        return status
    if frames.bad_limit != UINT32_MAX:
        return query_judge_limits(&frames, query_answer_between(tree, query, &frames, out, stamp_ns))
    return query_answer_between(tree, query, &frames, out, stamp_ns)


cdef Status query_judge_limits(const QueryFrames* frames, Status answered) noexcept nogil:
    cdef Status status = answered
    # While no path is known, a program has just started, and the frame of the limit may still appear.
    if frames.bad_limit != UINT32_MAX and status.code in (STATUS_OK, STATUS_EXTRAPOLATION):
        status.code = STATUS_BAD_LIMIT
        status.half = HALF_NONE
        status.parent = frames.bad_limit
        status.child = frames.badly_limited
    return status


cdef Status query_answer_between(const Tree* tree, const Query* query, const QueryFrames* frames,
                                 Transform* out, int64_t* stamp_ns) noexcept nogil:
    cdef Path path
    cdef FrameId target = frames.target
    cdef FrameId source = frames.source
    cdef FrameId fixed = frames.fixed
    cdef Status status
    cdef Transform source_half
    cdef int64_t source_stamp_ns
    if query.fixed == NULL:
        return walk_lookup(tree, target, source, query.source_ns, &query.policy, &path, out, stamp_ns)
    if out == NULL:
        # The reason names the half that fails first. tf2's can_transform begins with the target's ...
        status = walk_lookup(tree, target, fixed, query.target_ns, &query.policy, &path, NULL, stamp_ns)
        status.half = HALF_TARGET
        if status.code != STATUS_OK:
            return status
        status = walk_lookup(
            tree, fixed, source, query.source_ns, &query.policy, &path, NULL, &source_stamp_ns)
        status.half = HALF_SOURCE
        return status
    # ... and its lookup with the source's.
    status = walk_lookup(
        tree, fixed, source, query.source_ns, &query.policy, &path, &source_half, &source_stamp_ns)
    status.half = HALF_SOURCE
    if status.code != STATUS_OK:
        return status
    status = walk_lookup(tree, target, fixed, query.target_ns, &query.policy, &path, out, stamp_ns)
    status.half = HALF_TARGET
    if status.code != STATUS_OK:
        return status
    transform_compose(out, &source_half, out)
    quaternion_canonicalize(out.rotation)
    return status
