"""The NumPy helpers that programs take from tf2's modules, by private names and by accident."""

import array
import importlib

import numpy as np
import pytest
from expected import turn
from geometry_msgs.msg import PoseWithCovarianceStamped
from hypothesis import given
from making import transform
from numpy.testing import assert_allclose
from random_messages import turns
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header

from tf2_geometry_msgs.tf2_geometry_msgs import (
    _build_affine,
    _decompose_affine,
    _get_mat_from_quat,
    _get_quat_from_mat,
    _transform_to_affine,
)

try:
    sensors = importlib.import_module("tf2_sensor_msgs.tf2_sensor_msgs")
except ModuleNotFoundError as missing:
    if missing.name != "sensor_msgs_py":
        raise
    sensors = None
needs_clouds = pytest.mark.skipif(sensors is None, reason="sensor_msgs_py is absent")


def wxyz(q):
    return np.array([q[3], *q[:3]])


@given(turns)
def test_a_quaternion_and_its_matrix(q):
    matrix = _get_mat_from_quat(wxyz(q))
    if sensors is not None:  # which has it, too
        assert np.array_equal(sensors._get_mat_from_quat(wxyz(q)), matrix)
    assert_allclose(matrix, turn(q).as_matrix(), atol=1e-12)
    back = _get_quat_from_mat(matrix)
    assert_allclose(np.linalg.norm(back), 1)
    assert back[0] >= 0
    assert_allclose(_get_mat_from_quat(back), matrix, atol=1e-9)


def test_no_quaternion_is_no_rotation_and_what_is_not_quite_one_has_a_nearest():
    for q in ((0.0, 0.0, 0.0, 0.0), (1e-9, 0.0, 0.0, 0.0)):
        assert np.array_equal(_get_mat_from_quat(np.array(q)), np.eye(3))
    rotation = turn((0.1, 0.2, 0.3, 0.9))
    got = _get_quat_from_mat(rotation.as_matrix() + 1e-3 * np.arange(9).reshape(3, 3))
    assert_allclose(got, wxyz(rotation.as_quat()), atol=5e-3)
    assert_allclose(np.linalg.norm(got), 1)


def test_an_affine_matrix_is_built_and_taken_apart():
    affine = _build_affine([0.5, 0.5, 0.5, 0.5], (1, 2, 3))
    assert_allclose(affine, [[0, 0, 1, 1], [1, 0, 0, 2], [0, 1, 0, 3], [0, 0, 0, 1]], atol=1e-15)
    rotation, translation = _decompose_affine(affine)
    assert_allclose(rotation, (0.5, 0.5, 0.5, 0.5))
    assert translation.tolist() == [1, 2, 3]
    assert np.array_equal(_build_affine(), np.eye(4))
    assert _build_affine(translation=[7, 8, 9])[:3, 3].tolist() == [7, 8, 9]
    assert_allclose(_transform_to_affine(transform("a", "b", 1, (1, 2, 3), (0.5, 0.5, 0.5, 0.5))), affine)
    with pytest.raises(AttributeError):
        _transform_to_affine(PoseWithCovarianceStamped())


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


@pytest.fixture
def cloud(points):
    cloud = PointCloud2(height=2, width=2, fields=FIELDS, point_step=16, row_step=32)
    cloud.data = array.array("B", points.tobytes())
    return cloud


@needs_clouds
class TestPoints:
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
    @pytest.mark.parametrize("big", [False, True])
    def test_points_are_read_as_chosen(self, cloud, points, options, name, values, big):
        if big:
            points = points.astype(DTYPE.newbyteorder(">"))
            cloud.data, cloud.is_bigendian = array.array("B", points.tobytes()), True
        got = sensors.read_points(cloud, **options)
        assert got.dtype.names == tuple(options.get("field_names", DTYPE.names))
        assert_allclose(got[name], values)

    def test_what_is_no_cloud_or_not_in_it_is_refused(self, cloud):
        for wrong in ((FIELDS,), (cloud, ["y"])):
            with pytest.raises(AssertionError):
                sensors.read_points(*wrong)
        with pytest.raises(AssertionError):
            sensors.create_cloud(Header(), FIELDS, np.zeros((2, 4)))

    def test_a_cloud_is_made_of_an_array_of_its_fields_of_rows_or_of_columns(self, points):
        header = Header(frame_id="map")
        made = sensors.create_cloud(header, FIELDS, points, 16)
        assert (made.header, made.fields) == (header, FIELDS)
        assert (made.height, made.width, made.point_step, made.row_step) == (1, 4, 16, 64)
        assert sensors.read_points(made)["normal_1"].tolist() == [1, 2, 3, -4]
        made = sensors.create_cloud(header, FIELDS, [(1.5, 1, 2, 3), (2.5, 4, 5, 6)])
        assert (made.width, made.point_step) == (2, 14)
        assert sensors.read_points(made)["normal_2"].tolist() == [3, 6]
        fields = [PointField(name=n, offset=4 * i, datatype=7, count=1) for i, n in enumerate("xyz")]
        made = sensors.create_cloud(header, fields, np.arange(6, dtype=np.float32).reshape(2, 3))
        assert np.frombuffer(made.data, np.float32).tolist() == [0, 1, 2, 3, 4, 5]
