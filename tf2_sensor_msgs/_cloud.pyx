"""Owns transforming sensor_msgs/PointCloud2, in place on one copy of its bytes."""

from cpython cimport array
from libc.stdint cimport uint32_t
from libc.string cimport memcpy

from tf2_geometry_msgs._parts cimport copy_shallow, get_field, set_field, target_frame
from tf2_py._internal cimport Layout, Transform, header_layout, nanoseconds, new_header, read_any_rotation
from tf2_sensor_msgs._numbers cimport FLOAT32, FLOAT64, OTHER_ORDER, number_size
from tf2_sensor_msgs._points cimport (
    Rigid,
    Triples,
    rigid_from_transform,
    triples_fill_points,
    triples_transform,
    triples_transform_wide,
)

import operator
import sys
from array import array as byte_array

from sensor_msgs.msg import PointCloud2, PointField

from tf2_sensor_msgs._errors import FieldError, SizeError

cdef enum:
    MAX_TRIPLES = 3
    COPY_BYTES = 8192   # bytes that are copied, then changed while they are in the nearest cache

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
    # The arrangement of a cloud's bytes; checked, so that nothing in it leads out of them.
    Py_ssize_t rows
    Py_ssize_t columns
    Py_ssize_t point_step       # bytes, of the cloud given
    Py_ssize_t row_step
    Py_ssize_t size             # all of them
    Py_ssize_t new_point_step   # bytes, of the result; less than point_step where padding is dropped
    Py_ssize_t new_row_step
    Py_ssize_t new_size
    Triples triples[MAX_TRIPLES]    # in the result
    Rigid rigids[MAX_TRIPLES]
    int triple_count


cdef uint32_t _whole(object message, Layout layout, str name) except? 0:
    # A uint32 of a message, whose class may not have checked it.
    value = get_field(layout, message, name)
    try:
        value = operator.index(value)
    except TypeError:
        raise TypeError(f"{name} must be an int, not {type(value).__name__}") from None
    if not 0 <= value < 1 << 32:
        raise ValueError(f"{name} = {value} is out of the range of a uint32")
    return value


cdef const unsigned char[::1] _bytes_of(object data):
    try:
        return data
    except (TypeError, ValueError):     # no buffer, or not one of bytes in a row
        return byte_array("B", data)


cdef dict _fields_by_name(object cloud):
    fields = {}
    for field in get_field(cloud_layout, cloud, "fields"):
        # Of two with one name, the first, as in tf2.
        fields.setdefault(get_field(field_layout, field, "name"), field)
    return fields


cdef int _read_coordinate(object field, str name, Py_ssize_t point_step, Triples* out,
                          int axis) except -1:
    cdef Py_ssize_t offset = _whole(field, field_layout, "offset")
    cdef Py_ssize_t size
    datatype = get_field(field_layout, field, "datatype")
    size = number_size(datatype) if isinstance(datatype, int) and 0 < datatype < <int>OTHER_ORDER else 0
    if size == 0:
        raise FieldError(f"field {name!r} is of datatype {datatype}, which is no number")
    count = get_field(field_layout, field, "count")
    if count > 1:
        raise FieldError(f"field {name!r} holds {count} numbers, not one")
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
            raise FieldError(f"the cloud has no field {name!r}")
        _read_coordinate(fields[name], name, point_step, out, axis)
        if is_other_order:
            out.numbers[axis] |= OTHER_ORDER
    return 0


cdef int _read_grid(object cloud, Py_ssize_t size, Grid* out) except -1:
    out.rows = _whole(cloud, cloud_layout, "height")
    out.columns = _whole(cloud, cloud_layout, "width")
    out.point_step = _whole(cloud, cloud_layout, "point_step")
    out.row_step = _whole(cloud, cloud_layout, "row_step")
    out.size = size
    # As Python numbers: the products may not fit into 64 bits with a sign.
    used = <object>out.columns * out.point_step
    if size < <object>out.rows * used:
        raise SizeError(
            f"data has {size} bytes, less than height {out.rows} x width {out.columns} x point_step "
            f"{out.point_step}"
        )
    out.new_point_step = out.point_step
    out.new_row_step = out.row_step
    out.new_size = size
    if out.rows > 0 and (out.row_step < used or size < <object>out.rows * out.row_step):
        # Where the bytes contradict row_step, row follows row, as in tf2, which never reads it. The padding
        # of the last row may be left out. Either way the result has none.
        if out.row_step < used or size < (<object>out.rows - 1) * out.row_step + used:
            out.row_step = used
        out.new_row_step = used
        out.new_size = out.rows * used
    return 0


