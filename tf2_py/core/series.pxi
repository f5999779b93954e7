# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Look up at many times: the path is found once, the times are computed along it in batches."""

# Transforms of one batch of times at once, on plain arrays of doubles. All BATCH_TIMES entries are computed;
# those from `count` on, and the missing ones, hold a filler. The numbers are those of history_transform_at
# and of the functions in geometry_header.pxi; a batch composes them from the ends of the path up, a single
# lookup from the top down, so that the last digits may differ.

cdef enum:
    BATCH_TIMES = 64        # times; all arrays of a SeriesWork fit into the first-level cache


cdef struct Columns:
    # One transform per time.
    double t[3][BATCH_TIMES]        # translation x y z in meters
    double q[4][BATCH_TIMES]        # rotation x y z w


cdef struct SeriesWork "tf2_work":
    # All arrays are in one struct, so that the compiler knows that no two of them overlap. Each has one entry
    # per time.
    Columns older                   # the sample before the time ...
    Columns newer                   # ... the one after it ...
    double ratio[BATCH_TIMES]       # ... and how far between them the time lies, 0 .. 1
    double distance[BATCH_TIMES]    # of the two rotations, see interpolation_weights
    double sign[BATCH_TIMES]        # of their dot product: 1 or -1
    Columns hop                     # of the current frame, child to parent
    Columns target                  # from the target up to the current frame's parent
    Columns result                  # the same from the source; in the end the answers
    double turn[9][BATCH_TIMES]     # the rotation matrices of the answers, row by row
    unsigned char missing[BATCH_TIMES]      # 1: some history does not answer for this time


cdef enum Step:
    INTERPOLATE         # hop = the frame's transforms at the times
    CLIMB_SOURCE        # result = hop result
    CLIMB_TARGET        # target = hop target
    BETWEEN             # result = target^-1 result
    FINISH              # result, of unit length and canonical sign as at the end of a single lookup
    APPLY               # result = hop result, of canonical sign
    TURN                # turn = the rotation matrices of the result


cdef extern from *:
    """
    /* The steps are compiled for every x86-64, for AVX2 and for AVX-512. The numbers are the same, because
       -ffp-contract=off keeps multiply and add apart. Processors that have AVX-512 but not its VBMI2 lower
       their clock for it. */
    struct tf2_work;
    #if defined(__x86_64__) && defined(__GNUC__)
    static inline __attribute__((always_inline)) void tf2_step(struct tf2_work *, int);
    static __attribute__((target("avx512f"), flatten)) void tf2_step_512(struct tf2_work *work, int step) {
        tf2_step(work, step);
    }
    static __attribute__((target("avx2"), flatten)) void tf2_step_256(struct tf2_work *work, int step) {
        tf2_step(work, step);
    }
    static void tf2_wide_step(struct tf2_work *work, int step) {
        if (__builtin_cpu_supports("avx512vbmi2"))
            tf2_step_512(work, step);
        else if (__builtin_cpu_supports("avx2"))
            tf2_step_256(work, step);
        else
            tf2_step(work, step);
    }
    #else
    static void tf2_step(struct tf2_work *, int);
    #define tf2_wide_step tf2_step
    #endif
    """
    void _do "tf2_wide_step"(SeriesWork* work, int step) noexcept nogil


cdef inline void _put(Columns* columns, uint32_t i, const Transform* value) noexcept nogil:
    cdef int k
    for k in range(3):
        columns.t[k][i] = value.translation[k]
    for k in range(4):
        columns.q[k][i] = value.rotation[k]


cdef void _fill(Columns* columns, const Transform* value) noexcept nogil:
    cdef uint32_t i
    for i in range(BATCH_TIMES):
        _put(columns, i, value)


