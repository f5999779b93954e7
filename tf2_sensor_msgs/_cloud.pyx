"""Owns carrying sensor_msgs/PointCloud2 into another frame, in place on one copy of its bytes."""

from cpython cimport array
from libc.stdint cimport uint32_t
from libc.string cimport memcpy

from tf2_geometry_msgs._parts cimport part, target_frame
from tf2_py._messages cimport Layout, header_layout, new_header, read_transform, time_to_ns
from tf2_py._types cimport Transform
from tf2_sensor_msgs._points cimport (
    FLOAT32,
    FLOAT32_SWAPPED,
    FLOAT64,
    FLOAT64_SWAPPED,
    Rigid,
    Triples,
    rigid_from_transform,
    triples_carry,
    triples_carry_wide,
    triples_fill_points,
)

import operator
import sys
from array import array as byte_array

from sensor_msgs.msg import PointCloud2, PointField

cdef enum:
    HEADER, HEIGHT, WIDTH, FIELDS, IS_BIGENDIAN, POINT_STEP, ROW_STEP, DATA, IS_DENSE, CLOUD_FIELDS

cdef enum:
    MAX_TRIPLES = 3
    BLOCK = 8192        # bytes that are copied, then changed while they are in the nearest cache

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
cdef bint IS_BIG_MACHINE = sys.byteorder == "big"


cdef struct Grid:
    # The arrangement of a cloud's bytes; checked, so that nothing in it leads out of them.
    Py_ssize_t rows
    Py_ssize_t columns
    Py_ssize_t point_step       # bytes
    Py_ssize_t row_step         # bytes
    Py_ssize_t size             # bytes, all of them
    Triples triples[MAX_TRIPLES]
    Rigid rigids[MAX_TRIPLES]
    int triple_count


cdef uint32_t _whole(object message, Layout layout, int index) except? 0:
    # A uint32 of a message, whose class may not have checked it.
    value = part(layout, message, index)
    name = layout.fields[index]
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
    for field in part(cloud_layout, cloud, FIELDS):
        fields.setdefault(part(field_layout, field, 0), field)     # of two alike, the first, as upstream
    return fields


cdef int _read_triples(dict fields, str prefix, bint is_swapped, Py_ssize_t point_step,
                       Triples* out) except -1:
    cdef Py_ssize_t offset, size = 0
    cdef int i
    for i, axis in enumerate("xyz"):
        name = prefix + axis
        field = fields.get(name)
        if field is None:
            raise ValueError(f"the cloud has no field {name!r}")
        datatype = part(field_layout, field, 2)
        if datatype not in (PointField.FLOAT32, PointField.FLOAT64):
            raise ValueError(f"field {name!r} is of datatype {datatype}, neither FLOAT32 nor FLOAT64")
        if i == 0:
            size = 4 if datatype == PointField.FLOAT32 else 8
        elif size != (4 if datatype == PointField.FLOAT32 else 8):
            raise ValueError(f"field {name!r} is of another datatype than {prefix + 'x'!r}")
        offset = _whole(field, field_layout, 1)
        if offset + size > point_step:
            raise ValueError(f"field {name!r} at offset {offset} reaches beyond point_step {point_step}")
        out.offsets[i] = offset
    if size == 4:
        out.number = FLOAT32_SWAPPED if is_swapped else FLOAT32
    else:
        out.number = FLOAT64_SWAPPED if is_swapped else FLOAT64
    out.step = point_step
    return 0


cdef int _read_grid(object cloud, Py_ssize_t size, Grid* out) except -1:
    out.rows = _whole(cloud, cloud_layout, HEIGHT)
    out.columns = _whole(cloud, cloud_layout, WIDTH)
    out.point_step = _whole(cloud, cloud_layout, POINT_STEP)
    out.row_step = _whole(cloud, cloud_layout, ROW_STEP)
    out.size = size
    # As Python numbers: the products may not fit into 64 bits with a sign.
    if <object>out.row_step < <object>out.columns * out.point_step:
        raise ValueError(
            f"row_step {out.row_step} is less than width {out.columns} x point_step {out.point_step}"
        )
    if size < <object>out.rows * out.row_step:
        raise ValueError(f"data has {size} bytes, less than height {out.rows} x row_step {out.row_step}")
    return 0


cdef int _add_triples(object cloud, dict fields, str prefix, const Transform* transform, bint moves,
                      Grid* grid) except -1:
    cdef bint is_swapped = bool(part(cloud_layout, cloud, IS_BIGENDIAN)) != IS_BIG_MACHINE
    _read_triples(fields, prefix, is_swapped, grid.point_step, &grid.triples[grid.triple_count])
    rigid_from_transform(transform, moves, &grid.rigids[grid.triple_count])
    grid.triple_count += 1
    return 0