cdef int _drop_padding(const Triples* triples, Grid* out) except -1:
    # As tf2 makes a cloud of coordinates alone anew: a point ends with its last coordinate.
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
    # Whole numbers stand for something else than a direction or a place.
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
    rigid_from_transform(transform, moves, &grid.rigids[grid.triple_count])
    grid.triple_count += 1
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
    # `count` points without a gap; `bytes_after` bytes follow the last, in the source as in the target.
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
            # Counted as if each coordinate had 8 bytes: never more than there are.
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


def do_transform_cloud(
    cloud: PointCloud2, transform: TransformStamped | Transform, *, only_xyz: bool = False
) -> PointCloud2:
    """
    Transform a point cloud from the child frame of ``transform`` to its parent frame: p' = R p + t.

    In double precision, without the GIL.

    Fields may be in any order, at any offset, with any padding, in either byte order; x, y and z may be of
    any type, even of different ones; integers are truncated, as in tf2. Everything else stays as it is: other
    fields, padding, rows, ``is_dense``; a point with one NaN has three in the result. But a cloud of x, y and
    z alone loses the padding after them, as in tf2, and a ``row_step`` that contradicts the data is
    corrected. Normals (``normal_x/y/z``) are rotated, viewpoints (``vp_x/y/z``) rotated and translated, where
    a cloud has all three as float32 or float64. tf2's C++ also rotates normals, and leaves viewpoints; its
    Python transforms x, y and z alone.

    :param cloud: a PointCloud2, coordinates in metres.
    :param transform: a TransformStamped, or a Transform, with which the cloud's frame stays; metres.
    :param only_xyz: leave normals and viewpoints as they are.
    :return: a new PointCloud2 with the transform's frame and the cloud's own stamp.
    :raises TypeError: an argument is of another type; where it lacks a field, also an AttributeError.
    :raises ValueError: x, y or z is missing, no number or beyond ``point_step`` (as in tf2 also an
        AssertionError), ``data`` is too short for the points (also a TypeError), or the transform's rotation
        is not finite.
    """
    cdef Transform tf
    cdef Grid grid
    cdef array.array new_data
    cdef const unsigned char[::1] source
    cdef int i
    read_any_rotation(transform, &tf)
    old_header = get_field(cloud_layout, cloud, "header")
    if hasattr(transform, "transform"):
        frame = target_frame(transform)
    else:
        frame = get_field(header_layout, old_header, "frame_id")
    header = new_header(nanoseconds(get_field(header_layout, old_header, "stamp"), "header.stamp"), frame)
    source = _bytes_of(get_field(cloud_layout, cloud, "data"))
    _read_grid(cloud, source.shape[0], &grid)
    fields = _fields_by_name(cloud)
    grid.triple_count = 0
    _add_triples(cloud, fields, COORDINATES, &tf, True, &grid)
    if len(fields) == 3:
        _drop_padding(&grid.triples[0], &grid)
    elif not only_xyz:
        if _has_directions(fields, NORMAL):
            _add_triples(cloud, fields, NORMAL, &tf, False, &grid)
        if _has_directions(fields, VIEWPOINT):
            _add_triples(cloud, fields, VIEWPOINT, &tf, True, &grid)
    for i in range(grid.triple_count):
        grid.triples[i].step = grid.new_point_step
    new_data = array.clone(NO_BYTES, grid.new_size, False)
    if grid.new_size > 0:
        with nogil:
            _transform_grid(<const char*>&source[0], new_data.data.as_chars, &grid)
    message = cloud_layout.new()
    set_field(cloud_layout, message, "header", header)
    for name in ("height", "width", "is_bigendian", "is_dense"):
        set_field(cloud_layout, message, name, get_field(cloud_layout, cloud, name))
    new_fields = [copy_shallow(field_layout, field) for field in get_field(cloud_layout, cloud, "fields")]
    set_field(cloud_layout, message, "fields", new_fields)
    set_field(cloud_layout, message, "point_step", grid.new_point_step)
    set_field(cloud_layout, message, "row_step", grid.new_row_step)
    set_field(cloud_layout, message, "data", new_data)
    return message