cdef void _gather(SeriesWork* work, const History* history, const int64_t* times_ns, uint32_t count,
                  uint32_t* hint) noexcept nogil:
    cdef uint32_t hints[BATCH_TIMES]
    cdef uint32_t i
    cdef Transform identity
    cdef Neighbors around
    cdef uint64_t spacing_ns = (history.newest_ns - history.oldest_ns) // max(history.count, 1)
    # The times that have the same neighbors as the last one. Differences are compared as unsigned numbers,
    # because a branch for each bound would be mispredicted for half of all random times.
    cdef int64_t first_ns = 0
    cdef uint64_t span_ns = 0
    transform_identity(&identity)
    for i in range(count):
        # A time shortly after the one before is found from there.
        if i > 0 and <uint64_t>times_ns[i] - <uint64_t>times_ns[i - 1] <= spacing_ns:
            hints[i] = NEWEST_HINT
        else:
            hints[i] = history_prefetch(history, times_ns[i])
    for i in range(count):
        if <uint64_t>times_ns[i] - <uint64_t>first_ns >= span_ns:
            # In a short history the place of the previous time is the better hint.
            if hints[i] != NEWEST_HINT:
                hint[0] = hints[i]
            if history_neighbors(history, times_ns[i], hint, &around) != GAP_NONE:
                work.missing[i] = 1
                around.older = around.newer = &identity
                around.older_ns = around.newer_ns = 0
            first_ns = around.older_ns + 1
            span_ns = max(around.newer_ns - first_ns, 0)
        _put(&work.older, i, around.older)
        _put(&work.newer, i, around.newer)
        work.ratio[i] = neighbors_ratio(&around, times_ns[i])
    for i in range(count, BATCH_TIMES):
        _put(&work.older, i, &identity)
        _put(&work.newer, i, &identity)
        work.ratio[i] = 0.0


cdef inline void _weigh(SeriesWork* work, uint32_t i, double weight_a, double weight_b) noexcept nogil:
    cdef int k
    for k in range(4):
        work.hop.q[k][i] = weight_a * work.older.q[k][i] + weight_b * work.newer.q[k][i]


cdef inline void _interpolate(SeriesWork* work) noexcept nogil:
    # As history_transform_at, whose weights these are.
    cdef uint32_t i
    cdef double ratio, weight_a, weight_b
    cdef int k
    for i in range(BATCH_TIMES):
        ratio = work.ratio[i]
        for k in range(3):
            work.hop.t[k][i] = (1.0 - ratio) * work.older.t[k][i] + ratio * work.newer.t[k][i]
        work.distance[i] = interpolation_weights(
            work.older.q[0][i], work.older.q[1][i], work.older.q[2][i], work.older.q[3][i],
            work.newer.q[0][i], work.newer.q[1][i], work.newer.q[2][i], work.newer.q[3][i],
            ratio, &work.sign[i], &weight_a, &weight_b)
        _weigh(work, i, weight_a, weight_b)
    for i in range(BATCH_TIMES):
        if work.distance[i] > FAR_APART:
            far_interpolation_weights(work.distance[i], work.ratio[i], work.sign[i], &weight_a, &weight_b)
            _weigh(work, i, weight_a, weight_b)


cdef inline void _compose(const Columns* a, Columns* b, bint inverts) noexcept nogil:
    # b = a b, as transform_compose; or b = a^-1 b, as transform_between. Called with a constant.
    cdef uint32_t i
    cdef double sign = -1.0 if inverts else 1.0
    cdef double ux, uy, uz, w, vx, vy, vz, cx, cy, cz, bx, by, bz, bw
    cdef int k
    for i in range(BATCH_TIMES):
        for k in range(3 if inverts else 0):
            b.t[k][i] -= a.t[k][i]
        ux = sign * a.q[0][i]
        uy = sign * a.q[1][i]
        uz = sign * a.q[2][i]
        w = a.q[3][i]
        vx = b.t[0][i]
        vy = b.t[1][i]
        vz = b.t[2][i]
        cx = 2.0 * (uy * vz - uz * vy)
        cy = 2.0 * (uz * vx - ux * vz)
        cz = 2.0 * (ux * vy - uy * vx)
        b.t[0][i] = vx + w * cx + (uy * cz - uz * cy)
        b.t[1][i] = vy + w * cy + (uz * cx - ux * cz)
        b.t[2][i] = vz + w * cz + (ux * cy - uy * cx)
        for k in range(0 if inverts else 3):
            b.t[k][i] += a.t[k][i]
        bx = b.q[0][i]
        by = b.q[1][i]
        bz = b.q[2][i]
        bw = b.q[3][i]
        b.q[0][i] = w * bx + ux * bw + uy * bz - uz * by
        b.q[1][i] = w * by + uy * bw + uz * bx - ux * bz
        b.q[2][i] = w * bz + uz * bw + ux * by - uy * bx
        b.q[3][i] = w * bw - ux * bx - uy * by - uz * bz


