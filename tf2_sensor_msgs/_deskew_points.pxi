# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause

# Move each point of a cloud with the pose of its own time: the loops of deskew, which _deskew.py calls.

# A point without a time, because one of its coordinates is NaN.
cdef int64_t NO_TIME = INT64_MIN


cdef Transform IDENTITY
memset(&IDENTITY, 0, sizeof(Transform))
IDENTITY.rotation[3] = 1.0


class Span(NamedTuple):
    """What the numbers in a field of times are like; see FieldSpan in avx2_points.h."""

    lowest: float
    highest: float
    points: int
    finite: int
    large: int


cdef void _extend_span(const char* points, const Grid* grid, const TimeSource* field, bint needs_point,
                       FieldSpan* span) noexcept nogil:
    # By a row of points.
    cdef const Triples* triples = &grid.triples[0]
    cdef Py_ssize_t quick = _quick_points(grid, grid.columns)
    cdef Py_ssize_t i = 0
    cdef const char* point
    cdef double value
    if needs_point and quick > 0:
        i = avx2_extend_span(points, grid.point_step, quick, triples.offsets[0], field, span)
    for i in range(i, grid.columns):
        point = points + i * grid.point_step
        if needs_point and _has_nan(point, triples):
            continue
        span.points += 1
        value = number_load(point + field.offset, field.number)
        if not isfinite(value):
            continue
        span.finite += 1
        span.large += 2147483648.0 <= value < 4611686018427387904.0
        span.lowest = min(span.lowest, value)
        span.highest = max(span.highest, value)


cdef Py_ssize_t _quick_points(const Grid* grid, Py_ssize_t count) noexcept nogil:
    # How many of a row's last `count` points can be read as floats, four at once: the quick way accesses 4
    # bytes behind z, and those behind the last point may lie outside.
    cdef const Triples* triples = &grid.triples[0]
    if _wide_size(triples) != 4:
        return 0
    return count if grid.point_step - triples.offsets[2] >= 8 else count - 1


cdef bint _time_of(const char* point, const TimeSource* field, int64_t* out) noexcept nogil:
    # The time of a point in ns; False if the number is not one. The limit of 2^62 ns, 146 years, leaves room
    # for the time that 0 means.
    cdef double value = number_load(point + field.offset, field.number)
    cdef double unit = <double>field.unit_ns
    cdef int64_t whole
    if not fabs(value * unit) < 4611686018427387904.0:
        return False
    # The product with the whole value would lose digits of the nanoseconds.
    whole = <int64_t>value
    out[0] = field.base_ns + whole * field.unit_ns + llrint((value - <double>whole) * unit)
    return True


cdef bint _has_nan(const char* point, const Triples* triples) noexcept nogil:
    cdef int i
    for i in range(3):
        if isnan(number_load(point + triples.offsets[i], triples.numbers[i])):
            return True
    return False


cdef Py_ssize_t _read_times(const char* points, const Grid* grid, const TimeSource* field, int64_t* times_ns,
                            double* bad_value) noexcept nogil:
    # The first point that has coordinates, but no time, or -1.
    cdef Py_ssize_t bad = -1
    cdef Py_ssize_t row, column, i
    cdef const char* point
    for row in range(grid.rows if grid.columns > 0 else 0):
        for column in range(grid.columns):
            i = row * grid.columns + column
            point = points + row * grid.row_step + column * grid.point_step
            if _has_nan(point, &grid.triples[0]):
                times_ns[i] = NO_TIME
                continue
            if field.number and not _time_of(point, field, &times_ns[i]):
                times_ns[i] = NO_TIME
                if bad < 0:
                    bad_value[0] = number_load(point + field.offset, field.number)
            if times_ns[i] == NO_TIME:
                bad = i if bad < 0 else bad
    return bad


cdef struct PointPoses:
    # The pose for each point: from `times_ns`, or else from its field.
    TimeSource field
    const int64_t* times_ns     # of each point; NULL: in the field
    int64_t base_ns             # the time of the first knot
    const double* matrices      # 4x4, row by row: one pose for each point; NULL: poses at knots
    PoseKnots knots             # else


