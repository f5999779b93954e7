# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Between which times a transform changes nearly linearly: bounds of its rates, the times and poses."""

# Between two samples, a frame turns and moves at constant rates. So how far a transform differs from a linear
# change between two times is at most an eighth of the squared time between them, times the largest second
# derivative. That follows from the rates, and does not miss what happens between times that are looked at.

cdef struct Rates:
    # Of frames that are nested in each other, from the innermost to the outermost: upper bounds.
    double turn         # rad/s
    double distance     # of the innermost origin from the outermost frame, meters
    double speed        # of that origin, m/s
    double acceleration     # m/s^2


cdef void _add_inner(Rates* rates, const History* history, int64_t begin_ns, int64_t end_ns) noexcept nogil:
    # Adds a frame within these, which has no stamp between the two times.
    cdef const Transform* older
    cdef const Transform* newer
    cdef double moved[3]
    cdef double turned[3]
    cdef double distance = vector_length(history_newest_transform(history).translation)
    cdef double speed = 0.0
    cdef double turn = 0.0
    cdef double per_s
    cdef uint32_t i
    cdef int k
    if history.kind == HISTORY_DYNAMIC and history.count > 1:
        # After the newest sample, the last two are those that an extrapolation continues.
        i = min(max(history_first_after(history, begin_ns), 1), history.count - 1)
        older = history_transform_of(history, i - 1)
        newer = history_transform_of(history, i)
        per_s = 1e9 / <double>max(history_stamp_of(history, i) - history_stamp_of(history, i - 1), <int64_t>1)
        for k in range(3):
            moved[k] = newer.translation[k] - older.translation[k]
        rotation_vector_between(older.rotation, newer.rotation, turned)
        speed = vector_length(moved) * per_s
        turn = vector_length(turned) * per_s
        distance = max(vector_length(older.translation), vector_length(newer.translation))
        distance += speed * 1e-9 * <double>max(end_ns - history.newest_ns, <int64_t>0)
    # What is outside turns this origin.
    rates.acceleration += rates.turn * (rates.turn * distance + 2.0 * speed)
    rates.speed += rates.turn * distance + speed
    rates.distance += distance
    rates.turn += turn


cdef double _pieces(const PinnedLookup* pinned, int64_t begin_ns, int64_t end_ns, double turn,
                    double move) noexcept nogil:
    # How many are needed between two stamps. At least two, so that also a time between samples is looked up,
    # where they may be too far apart.
    cdef const Path* path = &pinned.path
    cdef Rates source, target
    cdef double per_s, acceleration
    cdef uint32_t i
    memset(&source, 0, sizeof(Rates))
    memset(&target, 0, sizeof(Rates))
    for i in range(path.source_hops):
        _add_inner(&source, &pinned.histories[path.source_hops - 1 - i], begin_ns, end_ns)
    for i in range(path.target_hops):
        _add_inner(&target, &pinned.histories[pinned.hops - 1 - i], begin_ns, end_ns)
    # The source in the target: the difference of both, turned back by the target.
    acceleration = source.acceleration + target.acceleration + target.turn * (
        target.turn * (source.distance + target.distance) + 2.0 * (source.speed + target.speed))
    per_s = sqrt(max((source.turn + target.turn) * (source.turn + target.turn) / (8.0 * turn),
                     acceleration / (8.0 * move)))
    return max(ceil(per_s * 1e-9 * <double>(end_ns - begin_ns)), 2.0)


cdef Py_ssize_t series_knots(const Tree* tree, Lock* lock, const Query* query, Knots* knots) noexcept nogil:
    cdef PinnedLookup steady    # the one path whose samples lie between the knots
    cdef PinnedLookup pinned    # what the lookups read
    cdef Py_ssize_t count = SERIES_UNSTEADY
    cdef bint is_steady
    cdef bint is_pinned = False
    knots.times_ns = NULL
    knots.matrices = NULL
    lock_acquire(lock)
    is_steady = query_find_frames(tree, query, &steady.frames).code == STATUS_OK
    is_steady = is_steady and series_pin_path(tree, query, &steady)
    if is_steady:
        pinned.frames = steady.frames
        is_pinned = series_pin(tree, query, &pinned) == 0
    lock_release(lock)
    if is_pinned:
        count = _knots_on_path(query, &steady, &pinned, knots)
        series_unpin(&pinned)
    elif is_steady:
        count = SERIES_NO_MEMORY
    if is_steady:
        series_unpin(&steady)
    return count