cdef inline void _canonicalize(SeriesWork* work) noexcept nogil:
    # As quaternion_canonicalize; without branches
    cdef uint32_t i
    cdef double lead, sign, w
    cdef int k
    for i in range(BATCH_TIMES):
        lead = work.result.q[0][i]
        for k in range(1, 3):
            lead = work.result.q[k][i] if fabs(work.result.q[k][i]) > fabs(lead) else lead
        w = work.result.q[3][i]
        lead = lead if 4.0 * w * w <= 1.0 else w
        sign = -1.0 if lead < 0.0 else 1.0
        for k in range(4):
            work.result.q[k][i] *= sign


cdef inline void _finish(SeriesWork* work) noexcept nogil:
    cdef uint32_t i
    cdef double squared, scale
    cdef int k
    for i in range(BATCH_TIMES):
        squared = work.result.q[0][i] * work.result.q[0][i]
        for k in range(1, 4):
            squared += work.result.q[k][i] * work.result.q[k][i]
        scale = 1.0 / sqrt(squared)
        for k in range(4):
            work.result.q[k][i] *= scale
    _canonicalize(work)


cdef inline void _turn(SeriesWork* work) noexcept nogil:
    # As matrix_from_quaternion
    cdef double q[4]
    cdef double turn[9]
    cdef uint32_t i
    cdef int k
    for i in range(BATCH_TIMES):
        for k in range(4):
            q[k] = work.result.q[k][i]
        matrix_from_quaternion(q, turn)
        for k in range(9):
            work.turn[k][i] = turn[k]


cdef void _step "tf2_step"(SeriesWork* work, int step) noexcept nogil:
    if step == INTERPOLATE:
        _interpolate(work)
    elif step == CLIMB_SOURCE:
        _compose(&work.hop, &work.result, False)
    elif step == CLIMB_TARGET:
        _compose(&work.hop, &work.target, False)
    elif step == BETWEEN:
        _compose(&work.target, &work.result, True)
    elif step == FINISH:
        _finish(work)
    elif step == APPLY:
        _compose(&work.hop, &work.result, False)
        _canonicalize(work)
    else:
        _turn(work)


cdef inline void _store_column(const double* column, uint32_t count, double* out, int width) noexcept nogil:
    # Column by column, because the compiler would make shuffles of a loop that stores whole rows.
    cdef uint32_t i
    for i in range(count):
        out[width * i] = column[i]


cdef void _work_store(const SeriesWork* work, uint32_t count, double* translations,
                      double* rotations) noexcept nogil:
    # The first `count` results, to rows of three and four numbers.
    cdef int k
    for k in range(3):
        _store_column(work.result.t[k], count, translations + k, 3)
    for k in range(4):
        _store_column(work.result.q[k], count, rotations + k, 4)


