"""Clouds that tf2's Python transforms, and what it makes of them."""

import array
import math

import numpy as np
import pytest
from making import about_z, transform
from sensor_msgs.msg import PointCloud2, PointField

try:
    import tf2_sensor_msgs
except ModuleNotFoundError as missing:
    # The reference reads clouds with sensor_msgs_py, which not every environment has.
    if missing.name != "sensor_msgs_py":
        raise
    pytest.skip("sensor_msgs_py is absent", allow_module_level=True)

DATATYPES = {
    "i1": PointField.INT8,
    "u1": PointField.UINT8,
    "i2": PointField.INT16,
    "u2": PointField.UINT16,
    "i4": PointField.INT32,
    "u4": PointField.UINT32,
    "f4": PointField.FLOAT32,
    "f8": PointField.FLOAT64,
}
WHOLE = ["i1", "u1", "i2", "u2", "i4", "u4"]


def cloud(columns, points, **fields):
    """A cloud of columns (name, kind), and of points, one tuple each."""
    dtype = np.dtype([(name, f"<{kind}") for name, kind in columns])
    rows = np.zeros(len(points), dtype)
    rows[:] = points
    message = PointCloud2(height=1, width=len(points), point_step=dtype.itemsize)
    message.row_step = dtype.itemsize * len(points)
    message.header.frame_id = "base"
    message.fields = [
        PointField(name=name, offset=dtype.fields[name][1], datatype=DATATYPES[kind], count=1)
        for name, kind in columns
    ]
    message.data = array.array("B", rows.tobytes())
    for name, value in fields.items():
        setattr(message, name, value)
    return message


def columns_of(message):
    """Each field's values, by name."""
    names = {datatype: f"<{kind}" for kind, datatype in DATATYPES.items()}
    dtype = np.dtype(
        {
            "names": [field.name for field in message.fields],
            "formats": [names[field.datatype] for field in message.fields],
            "offsets": [field.offset for field in message.fields],
            "itemsize": message.point_step,
        }
    )
    count = message.width * message.height
    rows = np.frombuffer(message.data, dtype, count)
    return {name: rows[name].tolist() for name in dtype.names}


FLOATS = [("x", "f4"), ("y", "f4"), ("z", "f4")]
POINTS = [(1.0, 2.0, 3.0), (4.0, 5.0, 6.0)]


@pytest.fixture
def t():
    return transform("map", "base", 7, (10, 20, 30))


def test_a_stamped_transform_gives_its_frame_a_bare_one_leaves_it(t):
    stamped = tf2_sensor_msgs.do_transform_cloud(cloud(FLOATS, POINTS), t)
    bare = tf2_sensor_msgs.do_transform_cloud(cloud(FLOATS, POINTS), t.transform)
    assert (stamped.header.frame_id, bare.header.frame_id) == ("map", "base")
    assert columns_of(stamped) == columns_of(bare) == {"x": [11, 14], "y": [22, 25], "z": [33, 36]}


@pytest.mark.parametrize("kind", WHOLE)
def test_whole_coordinates_are_cut_off(kind):
    columns = [(axis, kind) for axis in "xyz"]
    points = [(1, 2, 3), (100, 7, 0)] if kind[0] == "u" else [(1, -2, 3), (100, 7, -4)]
    got = tf2_sensor_msgs.do_transform_cloud(
        cloud(columns, points), transform("map", "base", 1, (0.5, 0.25, 0.75))
    )
    wanted = {
        axis: [math.trunc(point[i] + moved) for point in points]
        for i, (axis, moved) in enumerate((("x", 0.5), ("y", 0.25), ("z", 0.75)))
    }
    assert columns_of(got) == wanted


def test_whole_coordinates_turn():
    got = tf2_sensor_msgs.do_transform_cloud(
        cloud([(axis, "i2") for axis in "xyz"], [(1000, 0, 0), (0, 1000, 5)]),
        transform("map", "base", 1, (0.5, 0.5, 0.5), about_z(math.pi / 2)),
    )
    assert columns_of(got) == {"x": [0, -999], "y": [1000, 0], "z": [0, 5]}


@pytest.mark.parametrize(
    "kinds", [("f4", "f8", "f4"), ("i2", "f4", "u1"), ("u4", "i4", "f8"), ("i4", "f4", "f4")]
)
def test_coordinates_of_different_types_are_transformed(t, kinds):
    columns = [*zip("xyz", kinds, strict=True), ("intensity", "f4")]
    got = tf2_sensor_msgs.do_transform_cloud(cloud(columns, [(1, 2, 3, 0.5), (4, 5, 6, 0.25)]), t)
    assert columns_of(got) == {"x": [11, 14], "y": [22, 25], "z": [33, 36], "intensity": [0.5, 0.25]}


def test_a_zero_rotation_counts_as_none(t):
    zero = transform("map", "base", 7, (10, 20, 30), (0, 0, 0, 0))
    straight = tf2_sensor_msgs.do_transform_cloud(cloud(FLOATS, POINTS), t)
    assert tf2_sensor_msgs.do_transform_cloud(cloud(FLOATS, POINTS), zero).data == straight.data
    points = np.array(POINTS)
    assert np.array_equal(tf2_sensor_msgs.transform_points(points, zero.transform), points + (10, 20, 30))


def test_fewer_bytes_than_points_are_a_type_error(t):
    with pytest.raises(TypeError):
        tf2_sensor_msgs.do_transform_cloud(cloud(FLOATS, POINTS, width=3), t)


@pytest.mark.parametrize("wrong", [None, 5, PointField()], ids=lambda w: type(w).__name__)
def test_another_object_than_a_transform_is_an_attribute_error(wrong):
    with pytest.raises(AttributeError):
        tf2_sensor_msgs.do_transform_cloud(cloud(FLOATS, POINTS), wrong)
    with pytest.raises(AttributeError):
        tf2_sensor_msgs.transform_points(np.zeros((2, 3)), wrong)
