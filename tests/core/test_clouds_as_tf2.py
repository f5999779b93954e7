# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What tf2's Python, too, makes of clouds; the fuzz target `clouds` judges ours byte by byte."""

import array
import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from reference import imported
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header
from times_and_transforms import about_z, transform

pytestmark = pytest.mark.tf2

tf2_sensor_msgs = imported("tf2_sensor_msgs")
create_cloud = tf2_sensor_msgs.tf2_sensor_msgs.create_cloud
read_points = tf2_sensor_msgs.tf2_sensor_msgs.read_points

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


LITTLE = transform("map", "base", 1, (0.5, 0.25, 0.75))
TURNED = transform("map", "base", 1, (0.5, 0.5, 0.5), about_z(math.pi / 2))
FAR = transform("map", "base", 7, (10, 20, 30))


@pytest.mark.parametrize(
    ("kinds", "t", "points", "wanted"),
    [
        # Whole coordinates are cut off.
        *[((kind,) * 3, LITTLE, [(1, 2, 3), (100, 7, 0)], [(1, 2, 3), (100, 7, 0)]) for kind in WHOLE],
        *[((kind,) * 3, LITTLE, [(1, -2, 3), (9, 7, -4)], [(1, -1, 3), (9, 7, -3)]) for kind in WHOLE[::2]],
        (("i2",) * 3, TURNED, [(1000, 0, 0), (0, 1000, 5)], [(0, 1000, 0), (-999, 0, 5)]),
        *[
            (kinds, FAR, [(1, 2, 3), (4, 5, 6)], [(11, 22, 33), (14, 25, 36)])
            for kinds in (("f4", "f8", "f4"), ("i2", "f4", "u1"), ("u4", "i4", "f8"), ("i4", "f4", "f4"))
        ],
    ],
)
def test_coordinates_of_any_types_are_transformed_and_other_fields_stay(kinds, t, points, wanted):
    columns = [*zip("xyz", kinds, strict=True), ("intensity", "f4")]
    got = tf2_sensor_msgs.do_transform_cloud(cloud(columns, [(*point, 0.5) for point in points]), t)
    columns = columns_of(got)
    assert columns.pop("intensity") == [0.5, 0.5]
    assert [*zip(*columns.values(), strict=True)] == wanted


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


FIELDS = [
    PointField(name="x", offset=0, datatype=PointField.FLOAT32, count=1),
    PointField(name="normal", offset=8, datatype=PointField.INT16, count=3),
]
DTYPE = np.dtype(
    {
        "names": ["x", "normal_0", "normal_1", "normal_2"],
        "formats": ["<f4", "<i2", "<i2", "<i2"],
        "offsets": [0, 8, 10, 12],
        "itemsize": 16,
    }
)


@pytest.fixture
def points():
    points = np.zeros(4, DTYPE)
    points["x"] = [1.5, np.nan, 2.5, 3.5]
    points["normal_1"] = [1, 2, 3, -4]
    return points


def as_cloud(points, **fields):
    data = array.array("B", points.tobytes())
    return PointCloud2(height=2, width=2, fields=FIELDS, point_step=16, row_step=32, data=data, **fields)


class TestPoints:
    """The helpers for points that programs take from tf2's module."""

    @pytest.mark.parametrize(
        ("options", "name", "values"),
        [
            ({}, "x", [1.5, np.nan, 2.5, 3.5]),
            ({}, "normal_1", [1, 2, 3, -4]),
            ({"field_names": ["normal_1"], "uvs": [3, 0]}, "normal_1", [-4, 1]),
            ({"skip_nans": True}, "x", [1.5, 2.5, 3.5]),
            ({"reshape_organized_cloud": True}, "normal_1", [[1, 2], [3, -4]]),
        ],
        ids=str,
    )
    def test_points_are_read_as_chosen(self, points, options, name, values):
        big = as_cloud(points.astype(DTYPE.newbyteorder(">")), is_bigendian=True)
        for read in (as_cloud(points), big):
            got = read_points(read, **options)
            assert got.dtype.names == tuple(options.get("field_names", DTYPE.names))
            assert_allclose(got[name], values)

    def test_what_is_no_cloud_or_not_in_it_is_refused(self, points):
        for wrong in ((FIELDS,), (as_cloud(points), ["y"])):
            with pytest.raises(AssertionError):
                read_points(*wrong)
        with pytest.raises(AssertionError):
            create_cloud(Header(), FIELDS, np.zeros((2, 4)))

    def test_a_cloud_is_made_of_an_array_of_its_fields_of_rows_or_of_columns(self, points, floats):
        header = Header(frame_id="map")
        made = create_cloud(header, FIELDS, points, 16)
        assert (made.header, made.fields) == (header, FIELDS)
        assert (made.height, made.width, made.point_step, made.row_step) == (1, 4, 16, 64)
        assert read_points(made)["normal_1"].tolist() == [1, 2, 3, -4]
        made = create_cloud(header, FIELDS, [(1.5, 1, 2, 3), (2.5, 4, 5, 6)])
        assert (made.width, made.point_step) == (2, 14)
        assert read_points(made)["normal_2"].tolist() == [3, 6]
        made = create_cloud(header, floats.fields, np.arange(6, dtype=np.float32).reshape(2, 3))
        assert np.frombuffer(made.data, np.float32).tolist() == [0, 1, 2, 3, 4, 5]