cdef void _pose_of(const PointPoses* poses, const char* point, Py_ssize_t i, Rigid* out) noexcept nogil:
    cdef const double* column
    cdef const double* slope
    cdef double pose[16]
    cdef double ns
    cdef size_t knot
    cdef int row, k
    if poses.matrices != NULL:
        for row in range(3):
            memcpy(out.matrix + 3 * row, poses.matrices + 16 * i + 4 * row, 3 * sizeof(double))
            out.translation[row] = poses.matrices[16 * i + 4 * row + 3]
        return
    if poses.times_ns != NULL:
        # Unsigned, because the difference may not fit.
        ns = <double><int64_t>(<uint64_t>poses.times_ns[i] - <uint64_t>poses.base_ns)
    else:
        ns = number_load(point + poses.field.offset, poses.field.number)
        ns = fma(ns - poses.field.minus, poses.field.times, poses.field.plus)
    if not knots_include(&poses.knots, ns):     # no coordinates, or memory that changes meanwhile
        ns = 0.0
    knot = knot_before(&poses.knots, ns)
    ns = max(ns - poses.knots.ns[knot], 0.0)
    column = poses.knots.columns + 16 * knot
    slope = poses.knots.slopes + 16 * knot
    for k in range(16):
        pose[k] = fma(ns, slope[k], column[k])
    for row in range(3):
        for k in range(3):
            out.matrix[3 * row + k] = pose[4 * k + row]
        out.translation[row] = pose[12 + row]


cdef void _move_one(char* point, Py_ssize_t i, const Grid* grid, const PointPoses* poses) noexcept nogil:
    # In double precision, with the fused operations of the quick way.
    cdef Rigid pose
    cdef const Triples* triples
    cdef double[3] old
    cdef double moved
    # Its directions have no pose, either.
    cdef bint is_lost = grid.triple_count > 1 and _has_nan(point, &grid.triples[0])
    cdef int row, k
    _pose_of(poses, point, i, &pose)
    for k in range(grid.triple_count):
        triples = &grid.triples[k]
        for row in range(3):
            old[row] = number_load(point + triples.offsets[row], triples.numbers[row])
        for row in range(3):
            moved = pose.translation[row] if grid.moves[k] else 0.0
            moved = fma(pose.matrix[3 * row + 2], old[2], moved)
            moved = fma(pose.matrix[3 * row + 1], old[1], moved)
            moved = fma(pose.matrix[3 * row], old[0], moved)
            number_store(point + triples.offsets[row], triples.numbers[row], NAN if is_lost else moved)


cdef void _move_batch(char* points, Py_ssize_t count, Py_ssize_t begin, const Grid* grid,
                      const PointPoses* poses) noexcept nogil:
    # In place; the first of the points has the index `begin`.
    cdef Py_ssize_t step = grid.point_step
    cdef Py_ssize_t done = 0
    cdef const Triples* triples = &grid.triples[0]
    cdef Py_ssize_t quick = _quick_points(grid, count)
    if grid.triple_count > 1 or poses.matrices != NULL or poses.times_ns != NULL:
        quick = 0
    while done < count:
        if done < quick:
            done += avx2_move_floats(points + done * step, step, quick - done, triples.offsets[0],
                                     &poses.field, &poses.knots)
            if done == quick:
                continue
        # What is left, or the whole batch, or a point whose time is not between the knots.
        _move_one(points + done * step, begin + done, grid, poses)
        done += 1


cdef void _store_number(char* points, Py_ssize_t count, Py_ssize_t step, const TimeSource* field,
                        double stored) noexcept nogil:
    cdef char number[8]
    cdef Py_ssize_t size = number_size(field.number)
    cdef Py_ssize_t i
    points += field.offset
    number_store(number, field.number, stored)
    for i in range(count):
        if size == 4:   # sizes that the compiler knows
            memcpy(points + i * step, number, 4)
        elif size == 8:
            memcpy(points + i * step, number, 8)
        else:
            memcpy(points + i * step, number, size)