cdef void work_store_matrices(SeriesWork* work, uint32_t count, double* matrices) noexcept nogil:
    # The first `count` results, to rows of sixteen numbers, as matrix_from_transform.
    cdef bint is_nan
    cdef uint32_t i
    cdef int row, k
    _do(work, TURN)
    for row in range(3):
        for k in range(3):
            _store_column(work.turn[3 * row + k], count, matrices + 4 * row + k, 16)
        _store_column(work.result.t[row], count, matrices + 4 * row + 3, 16)
    for i in range(count):
        is_nan = isnan(work.result.q[3][i])
        matrices[16 * i + 12] = matrices[16 * i + 13] = matrices[16 * i + 14] = NAN if is_nan else 0.0
        matrices[16 * i + 15] = NAN if is_nan else 1.0


cdef void work_transform_points(const SeriesWork* work, uint32_t count, const double* points,
                                double* out) noexcept nogil:
    # Each point with the result of its own time: rows of x y z in meters; `out` may be `points`.
    cdef uint32_t i
    cdef double q[4]
    cdef int k
    for i in range(count):
        for k in range(4):
            q[k] = work.result.q[k][i]
        vector_rotate(q, points + 3 * i, out + 3 * i)
        for k in range(3):
            out[3 * i + k] += work.result.t[k][i]


# A call may take long, so it pins the histories that it reads and releases the lock. Then no insert waits for
# it, and all of its answers belong to one state of the buffer.

cdef enum:
    LONG_PATH = 64          # hops; the data of a batch along a longer path would not fit into the cache


cdef struct Rests:
    # The first hops of one side of a path, as long as they are static, which are composed once.
    uint32_t hops
    Transform transform     # from the frame in which the path begins; the identity for no hops


cdef struct PinnedLookup:
    # A lookup, and pinned copies of what it reads. There are two ways to answer.
    # In batches: one path serves all times.
    bint by_batches
    Path path
    History histories[LONG_PATH]    # by hop, pinned: source side first
    uint32_t hints[LONG_PATH]       # by hop: where the last time was found
    uint32_t hops
    Rests source_rests, target_rests
    int64_t common_ns       # the latest common time, which time 0 means
    bint has_fixed          # a two-time lookup: to be composed with `fixed_to_target`
    Transform fixed_to_target
    # Otherwise, each time is a separate lookup between these frames.
    QueryFrames frames
    PinnedTree above        # all that is above them


cdef bint _find_path(const Tree* tree, const Query* query, PinnedLookup* pinned) noexcept nogil:
    # Whether one path serves all times. Lookups that fail at any time have none.
    cdef FrameId target = pinned.frames.target
    cdef FrameId source = pinned.frames.source
    cdef Path path
    cdef int64_t stamp_ns
    if pinned.has_fixed:
        if walk_lookup(tree, target, pinned.frames.fixed, query.target_ns, &query.policy, &path,
                       &pinned.fixed_to_target, &stamp_ns).code != STATUS_OK:
            return False
        target = pinned.frames.fixed
    if walk_common_time(tree, target, source, &pinned.path, &stamp_ns).code != STATUS_OK:
        return False
    return (tree_has_one_way_up(tree, source) and tree_has_one_way_up(tree, target)
            and pinned.path.source_hops + pinned.path.target_hops <= LONG_PATH)


cdef void _compose_rests(const History* histories, uint32_t hops, Rests* out) noexcept nogil:
    cdef const Transform* hop
    transform_identity(&out.transform)
    out.hops = 0
    while out.hops < hops and histories[out.hops].kind == HISTORY_STATIC:
        hop = history_newest_transform(&histories[out.hops])
        if out.hops == 0:
            out.transform = hop[0]
        else:
            transform_compose(hop, &out.transform, &out.transform)
        out.hops += 1


