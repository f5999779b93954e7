# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Transform point clouds, in place on one copy of their bytes, and arrays of points."""

from cpython cimport array
from cpython.buffer cimport PyBUF_C_CONTIGUOUS, PyBUF_FORMAT, PyBuffer_Release, PyObject_GetBuffer
from libc.math cimport INFINITY, NAN, fabs, fma, isfinite, isnan, llrint
from libc.stdint cimport INT64_MIN, int64_t, uint32_t, uint64_t
from libc.string cimport memcpy, memset

cimport numpy as cnp

from tf2_geometry_msgs._geometry cimport copy_shallow, get_field, set_field, target_frame
from tf2_py._internal cimport Layout, Transform, header_layout, nanoseconds, new_header, read_any_rotation
from tf2_sensor_msgs._point_field_numbers cimport (
    FLOAT32,
    FLOAT64,
    INT32,
    OTHER_ORDER,
    UINT32,
    number_load,
    number_size,
    number_store,
)
from tf2_sensor_msgs._avx2_points cimport (
    FieldSpan,
    PoseKnots,
    TimeSource,
    avx2_doubles,
    avx2_extend_span,
    avx2_floats,
    avx2_is_supported,
    avx2_move_floats,
    knot_before,
    knots_include,
)

import operator
import sys
from array import array as byte_array
from typing import Any, NamedTuple

import numpy as np
from geometry_msgs.msg import Transform as TransformMessage, TransformStamped
from numpy.typing import ArrayLike, NDArray
from sensor_msgs.msg import PointCloud2, PointField

from tf2_py._internal import bool_of
from tf2_sensor_msgs._errors import FieldError, SizeError

cnp.import_array()
globals()["Transform"] = TransformMessage   # for hints; in the code, it is a struct

include "_coordinates.pxi"

cdef enum:
    MAX_TRIPLES = 3
    COPY_BYTES = 8192   # copied at once, and then changed while they are in the nearest cache

cdef Layout cloud_layout = Layout(
    PointCloud2,
    (
        "header",
        "height",
        "width",
        "fields",
        "is_bigendian",
        "point_step",
        "row_step",
        "data",
        "is_dense",
    ),
)
cdef Layout field_layout = Layout(PointField, ("name", "offset", "datatype", "count"))
cdef array.array NO_BYTES = byte_array("B")
cdef tuple COORDINATES = ("x", "y", "z")
cdef tuple NORMAL = ("normal_x", "normal_y", "normal_z")
cdef tuple VIEWPOINT = ("vp_x", "vp_y", "vp_z")
cdef bint IS_BIG_MACHINE = sys.byteorder == "big"


cdef struct Grid:
    # The arrangement of a cloud's bytes, checked so that no offset leads out of them, and no product of these
    # numbers overflows: a row has less than 2^32 bytes, and all rows together have at most `size`.
    Py_ssize_t rows
    Py_ssize_t columns
    Py_ssize_t point_step       # bytes, of the cloud given
    Py_ssize_t row_step
    Py_ssize_t size             # all of them
    Py_ssize_t new_point_step   # bytes, of the result; less than point_step where padding is dropped
    Py_ssize_t new_row_step
    Py_ssize_t new_size
    Triples triples[MAX_TRIPLES]    # in the result
    bint moves[MAX_TRIPLES]     # False: directions, which are only rotated
    Rigid rigids[MAX_TRIPLES]
    int triple_count


cdef uint32_t _whole(object message, Layout layout, str name) except? 0:
    # A uint32 of a message. The class of the message may not have checked it.
    value = get_field(layout, message, name)
    try:
        value = operator.index(value)
    except TypeError:
        raise TypeError(f"{name}: expected an int, got {type(value).__name__}") from None
    if not 0 <= value < 1 << 32:
        raise ValueError(f"{name} = {value} is out of the range of a uint32")
    return value


cdef int _get_bytes(object data, Py_buffer* view) except -1:
    # Valid until the view is released. Cython's code for a typed memoryview would be larger than this module.
    try:
        PyObject_GetBuffer(data, view, PyBUF_C_CONTIGUOUS | PyBUF_FORMAT)
        if view.ndim == 1 and view.format[0] == b"B" and view.format[1] == 0:
            return 0
        PyBuffer_Release(view)
    except (BufferError, TypeError, ValueError):    # not a buffer, or not of contiguous bytes
        pass
    PyObject_GetBuffer(_copied(data), view, PyBUF_C_CONTIGUOUS)
    return 0


cdef object _copied(object data):
    # Lyrical's rosidl_buffer.Buffer, for the memory of a device, is neither a buffer nor iterable.
    if hasattr(data, "to_bytes") and not isinstance(data, int):
        return data.to_bytes()
    try:
        iter(data)
    except TypeError:
        raise TypeError(
            f"data: expected bytes or uint8 numbers, got {type(data).__name__}: copy it to main memory, for "
            "example into an array.array('B')"
        ) from None
    return byte_array("B", data)