cdef void _carry_points(const char* source, char* target, Py_ssize_t count, Py_ssize_t behind,
                        const Grid* grid) noexcept nogil:
    # `count` points without a gap; `behind` bytes follow the last.
    cdef Py_ssize_t done = 0
    cdef Py_ssize_t block, left, after
    cdef const Triples* triples
    cdef int i
    if grid.triple_count == 1 and triples_fill_points(&grid.triples[0]):
        done = triples_carry_wide(source, target, &grid.triples[0], count, behind, &grid.rigids[0])
    while done < count:
        left = count - done
        block = min(left, max(BLOCK // grid.point_step, 1))
        memcpy(target + done * grid.point_step, source + done * grid.point_step, block * grid.point_step)
        for i in range(grid.triple_count):
            triples = &grid.triples[i]
            # Counted as if each coordinate had 8 bytes: never more than there are.
            after = (left - block) * grid.point_step + behind + grid.point_step - triples.offsets[2] - 8
            triples_carry(
                target + done * grid.point_step,
                triples,
                target + done * grid.point_step,
                triples,
                block,
                after,
                &grid.rigids[i],
            )
        done += block


cdef void _carry_grid(const char* source, char* target, const Grid* grid) noexcept nogil:
    cdef Py_ssize_t rows = grid.rows
    cdef Py_ssize_t columns = grid.columns
    cdef Py_ssize_t used = columns * grid.point_step
    cdef Py_ssize_t row, start, end = 0
    if used == grid.row_step:
        columns *= rows
        used *= rows
        rows = 1
    for row in range(rows):
        start = row * grid.row_step
        end = start + used
        _carry_points(source + start, target + start, columns, grid.size - end, grid)
        if row + 1 < rows:
            memcpy(target + end, source + end, grid.row_step - used)
    memcpy(target + end, source + end, grid.size - end)


cdef object _copied_field(object field):
    cdef int i
    message = field_layout.new()
    for i in range(4):
        field_layout.put(message, i, part(field_layout, field, i))
    return message


def do_transform_cloud(cloud, transform, *, only_xyz=False):
    """Carry a point cloud into the frame of a transform: p' = R p + t, in double precision, without the GIL.

    Fields may come in any order, at any offset, with any padding, in either byte order; x y z may be float32
    or float64. Everything else stays as it is: other fields, padding, rows, `is_dense`; a point with a NaN
    has three afterwards. Normals (`normal_x/y/z`) are turned, viewpoints (`vp_x/y/z`) turned and moved, where
    there are any. Upstream's C++ turns normals, too, and leaves viewpoints; its Python carries x y z alone.

    :param cloud: a PointCloud2, coordinates in metres
    :param transform: a TransformStamped
    :param only_xyz: leave normals and viewpoints as they are
    :returns: a new PointCloud2 with the transform's frame and the cloud's own stamp
    :raises TypeError: for other types
    :raises ValueError: where x, y or z is missing, of another type than float32 and float64 or beyond
        `point_step`, where `row_step` or `data` is too short, or the transform's rotation is not finite
    """
    cdef Transform by
    cdef Grid grid
    cdef array.array carried
    cdef const unsigned char[::1] source
    cdef int i
    read_transform(transform, &by)
    stamp_ns = time_to_ns(part(header_layout, part(cloud_layout, cloud, HEADER), 0))
    header = new_header(stamp_ns, target_frame(transform))
    source = _bytes_of(part(cloud_layout, cloud, DATA))
    _read_grid(cloud, source.shape[0], &grid)
    fields = _fields_by_name(cloud)
    grid.triple_count = 0
    _add_triples(cloud, fields, "", &by, True, &grid)
    if not only_xyz:
        if not fields.keys().isdisjoint(("normal_x", "normal_y", "normal_z")):
            _add_triples(cloud, fields, "normal_", &by, False, &grid)
        if not fields.keys().isdisjoint(("vp_x", "vp_y", "vp_z")):
            _add_triples(cloud, fields, "vp_", &by, True, &grid)
    carried = array.clone(NO_BYTES, grid.size, False)
    if grid.size > 0:
        with nogil:
            _carry_grid(<const char*>&source[0], carried.data.as_chars, &grid)
    message = cloud_layout.new()
    for i in range(CLOUD_FIELDS):
        if i == HEADER:
            value = header
        elif i == FIELDS:
            value = [_copied_field(field) for field in part(cloud_layout, cloud, FIELDS)]
        elif i == DATA:
            value = carried
        else:
            value = part(cloud_layout, cloud, i)
        cloud_layout.put(message, i, value)
    return message
