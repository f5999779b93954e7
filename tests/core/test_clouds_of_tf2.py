"""What tf2's Python, too, makes of clouds; test_tf2_sensor_msgs.py judges ours byte by byte."""

import math

import numpy as np
import pytest
from making import about_z, transform
from sensor_msgs.msg import PointField
from std_msgs.msg import Header

try:
    import tf2_sensor_msgs
    from tf2_sensor_msgs.tf2_sensor_msgs import create_cloud, read_points
except ModuleNotFoundError as missing:
    # The reference reads clouds with sensor_msgs_py, which not every environment has.
    if missing.name != "sensor_msgs_py":
        raise
    pytest.skip("sensor_msgs_py is absent", allow_module_level=True)

WHOLE = ["i1", "u1", "i2", "u2", "i4", "u4"]
KINDS = [*WHOLE, "f4", "f8"]  # of PointField's datatypes, from 1 on


def cloud(columns, points):
    """A cloud of columns (name, kind), and of points, one tuple each."""
    offsets = np.cumsum([0, *[np.dtype(kind).itemsize for _, kind in columns]]).tolist()
    fields = [
        PointField(name=name, offset=offset, datatype=1 + KINDS.index(kind), count=1)
        for (name, kind), offset in zip(columns, offsets, strict=False)
    ]
    return create_cloud(Header(frame_id="base"), fields, points)


def columns_of(message):
    """Each field's values, by name."""
    points = read_points(message)
    return {name: points[name].tolist() for name in points.dtype.names}


@pytest.fixture
def t():
    return transform("map", "base", 7, (10, 20, 30))


@pytest.fixture
def floats():
    return cloud([("x", "f4"), ("y", "f4"), ("z", "f4")], [(1.0, 2.0, 3.0), (4.0, 5.0, 6.0)])


def test_a_stamped_transform_gives_its_frame_a_bare_one_leaves_it(t, floats):
    stamped = tf2_sensor_msgs.do_transform_cloud(floats, t)
    bare = tf2_sensor_msgs.do_transform_cloud(floats, t.transform)
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


def test_a_zero_rotation_counts_as_none(t, floats):
    zero, points = transform("map", "base", 7, (10, 20, 30), (0, 0, 0, 0)), np.ones((2, 3))
    got = tf2_sensor_msgs.do_transform_cloud(floats, zero)
    assert got.data == tf2_sensor_msgs.do_transform_cloud(floats, t).data
    assert np.array_equal(tf2_sensor_msgs.transform_points(points, zero.transform), points + (10, 20, 30))


def test_errors_are_those_of_tf2(t, floats):
    for wrong in (None, 5, PointField()):
        with pytest.raises(AttributeError):
            tf2_sensor_msgs.do_transform_cloud(floats, wrong)
        with pytest.raises(AttributeError):
            tf2_sensor_msgs.transform_points(np.zeros((2, 3)), wrong)
    floats.width = 3  # and there are two points
    with pytest.raises(TypeError):
        tf2_sensor_msgs.do_transform_cloud(floats, t)