def as_bytes(data):
    """Return the ``data`` of a cloud, or a copy if that is not a buffer of contiguous bytes."""
    cdef Py_buffer view
    _get_bytes(data, &view)
    try:
        return <object>view.obj
    finally:
        PyBuffer_Release(&view)


cdef dict _fields_by_name(object cloud):
    fields = {}
    for field in get_field(cloud_layout, cloud, "fields"):
        # Of two fields with the same name, the first, as in tf2.
        fields.setdefault(get_field(field_layout, field, "name"), field)
    return fields


cdef int _read_coordinate(object field, str name, Py_ssize_t point_step, Triples* out,
                          int axis) except -1:
    cdef Py_ssize_t offset = _whole(field, field_layout, "offset")
    cdef Py_ssize_t size
    datatype = get_field(field_layout, field, "datatype")
    size = number_size(datatype) if isinstance(datatype, int) and 0 < datatype < <int>OTHER_ORDER else 0
    if size == 0:
        raise FieldError(
            f"field {name!r}: expected a datatype from 1 (INT8) to 8 (FLOAT64), got {datatype!r}"
        )
    count = get_field(field_layout, field, "count")
    if count > 1:
        raise FieldError(f"field {name!r}: expected a count of 1, got {count}")
    if offset + size > point_step:
        raise FieldError(f"field {name!r} at offset {offset} reaches beyond point_step {point_step}")
    out.offsets[axis] = offset
    out.numbers[axis] = datatype
    return 0


cdef int _read_triples(dict fields, tuple names, bint is_other_order, Py_ssize_t point_step,
                       Triples* out) except -1:
    cdef int axis
    for axis, name in enumerate(names):
        if name not in fields:
            raise FieldError(f"the cloud has no field {name!r}; its fields are {list(fields)}")
        _read_coordinate(fields[name], name, point_step, out, axis)
        if is_other_order:
            out.numbers[axis] |= OTHER_ORDER
    return 0


cdef int _read_grid(object cloud, Py_ssize_t size, Grid* out) except -1:
    cdef Py_ssize_t used
    out.rows = _whole(cloud, cloud_layout, "height")
    out.columns = _whole(cloud, cloud_layout, "width")
    out.point_step = _whole(cloud, cloud_layout, "point_step")
    out.row_step = _whole(cloud, cloud_layout, "row_step")
    out.size = size
    # As Python numbers, because the products may not fit into signed 64 bits.
    row_bytes = <object>out.columns * out.point_step
    if size < out.rows * row_bytes:
        raise SizeError(
            f"data has {size} bytes, less than height {out.rows} x width {out.columns} x point_step "
            f"{out.point_step}"
        )
    if row_bytes >= 1 << 32:
        raise SizeError(
            f"a row of width {out.columns} x point_step {out.point_step} has {row_bytes} bytes, too many for "
            "row_step, a uint32"
        )
    used = row_bytes
    out.new_point_step = out.point_step
    out.new_row_step = out.row_step
    out.new_size = size
    if out.rows > 0 and (out.row_step < used or size < <object>out.rows * out.row_step):
        # If the bytes contradict row_step, the rows are contiguous, as in tf2, which never reads it. The last
        # row may lack its padding. In both cases the result has no padding.
        if out.row_step < used or size < (<object>out.rows - 1) * out.row_step + used:
            out.row_step = used
        out.new_row_step = used
        out.new_size = out.rows * used
    if out.columns == 0 and out.row_step == 0:
        out.rows = min(out.rows, <Py_ssize_t>1)     # rows without a byte, up to 2^32 in an empty message
    return 0


cdef int _drop_padding(const Triples* triples, Grid* out) except -1:
    # As in tf2, which creates a cloud of only coordinates anew: a point ends with its last coordinate.
    cdef Py_ssize_t end = 0
    cdef int axis
    for axis in range(3):
        end = max(end, triples.offsets[axis] + number_size(triples.numbers[axis]))
    if end < out.point_step:
        out.new_point_step = end
        out.new_row_step = out.columns * end
        out.new_size = out.rows * out.new_row_step
    return 0


cdef bint _has_directions(dict fields, tuple names):
    # Integers do not hold a direction or a position.
    for name in names:
        if name not in fields:
            return False
        if get_field(field_layout, fields[name], "datatype") not in (FLOAT32, FLOAT64):
            return False
    return True


cdef int _add_triples(object cloud, dict fields, tuple names, const Transform* transform, bint moves,
                      Grid* grid) except -1:
    cdef bint is_other_order = bool(get_field(cloud_layout, cloud, "is_bigendian")) != IS_BIG_MACHINE
    _read_triples(fields, names, is_other_order, grid.point_step, &grid.triples[grid.triple_count])
    grid.moves[grid.triple_count] = moves
    rigid_from_transform(transform, moves, &grid.rigids[grid.triple_count])
    grid.triple_count += 1
    return 0