cdef bint series_pin_path(const Tree* tree, const Query* query, PinnedLookup* pinned) noexcept nogil:
    # With the lock held, once the frames are known. Pins the one path that serves all times; False: there is
    # none.
    cdef uint32_t i
    pinned.has_fixed = query.fixed != NULL
    pinned.hops = pinned.path.source_hops = pinned.path.target_hops = 0
    pinned.by_batches = query_is_identity(query) or _find_path(tree, query, pinned)
    if not pinned.by_batches:
        return False
    for i in range(pinned.path.source_hops):
        history_pin(&tree.histories[pinned.path.source[i]], &pinned.histories[i])
    pinned.hops = pinned.path.source_hops
    for i in range(pinned.path.target_hops):
        history_pin(&tree.histories[pinned.path.target[i]], &pinned.histories[pinned.hops + i])
    pinned.hops += pinned.path.target_hops
    for i in range(pinned.hops):
        pinned.hints[i] = NEWEST_HINT
    _compose_rests(pinned.histories, pinned.path.source_hops, &pinned.source_rests)
    _compose_rests(pinned.histories + pinned.path.source_hops, pinned.path.target_hops, &pinned.target_rests)
    return True


cdef int series_pin(const Tree* tree, const Query* query, PinnedLookup* pinned) noexcept nogil:
    # With the lock held, once the frames are known. -1: no memory.
    cdef FrameId[3] ends = [pinned.frames.target, pinned.frames.source, pinned.frames.fixed]
    if not query.policy.is_given and series_pin_path(tree, query, pinned):
        pinned.common_ns = path_common_time(tree, &pinned.path)
        return 0
    pinned.by_batches = False
    return tree_pin_above(tree, ends, 3, &pinned.above)


cdef void series_unpin(PinnedLookup* pinned) noexcept nogil:
    cdef uint32_t i
    if not pinned.by_batches:
        tree_unpin(&pinned.above)
        return
    for i in range(pinned.hops):
        history_unpin(&pinned.histories[i])


cdef void _hop_at_times(SeriesWork* work, const History* history, const int64_t* times_ns, uint32_t count,
                        uint32_t* hint) noexcept nogil:
    # hop = the frame's transforms at the times. `hint`: as in history_neighbors.
    if history.kind == HISTORY_STATIC:
        _fill(&work.hop, history_newest_transform(history))
    else:
        _gather(work, history, times_ns, count, hint)
        _do(work, INTERPOLATE)


cdef void _climb(PinnedLookup* pinned, uint32_t first, uint32_t hops, const Rests* rests,
                 const int64_t* times_ns, uint32_t count, SeriesWork* work, Columns* end,
                 Step step) noexcept nogil:
    # Composes one side of the path, whose hops begin at `first`, in `end`.
    cdef uint32_t i
    if rests.hops or not hops:
        _fill(end, &rests.transform)
    for i in range(rests.hops, hops):
        _hop_at_times(work, &pinned.histories[first + i], times_ns, count, &pinned.hints[first + i])
        if i == 0:
            end[0] = work.hop
        else:
            _do(work, step)


cdef void _answer_batch(PinnedLookup* pinned, const int64_t* asked_ns, uint32_t count,
                        SeriesWork* work) noexcept nogil:
    cdef const Path* path = &pinned.path
    cdef int64_t times_ns[BATCH_TIMES]
    cdef uint32_t i
    memset(work.missing, 0, BATCH_TIMES)
    for i in range(count):
        times_ns[i] = asked_ns[i] if asked_ns[i] else pinned.common_ns
    _climb(pinned, 0, path.source_hops, &pinned.source_rests, times_ns, count, work, &work.result,
           CLIMB_SOURCE)
    if path.target_hops:
        _climb(pinned, path.source_hops, path.target_hops, &pinned.target_rests, times_ns, count, work,
               &work.target, CLIMB_TARGET)
        _do(work, BETWEEN)
    if path.source_hops or path.target_hops:
        _do(work, FINISH)
    if pinned.has_fixed:
        _fill(&work.hop, &pinned.fixed_to_target)
        _do(work, APPLY)