cdef void _move_points(const char* source, char* target, const Grid* grid, PointPoses* poses, bint store,
                       double stored) noexcept nogil:
    cdef Py_ssize_t step = grid.point_step
    cdef Py_ssize_t used = grid.columns * step
    cdef Py_ssize_t row, done, batch
    cdef Py_ssize_t end = 0
    cdef Py_ssize_t new_end = 0
    for row in range(grid.rows):
        done = 0
        while done < grid.columns:
            batch = min(grid.columns - done, max(COPY_BYTES // step, 1))
            new_end = row * grid.new_row_step + done * step
            memcpy(target + new_end, source + row * grid.row_step + done * step, batch * step)
            _move_batch(target + new_end, batch, row * grid.columns + done, grid, poses)
            if store:
                _store_number(target + new_end, batch, step, &poses.field, stored)
            done += batch
        end = row * grid.row_step + used
        new_end = row * grid.new_row_step + used
        if row + 1 < grid.rows:
            memcpy(target + new_end, source + end, grid.new_row_step - used)
    memcpy(target + new_end, source + end, grid.new_size - new_end)


cdef void _fill_knots(const int64_t* knots_ns, const double* matrices, Py_ssize_t count, double* columns,
                      double* slopes, double* ns) noexcept nogil:
    # The arrays of PoseKnots, from at least one time and pose.
    cdef Py_ssize_t i
    cdef double span
    cdef int row, k
    for i in range(count):
        ns[i] = <double>(knots_ns[i] - knots_ns[0])
        for k in range(4):
            for row in range(3):
                columns[16 * i + 4 * k + row] = matrices[16 * i + 4 * row + k]
            columns[16 * i + 4 * k + 3] = 0.0
    for i in range(count - 1):
        span = <double>max(knots_ns[i + 1] - knots_ns[i], <int64_t>1)
        for k in range(16):
            slopes[16 * i + k] = (columns[16 * (i + 1) + k] - columns[16 * i + k]) / span
    memset(slopes + 16 * (count - 1), 0, 16 * sizeof(double))


cdef object _knots_of(cnp.ndarray knots_ns, PointPoses* poses):
    # Replaces the matrices by steady motions between these times; the poses refer to what is returned.
    cdef Py_ssize_t count = len(knots_ns)
    cdef const int64_t* times_ns = <const int64_t*>cnp.PyArray_DATA(knots_ns)
    cdef cnp.ndarray knots = np.empty(33 * count)
    cdef double* numbers = <double*>cnp.PyArray_DATA(knots)
    cdef TimeSource* field = &poses.field
    cdef int64_t whole
    _fill_knots(times_ns, poses.matrices, count, numbers, numbers + 16 * count, numbers + 32 * count)
    poses.matrices = NULL
    poses.knots.columns = numbers
    poses.knots.slopes = numbers + 16 * count
    poses.knots.ns = numbers + 32 * count
    poses.knots.last = count - 1
    poses.base_ns = times_ns[0]
    if field.number & ~<int>OTHER_ORDER == FLOAT64:
        # Exact, also for a time since 1970: the digits before the first knot are not multiplied.
        field.minus = <double>((poses.base_ns - field.base_ns) // field.unit_ns)
    field.times = <double>field.unit_ns
    whole = <int64_t>field.minus * field.unit_ns
    field.plus = <double>(field.base_ns + whole - poses.base_ns)
    return knots


cdef class Points:
    """
    The points of a cloud, whose layout is validated once.

    :raises MalformedObjectError: an attribute of the cloud, its header or one of its fields is missing.
    :raises TypeError, ValueError: as by :func:`do_transform_cloud`.
    """

    cdef readonly object cloud
    cdef object data
    cdef dict fields
    cdef Grid grid

    def __cinit__(self, cloud):
        cdef Py_buffer source
        cdef int i
        header = get_field(cloud_layout, cloud, "header")
        for name in ("stamp", "frame_id"):
            get_field(header_layout, header, name)
        get_field(cloud_layout, cloud, "is_dense")
        self.cloud, self.fields = cloud, _fields_by_name(cloud)
        for field in get_field(cloud_layout, cloud, "fields"):
            get_field(field_layout, field, "datatype")
        _get_bytes(get_field(cloud_layout, cloud, "data"), &source)
        self.data, size = <object>source.obj, source.len
        PyBuffer_Release(&source)
        _read_grid(cloud, size, &self.grid)
        self.grid.triple_count = 0
        _add_triples(cloud, self.fields, COORDINATES, &IDENTITY, True, &self.grid)
        _add_directions(cloud, self.fields, &IDENTITY, &self.grid)
        for i in range(self.grid.triple_count):
            self.grid.triples[i].step = self.grid.point_step

    def __len__(self):
        return self.grid.rows * self.grid.columns

    cdef int _get_data(self, Py_buffer* source) except -1:
        # Not for longer than a loop: an error keeps what belongs to the call, and memory that has a view can
        # be neither unmapped nor resized.
        _get_bytes(self.data, source)
        if source.len != self.grid.size:
            PyBuffer_Release(source)
            raise SizeError(f"data had {self.grid.size} bytes when deskew began, but now has {source.len}")
        return 0

    cdef int _read_time_field(self, object field, TimeSource* out) except -1:
        # `field`: a TimeField of _time_field.py; None: there is none.
        cdef Triples found
        memset(out, 0, sizeof(TimeSource))
        if field is None:
            return 0
        _read_coordinate(self.fields[field.name], field.name, self.grid.point_step, &found, 0)
        out.offset = found.offsets[0]
        out.number = found.numbers[0]
        if field.wraps and out.number == UINT32:
            out.number = INT32
        out.number |= self.grid.triples[0].numbers[0] & OTHER_ORDER     # the byte order is that of x
        out.unit_ns = field.unit_ns
        out.base_ns = field.base_ns
        return 0

    cdef int _require_one_each(self, cnp.ndarray numbers) except -1:
        if cnp.PyArray_DIM(numbers, 0) != len(self):
            raise ValueError(f"times: expected one for each of {len(self)} points, got {len(numbers)}")
        return 0

    def find_span(self, field, bint needs_point):
        """
        Read the numbers in a field of times, once.

        :param field: a ``TimeField``.
        :param needs_point: omit points without coordinates.
        """
        cdef Py_buffer source
        cdef TimeSource at
        cdef FieldSpan span
        cdef Py_ssize_t row
        memset(&span, 0, sizeof(FieldSpan))
        span.lowest, span.highest = INFINITY, -INFINITY
        self._read_time_field(field, &at)
        self._get_data(&source)
        with nogil:
            for row in range(self.grid.rows if self.grid.columns > 0 else 0):
                _extend_span(<const char*>source.buf + row * self.grid.row_step, &self.grid, &at, needs_point,
                             &span)
        PyBuffer_Release(&source)
        return Span(span.lowest, span.highest, span.points, span.finite, span.large)

    def read_times(self, field, cnp.ndarray times):
        """
        Read the time of each point that has three coordinates.

        :param field: a ``TimeField``; None: ``times`` holds the times already.
        :param times: int64 nanoseconds, one for each point, row by row; receives the times, and the least
            integer where a point has none.
        :return: the index of the first point that has coordinates, but whose time is not a number, or -1; and
            what is there instead.
        """
        cdef Py_buffer source
        cdef TimeSource at
        cdef int64_t* times_ns = <int64_t*>cnp.PyArray_DATA(times)
        cdef Py_ssize_t bad
        cdef double bad_value = NAN
        self._require_one_each(times)
        self._read_time_field(field, &at)
        self._get_data(&source)
        with nogil:
            bad = _read_times(<const char*>source.buf, &self.grid, &at, times_ns, &bad_value)
        PyBuffer_Release(&source)
        return bad, bad_value

    def moved(
        self,
        int64_t new_stamp_ns,
        str frame_id,
        is_dense,
        field,
        stored,
        cnp.ndarray times,
        cnp.ndarray knots_ns,
        cnp.ndarray matrices,
    ):
        """
        Make a cloud in which each point is moved by the pose of its own time.

        :param new_stamp_ns: of the new cloud, which is in ``frame_id``.
        :param field: the ``TimeField`` with the times; None: there is none.
        :param stored: a number that each point gets in that field; None: they keep theirs.
        :param times: int64 nanoseconds, one for each point, instead of the field; None: use the field.
        :param knots_ns: int64 nanoseconds, ascending: the times of the poses, between which they change
            steadily; None: there is one pose for each point.
        :param matrices: of these poses: float64, shape (K, 4, 4), contiguous.
        """
        cdef Py_buffer source
        cdef PointPoses poses
        cdef array.array data
        cdef bint store = stored is not None
        cdef double value = stored if store else 0.0
        header = new_header(new_stamp_ns, frame_id)
        self._read_time_field(field, &poses.field)
        poses.times_ns = NULL
        if times is not None:
            self._require_one_each(times)
            poses.times_ns = <const int64_t*>cnp.PyArray_DATA(times)
        poses.matrices = <const double*>cnp.PyArray_DATA(matrices)
        if knots_ns is None:
            self._require_one_each(matrices)
        else:
            knots = _knots_of(knots_ns, &poses)      # whose memory the poses refer to
        data = array.clone(NO_BYTES, self.grid.new_size, False)
        self._get_data(&source)
        if self.grid.new_size > 0:
            with nogil:
                _move_points(<const char*>source.buf, data.data.as_chars, &self.grid, &poses, store, value)
        PyBuffer_Release(&source)
        return _new_cloud(self.cloud, header, &self.grid, data, is_dense)