cdef int _add_directions(object cloud, dict fields, const Transform* transform, Grid* grid) except -1:
    if _has_directions(fields, NORMAL):
        _add_triples(cloud, fields, NORMAL, transform, False, grid)
    if _has_directions(fields, VIEWPOINT):
        _add_triples(cloud, fields, VIEWPOINT, transform, True, grid)
    return 0


cdef void _copy_points(const char* source, char* target, Py_ssize_t count, const Grid* grid) noexcept nogil:
    cdef Py_ssize_t _
    if grid.new_point_step == grid.point_step:
        memcpy(target, source, count * grid.point_step)
        return
    if grid.new_point_step == 12:       # a size that the compiler knows
        for _ in range(count):
            memcpy(target, source, 12)
            source += grid.point_step
            target += 12
        return
    for _ in range(count):
        memcpy(target, source, grid.new_point_step)
        source += grid.point_step
        target += grid.new_point_step


cdef void _transform_points(const char* source, char* target, Py_ssize_t count, Py_ssize_t bytes_after,
                            const Grid* grid) noexcept nogil:
    # `count` points without a gap; `bytes_after` bytes follow the last one, in both source and target.
    cdef Py_ssize_t step = grid.new_point_step
    cdef Py_ssize_t done = 0
    cdef Py_ssize_t batch, left, after
    cdef const Triples* triples
    cdef int i
    if grid.triple_count == 1 and triples_fill_points(&grid.triples[0], grid.point_step):
        done = triples_transform_wide(
            source, grid.point_step, target, &grid.triples[0], count, bytes_after, &grid.rigids[0]
        )
    while done < count:
        left = count - done
        batch = min(left, max(COPY_BYTES // step, 1))
        _copy_points(source + done * grid.point_step, target + done * step, batch, grid)
        for i in range(grid.triple_count):
            triples = &grid.triples[i]
            # Counted as if each coordinate had 8 bytes, so never more than there are.
            after = (left - batch) * step + bytes_after + step - triples.offsets[2] - 8
            triples_transform(
                target + done * step,
                triples,
                target + done * step,
                triples,
                batch,
                after,
                &grid.rigids[i],
            )
        done += batch


cdef void _transform_grid(const char* source, char* target, const Grid* grid) noexcept nogil:
    cdef Py_ssize_t rows = grid.rows
    cdef Py_ssize_t columns = grid.columns
    cdef Py_ssize_t used = columns * grid.point_step
    cdef Py_ssize_t new_used = columns * grid.new_point_step
    cdef Py_ssize_t row, end, new_end
    if used == grid.row_step and new_used == grid.new_row_step:
        columns *= rows
        used *= rows
        new_used *= rows
        rows = min(rows, 1)
    end = new_end = 0
    for row in range(rows):
        end = row * grid.row_step + used
        new_end = row * grid.new_row_step + new_used
        _transform_points(
            source + end - used,
            target + new_end - new_used,
            columns,
            min(grid.size - end, grid.new_size - new_end),
            grid,
        )
        if row + 1 < rows:
            memcpy(target + new_end, source + end, grid.new_row_step - new_used)
    memcpy(target + new_end, source + end, grid.new_size - new_end)


cdef object _new_cloud(object cloud, object header, const Grid* grid, array.array data, object is_dense):
    # What has changed, and the rest of `cloud`.
    message = cloud_layout.new()
    set_field(cloud_layout, message, "header", header)
    for name in ("height", "width", "is_bigendian"):
        set_field(cloud_layout, message, name, get_field(cloud_layout, cloud, name))
    set_field(cloud_layout, message, "is_dense", is_dense)
    new_fields = [copy_shallow(field_layout, field) for field in get_field(cloud_layout, cloud, "fields")]
    set_field(cloud_layout, message, "fields", new_fields)
    set_field(cloud_layout, message, "point_step", grid.new_point_step)
    set_field(cloud_layout, message, "row_step", grid.new_row_step)
    set_field(cloud_layout, message, "data", data)
    return message


def do_transform_cloud(
    cloud: PointCloud2, transform: TransformStamped | Transform, *, only_xyz: bool = False
) -> PointCloud2:
    """
    Transform a point cloud from the child frame of ``transform`` to its parent frame: p' = R p + t.

    In double precision, without the GIL.

    Fields may be in any order, at any offset, with any padding, in either byte order; x, y and z may be of
    any type, even of different ones; integers are truncated, as in tf2. If one coordinate of a point is NaN,
    all three are NaN in the result. Everything else stays as it is: other fields, padding, rows,
    ``is_dense``. However, a cloud with only x, y and z loses the padding after them, as in tf2, and a
    ``row_step`` that contradicts the data is corrected.

    Normals (``normal_x/y/z``) are rotated, and viewpoints (``vp_x/y/z``) rotated and translated, if a cloud
    has all three as float32 or float64. tf2's C++ also rotates normals, but not viewpoints; its Python
    transforms only x, y and z.

    :param cloud: a PointCloud2, coordinates in meters.
    :param transform: a TransformStamped, or a Transform, which leaves the cloud's frame unchanged; meters.
    :param only_xyz: leave normals and viewpoints unchanged.
    :return: a new PointCloud2 with the transform's frame and the cloud's own stamp.
    :raises TypeError: an argument has another type. If it lacks a field, the error is also an AttributeError.
    :raises ValueError: x, y or z is missing, not a number or beyond ``point_step`` (as in tf2 also an
        AssertionError), ``data`` is too short for the points, or a row too long for ``row_step`` (also a
        TypeError), or the transform's rotation is not finite.
    """
    cdef Transform tf
    cdef Grid grid
    cdef array.array new_data
    cdef Py_buffer source
    cdef int i
    cdef bint leaves_others = bool_of(only_xyz, "only_xyz")
    read_any_rotation(transform, &tf)
    old_header = get_field(cloud_layout, cloud, "header")
    if hasattr(transform, "transform"):
        frame = target_frame(transform)
    else:
        frame = get_field(header_layout, old_header, "frame_id")
    header = new_header(nanoseconds(get_field(header_layout, old_header, "stamp"), "header.stamp"), frame)
    _get_bytes(get_field(cloud_layout, cloud, "data"), &source)
    try:
        _read_grid(cloud, source.len, &grid)
        fields = _fields_by_name(cloud)
        grid.triple_count = 0
        _add_triples(cloud, fields, COORDINATES, &tf, True, &grid)
        if len(fields) == 3:
            _drop_padding(&grid.triples[0], &grid)
        elif not leaves_others:
            _add_directions(cloud, fields, &tf, &grid)
        for i in range(grid.triple_count):
            grid.triples[i].step = grid.new_point_step
        new_data = array.clone(NO_BYTES, grid.new_size, False)
        if grid.new_size > 0:
            with nogil:
                _transform_grid(<const char*>source.buf, new_data.data.as_chars, &grid)
    finally:
        PyBuffer_Release(&source)
    return _new_cloud(cloud, header, &grid, new_data, get_field(cloud_layout, cloud, "is_dense"))


def transform_points(point_cloud: ArrayLike, transform: TransformStamped | Transform) -> NDArray[Any]:
    """
    Transform points from the child frame of ``transform`` to its parent frame: p' = R p + t.

    In double precision, without the GIL.

    :param point_cloud: an array of shape (n, 3), x y z in meters, with any strides; or array-like.
    :param transform: a TransformStamped or Transform, meters.
    :return: a new array of shape (n, 3): float32 for float32, otherwise float64.
    :raises TypeError: ``transform`` is of another type, or the points are not real numbers.
    :raises ValueError: the points have another shape, or the transform's rotation is not finite.
    """
    cdef Transform tf
    cdef Rigid rigid
    cdef Triples source_at, target_at
    cdef cnp.ndarray points, result
    cdef Py_ssize_t count, size
    cdef int i
    read_any_rotation(transform, &tf)
    rigid_from_transform(&tf, True, &rigid)
    points = _real_points(point_cloud)
    count = cnp.PyArray_DIM(points, 0)
    result = np.empty((count, 3), dtype=points.dtype)
    size = cnp.PyArray_ITEMSIZE(points)
    source_at.step = cnp.PyArray_STRIDE(points, 0)
    target_at.step = 3 * size
    for i in range(3):
        source_at.offsets[i] = i * cnp.PyArray_STRIDE(points, 1)
        target_at.offsets[i] = i * size
        source_at.numbers[i] = target_at.numbers[i] = FLOAT32 if size == 4 else FLOAT64
    with nogil:
        triples_transform(
            cnp.PyArray_BYTES(points), &source_at, cnp.PyArray_BYTES(result), &target_at, count, 0, &rigid
        )
    return result


cdef cnp.ndarray _real_points(object points):
    numbers = np.asarray(points)
    if numbers.dtype.kind not in "fiub":
        raise TypeError(f"points: expected real numbers, got {numbers.dtype}")
    if numbers.ndim != 2 or numbers.shape[1] != 3:
        raise ValueError(f"points: expected the shape (n, 3), got {numbers.shape}")
    single = numbers.dtype.kind == "f" and numbers.dtype.itemsize == 4
    # Copies only if the type or its byte order differs.
    return numbers.astype(np.float32 if single else np.float64, copy=False)


include "_deskew_points.pxi"