cdef Status _batch_lack(const Query* query, const PinnedLookup* pinned, int64_t asked_ns) noexcept nogil:
    # Why a batch does not answer for a time, as in a single lookup.
    cdef const Path* path = &pinned.path
    cdef int64_t time_ns = asked_ns if asked_ns else pinned.common_ns
    cdef Lack source, target
    cdef uint32_t i, k
    lack_init(&source)
    lack_init(&target)
    for i in range(path.source_hops):
        lack_check(&source, &pinned.histories[i], path.source[i], time_ns, &query.policy, 0)
    for i in range(path.target_hops):
        k = path.source_hops + i
        lack_check(&target, &pinned.histories[k], path.target[i], time_ns, &query.policy, 0)
    return lack_status(&source, &target, time_ns)


cdef Status _answer_one(const Query* query, const PinnedLookup* pinned, int64_t time_ns,
                        Transform* out) noexcept nogil:
    cdef Query single = query[0]
    cdef int64_t stamp_ns
    single.source_ns = time_ns
    return query_judge_limits(
        &pinned.frames, query_answer_between(&pinned.above.view, &single, &pinned.frames, out, &stamp_ns))


cdef void _put_missing(Columns* columns, uint32_t i) noexcept nogil:
    cdef int k
    for k in range(3):
        columns.t[k][i] = NAN
    for k in range(4):
        columns.q[k][i] = NAN


cdef uint32_t _answer_times(const Query* query, PinnedLookup* pinned, const int64_t* times_ns, uint32_t count,
                            bint nan_missing, SeriesWork* work, Status* status) noexcept nogil:
    # Up to BATCH_TIMES times. Returns how many of `count` are answered; see series_lookup.
    cdef Transform transform
    cdef Status single
    cdef uint32_t i
    if pinned.by_batches:
        _answer_batch(pinned, times_ns, count, work)
    for i in range(count):
        if pinned.by_batches:
            if not work.missing[i]:
                continue
            if not nan_missing:
                status[0] = _batch_lack(query, pinned, times_ns[i])
                status.half = HALF_SOURCE if pinned.has_fixed else HALF_NONE
                return i
        else:
            single = _answer_one(query, pinned, times_ns[i], &transform)
            if single.code == STATUS_OK:
                _put(&work.result, i, &transform)
                continue
            if not nan_missing or single.code == STATUS_BAD_LIMIT:
                status[0] = single
                return i
        _put_missing(&work.result, i)
    return count


cdef Py_ssize_t series_answer(const Query* query, PinnedLookup* pinned, const TimeSeries* series,
                              Status* status) noexcept nogil:
    # Without the lock. Returns how many times are answered, as series_lookup.
    cdef SeriesWork work
    cdef Py_ssize_t start = 0
    cdef uint32_t count = 0
    cdef uint32_t answered = 0
    while start < series.count and answered == count:
        count = <uint32_t>min(<Py_ssize_t>BATCH_TIMES, series.count - start)
        answered = _answer_times(query, pinned, series.times_ns + start, count, series.nan_missing, &work,
                                 status)
        if series.points != NULL:
            work_transform_points(&work, answered, series.points + 3 * start, series.transformed + 3 * start)
        elif series.matrices != NULL:
            work_store_matrices(&work, answered, series.matrices + 16 * start)
        else:
            _work_store(&work, answered, series.translations + 3 * start, series.rotations + 4 * start)
        start += answered
    return start


cdef Py_ssize_t series_lookup(const Tree* tree, Lock* lock, const Query* query, const TimeSeries* series,
                              Status* status) noexcept nogil:
    cdef PinnedLookup pinned
    cdef Py_ssize_t answered
    cdef bint is_pinned = False
    lock_acquire(lock)
    status[0] = query_find_frames(tree, query, &pinned.frames)
    if status.code == STATUS_OK:
        is_pinned = series_pin(tree, query, &pinned) == 0
    lock_release(lock)
    if not is_pinned:
        return SERIES_BAD_NAME if status.code != STATUS_OK else SERIES_NO_MEMORY
    answered = series_answer(query, &pinned, series, status)
    series_unpin(&pinned)
    return answered