cdef Py_ssize_t _knots_on_path(const Query* query, const PinnedLookup* steady, PinnedLookup* pinned,
                               Knots* knots) noexcept nogil:
    # Returns as series_knots.
    cdef TimeSeries series
    cdef Status status
    cdef int64_t* stamps_ns = NULL
    cdef Py_ssize_t count = _stamps_between(steady, knots, &stamps_ns)
    if count > 0:
        count = _knots_between(steady, stamps_ns, count, knots)
    free(stamps_ns)
    if count < 0:
        return count
    knots.matrices = <double*>malloc(16 * count * sizeof(double))
    if knots.matrices == NULL:
        return SERIES_NO_MEMORY
    series_begin(&series, knots.times_ns, count)
    series.matrices = knots.matrices
    return count if series_answer(query, pinned, &series, &status) == count else SERIES_UNSTEADY


cdef Py_ssize_t _stamps_between(const PinnedLookup* pinned, const Knots* knots,
                                int64_t** stamps_ns) noexcept nogil:
    # The two times, and the stamps of the frames between them. Returns as series_knots.
    cdef uint32_t begins[LONG_PATH]
    cdef uint32_t ends[LONG_PATH]
    cdef uint32_t i, k
    cdef Py_ssize_t count = 2
    cdef int64_t stamp_ns, last_stamp_ns
    for i in range(pinned.hops):
        begins[i] = ends[i] = 0
        if pinned.histories[i].kind == HISTORY_DYNAMIC:
            begins[i] = history_first_after(&pinned.histories[i], knots.first_ns)
            # The transform jumps at the first time.
            if begins[i] > 1 and knots.first_ns == history_stamp_of(&pinned.histories[i], begins[i] - 2):
                return SERIES_UNSTEADY
            ends[i] = max(history_first_after(&pinned.histories[i], knots.last_ns), begins[i])
        if ends[i] - begins[i] > knots.most:
            return SERIES_UNSTEADY
        count += ends[i] - begins[i]
    stamps_ns[0] = <int64_t*>malloc(count * sizeof(int64_t))
    if stamps_ns[0] == NULL:
        return SERIES_NO_MEMORY
    stamps_ns[0][0] = knots.first_ns
    stamps_ns[0][1] = knots.last_ns
    count = 2
    for i in range(pinned.hops):
        last_stamp_ns = knots.first_ns
        for k in range(begins[i], ends[i]):
            stamp_ns = history_stamp_of(&pinned.histories[i], k)
            if stamp_ns == last_stamp_ns:
                return SERIES_UNSTEADY
            stamps_ns[0][count] = last_stamp_ns = stamp_ns
            count += 1
    return _sort_once(stamps_ns[0], count)


cdef Py_ssize_t _knots_between(const PinnedLookup* pinned, const int64_t* stamps_ns, Py_ssize_t count,
                               Knots* knots) noexcept nogil:
    # Returns as series_knots; from at least one stamp.
    cdef Py_ssize_t filled = 0
    cdef Py_ssize_t i
    cdef int64_t span_ns, pieces, k
    cdef double wanted
    knots.times_ns = <int64_t*>malloc((knots.most + 1) * sizeof(int64_t))
    if knots.times_ns == NULL:
        return SERIES_NO_MEMORY
    for i in range(count - 1):
        wanted = _pieces(pinned, stamps_ns[i], stamps_ns[i + 1], knots.turn, knots.move)
        if not wanted <= <double>(knots.most - filled - 1):
            return SERIES_UNSTEADY
        pieces = <int64_t>wanted
        span_ns = stamps_ns[i + 1] - stamps_ns[i]
        for k in range(pieces):
            # In two terms, because the product of all might overflow.
            knots.times_ns[filled] = stamps_ns[i] + span_ns // pieces * k + span_ns % pieces * k // pieces
            filled += 1
    knots.times_ns[filled] = stamps_ns[count - 1]
    return filled + 1


cdef int _compare(const void* a, const void* b) noexcept nogil:
    cdef int64_t first = (<const int64_t*>a)[0]
    cdef int64_t second = (<const int64_t*>b)[0]
    return (first > second) - (first < second)


cdef Py_ssize_t _sort_once(int64_t* values, Py_ssize_t count) noexcept nogil:
    # Ascending, without repetitions. Returns how many are left.
    cdef Py_ssize_t kept = 1
    cdef Py_ssize_t i
    qsort(values, count, sizeof(int64_t), _compare)
    for i in range(1, count):
        if values[i] != values[kept - 1]:
            values[kept] = values[i]
            kept += 1
    return kept
