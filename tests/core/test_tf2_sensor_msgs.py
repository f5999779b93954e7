# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What clouds and sensor readings become in another frame; the fuzz target `clouds` judges every byte."""

import array
import copy
import itertools
import math
import sys
import threading
from contextlib import suppress
from types import SimpleNamespace

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PointStamped, Quaternion
from hypothesis import given
from hypothesis import strategies as st
from leaks import assert_nothing_is_left
from numpy.testing import assert_allclose, assert_array_equal
from random_messages import Maker, transforms
from sensor_msgs.msg import Imu, PointCloud2, PointField
from std_msgs.msg import Header
from textbook_transforms import transformed
from times_and_transforms import S, stamp_ns, transform

import tf2_sensor_msgs as tf2
from tf2_py import BufferCore
from tf2_sensor_msgs._point_cloud2_standin import read_points

XYZ = ("x", "y", "z")
NORMAL = ("normal_x", "normal_y", "normal_z")
VIEWPOINT = ("vp_x", "vp_y", "vp_z")


@pytest.fixture
def t():
    return transform("map", "base", 7.25, (1, 2, 3), (0.1, 0.2, 0.3, 0.9))


# Coordinates up to some hundred meters; float32 is rounded once, from the exact result.
TOLERANCE = {4: {"rtol": 2e-7, "atol": 1e-5}, 8: {"rtol": 1e-13, "atol": 1e-9}}


def cloud_of(names, numbers, kind="<f4"):
    """A cloud of fields of one kind, of numbers of shape (height, width, fields)."""
    (height, width, count), size = numbers.shape, np.dtype(kind).itemsize
    message = PointCloud2(height=height, width=width, point_step=size * count, row_step=size * count * width)
    message.is_bigendian = kind[0] == ">"
    message.header.frame_id, message.header.stamp.sec, message.header.stamp.nanosec = "base", 3, 7
    message.fields = [
        PointField(
            name=name,
            offset=size * i,
            datatype=PointField.FLOAT32 if size == 4 else PointField.FLOAT64,
            count=1,
        )
        for i, name in enumerate(names)
    ]
    message.data = array.array("B", numbers.astype(kind).tobytes())
    return message


def whole_cloud(kind):
    names = (*XYZ, *NORMAL, *VIEWPOINT)
    return cloud_of(names, np.random.default_rng(0).uniform(-100, 100, (3, 20, len(names))), kind)


@pytest.fixture
def cloud():
    return whole_cloud("<f4")


def test_a_cloud_keeps_its_own_stamp_and_gets_the_frame_of_the_transform(cloud, t):
    before = copy.deepcopy(cloud)
    got = tf2.do_transform_cloud(cloud, t)
    assert (got.header.frame_id, stamp_ns(got)) == ("map", 3_000_000_007)
    for field in ("height", "width", "fields", "is_bigendian", "is_dense"):
        assert getattr(got, field) == getattr(cloud, field)
    got.header.stamp.sec, got.fields[0].name = 0, "changed"
    assert cloud == before and stamp_ns(t) == 7_250_000_000


def test_the_bytes_after_the_points_of_each_row_stay(cloud, t):
    used, before = cloud.row_step, cloud.data.tobytes()
    moved = tf2.do_transform_cloud(cloud, t).data.tobytes()
    for seed in range(5):  # new memory may have the bytes of the last one
        padding = np.random.default_rng(seed).bytes(7 * cloud.height)

        def padded(rows, padding=padding):
            return b"".join(rows[i * used :][:used] + padding[7 * i :][:7] for i in range(cloud.height))

        cloud.row_step, cloud.data = used + 7, array.array("B", padded(before))
        got = tf2.do_transform_cloud(cloud, t)
        assert (got.row_step, got.data.tobytes()) == (used + 7, padded(moved))


def test_rows_are_contiguous_where_row_step_contradicts_the_data():
    """The last row may lack the bytes after its points; then no row of the result has any."""
    shape, used = (3, 2, 3), 24
    for row_step, size in itertools.product((0, used - 1, *range(used, used + 9)), range(72, 112)):
        message, dice = cloud_of(XYZ, np.zeros(shape)), np.random.default_rng(size)
        message.row_step, message.data = row_step, array.array("B", dice.integers(48, 80, size, np.uint8))
        is_right = row_step >= used and size >= 2 * row_step + used
        wanted = np.ndarray(shape, "<f4", message.data, 0, (row_step if is_right else used, 12, 4)) + 1
        got = tf2.do_transform_cloud(message, transform("map", "base", 0, (1, 1, 1)))
        is_whole = row_step >= used and size >= 3 * row_step
        assert (got.row_step, len(got.data)) == ((row_step, size) if is_whole else (used, 3 * used))
        assert_array_equal(np.ndarray(shape, "<f4", got.data, 0, (got.row_step, 12, 4)), wanted)


def test_a_cloud_without_a_time_is_transformed_by_the_latest_and_keeps_its_stamp(cloud, tf2_ros):
    buffer = tf2_ros.Buffer()
    for seconds in (1, 2, 3):
        buffer.set_transform(latest := transform("map", "base", seconds, (seconds, 0, 0)), "x")
    cloud.header.stamp = Time()
    got = buffer.transform(cloud, "map")
    assert (got.header.frame_id, stamp_ns(got)) == ("map", 0)
    assert got.data == tf2.do_transform_cloud(cloud, latest).data
    point = PointStamped(header=Header(frame_id="base"))
    assert stamp_ns(buffer.transform(point, "map")) == 3_000_000_000  # that of the transform


def numbers_of(cloud, kind="<f4"):
    return np.frombuffer(cloud.data, kind).reshape(-1, 3, 3).swapaxes(0, 1)


@pytest.mark.parametrize("kind", ["<f4", ">f4", "<f8", ">f8"])
def test_normals_turn_and_viewpoints_move_like_points(t, kind):
    turn, cloud = transform("map", "base", 0, (0, 0, 0), (0.1, 0.2, 0.3, 0.9)), whole_cloud(kind)
    got = numbers_of(tf2.do_transform_cloud(cloud, t), kind)
    for before, after, by in zip(numbers_of(cloud, kind), got, (t, turn, t), strict=True):
        wanted = transformed(before.astype(np.float64), by)
        assert_allclose(after, wanted, **TOLERANCE[after.itemsize])


@pytest.mark.parametrize("names", [XYZ, (*XYZ, *NORMAL)])
def test_many_points_become_what_each_of_them_becomes(t, names):
    numbers = np.random.default_rng(0).uniform(-100, 100, (1, 1000, len(names)))
    each = [tf2.do_transform_cloud(cloud_of(names, numbers[:, i : i + 1]), t).data for i in range(1000)]
    got = tf2.do_transform_cloud(cloud_of(names, numbers), t)
    assert got.data.tobytes() == b"".join(each)


class DeviceBuffer:
    """
    What Lyrical's ``rosidl_buffer.Buffer`` offers, which stands for bytes in the memory of a device.

    rclpy puts one in place of the array if the publisher of a message shares such memory. It has no buffer
    protocol, no iteration and no index.
    """

    __slots__ = ("_device",)
    __hash__ = None
    backend_type = "cuda"
    is_cpu = False

    def __init__(self, data):
        self._device = bytes(data)

    def to_bytes(self):
        return self._device

    def __len__(self):
        return len(self._device)


WAYS = {
    "array.array": lambda data: data,
    "bytes": bytes,
    "bytearray": bytearray,
    "ndarray": lambda data: np.frombuffer(data, np.uint8),
    "ndarray with strides": lambda data: np.repeat(np.frombuffer(data, np.uint8), 2)[::2],
    "list": list,
    "tuple": tuple,
    "rosidl_buffer": DeviceBuffer,
}
# The class of messages checks what is assigned, and an older one does not know that buffer.
ASSIGNED = [way for way in WAYS if way != "rosidl_buffer"]


@pytest.mark.parametrize("way", WAYS)
def test_data_may_come_in_every_form(cloud, t, way):
    wanted = tf2.do_transform_cloud(cloud, t)
    data = WAYS[way](cloud.data)
    if way in ASSIGNED:
        cloud.data = data  # what rosidl makes of it
        assert tf2.do_transform_cloud(cloud, t) == wanted
    cloud._data = data  # the thing itself
    assert tf2.do_transform_cloud(cloud, t) == wanted
    fields = {name: getattr(cloud, name) for name in PointCloud2.get_fields_and_field_types()}
    assert tf2.do_transform_cloud(SimpleNamespace(**fields), t) == wanted


@pytest.mark.parametrize("way", WAYS)
def test_data_in_every_form_is_read_and_deskewed(cloud, way):
    buffer = BufferCore()
    buffer.set_transform_static(transform("map", "base", 0, (1, 2, 3)), "test")
    times = np.full(cloud.width * cloud.height, S)
    points, moved = read_points(cloud), tf2.deskew(cloud, buffer, "map", times=times)
    cloud._data = WAYS[way](cloud.data)
    assert (read_points(cloud) == points).all()
    assert tf2.deskew(cloud, buffer, "map", times=times) == moved


def test_deskew_copies_the_memory_of_a_device_once(cloud):
    copies, buffer = [], BufferCore()
    buffer.set_transform_static(transform("map", "base"), "test")

    class Counting(DeviceBuffer):
        def to_bytes(self):
            copies.append(super().to_bytes())
            return copies[-1]

    cloud._data = Counting(cloud.data)
    tf2.deskew(cloud, buffer, "map", times=np.full(cloud.width * cloud.height, S))
    assert len(copies) == 1


class Elsewhere:
    """Neither bytes, nor numbers, nor a way to get them."""

    def __len__(self):
        return 12


@pytest.mark.parametrize("data", [None, 5, Elsewhere(), 0.5, object()], ids=lambda data: type(data).__name__)
@pytest.mark.parametrize("call", ["do_transform_cloud", "deskew", "read_points"])
def test_data_that_cannot_be_read_is_named_with_what_to_do(cloud, t, call, data):
    calls = {
        "do_transform_cloud": lambda: tf2.do_transform_cloud(cloud, t),
        "deskew": lambda: tf2.deskew(cloud, BufferCore(), "map", times=np.full(60, S)),
        "read_points": lambda: read_points(cloud),
    }
    cloud._data = data
    with pytest.raises(TypeError) as raised:
        calls[call]()
    assert str(raised.value) == (
        f"data: expected bytes or uint8 numbers, got {type(data).__name__}: copy it to main memory, for "
        "example into an array.array('B')"
    )


def spoil(cloud, **changes):
    for name, value in changes.items():
        if name in PointCloud2.get_fields_and_field_types():
            setattr(cloud, name, value)
        else:
            field = next(f for f in cloud.fields if f.name == name)
            for key, part in value.items():
                setattr(field, key, part)
    return cloud


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        *[({name: {"name": "other"}}, f"no field '{name}'") for name in XYZ],
        ({"x": {"datatype": 9}}, r"field 'x': expected a datatype from 1 \(INT8\) to 8 \(FLOAT64\), got 9"),
        ({"z": {"datatype": 0}}, r"field 'z': expected a datatype from .*, got 0"),
        ({"y": {"count": 2}}, "field 'y': expected a count of 1, got 2"),
        ({"y": {"offset": 33}}, "field 'y' at offset 33 reaches beyond point_step 36"),
        ({"vp_z": {"offset": 2**32 - 1}}, "field 'vp_z' at offset 4294967295 reaches beyond"),
        ({"point_step": 35}, "field 'vp_z' at offset 32 reaches beyond point_step 35"),
        ({"point_step": 0}, "field 'x' at offset 0 reaches beyond point_step 0"),
        ({"width": 21}, "data has 2160 bytes, less than height 3 x width 21 x point_step 36"),
        ({"height": 4}, "data has 2160 bytes, less than height 4"),
        ({"height": 2**32 - 1, "row_step": 2**32 - 1}, "data has 2160 bytes, less than"),
        ({"width": 2**32 - 1, "point_step": 2**32 - 1}, "data has 2160 bytes, less than"),
        ({"data": array.array("B", bytes(2159))}, "data has 2159 bytes, less than height 3"),
        ({"data": []}, "data has 0 bytes"),
        ({"fields": []}, "no field 'x'"),
        ({"height": -1}, "height = -1 is out of the range of a uint32"),
        ({"row_step": 2**32}, "row_step = 4294967296 is out of the range"),
        ({"x": {"offset": -4}}, "offset = -4 is out of the range"),
    ],
)
def test_a_cloud_that_contradicts_itself_is_a_value_error(cloud, t, changes, reason):
    with pytest.raises(ValueError, match=reason) as raised:
        tf2.do_transform_cloud(spoil(cloud, **changes), t)
    # What tf2 raises where a field is missing.
    assert isinstance(raised.value, AssertionError) or "no field" not in reason


def test_other_threads_run_meanwhile(t):
    cloud = cloud_of(XYZ, np.zeros((1, 1_000_000, 3)))
    ran, go, interval = [], threading.Event(), sys.getswitchinterval()
    thread = threading.Thread(target=lambda: (go.wait(), ran.append(True)))
    thread.start()
    sys.setswitchinterval(1000)  # nobody is made to let go of the GIL
    try:
        go.set()
        for _ in range(1000):
            tf2.do_transform_cloud(cloud, t)
            if ran:
                break
        assert ran
    finally:
        sys.setswitchinterval(interval)
        thread.join()


@pytest.mark.parametrize(
    ("call", "subject", "error", "text"),
    [
        *[(tf2.do_transform_cloud, w, AttributeError, "a sensor_msgs/PointCloud2") for w in (None, Imu())],
        *[(tf2.do_transform_cloud, w, TypeError, "a sensor_msgs/PointCloud2") for w in (5, Imu())],
        *[
            (tf2.transform_points, np.zeros(s), ValueError, r"shape \(n, 3\)")
            for s in ((3,), (2, 4), (1, 2, 3), ())
        ],
        *[(tf2.transform_points, w, TypeError, "real numbers") for w in (np.eye(3) * 1j, [["a"] * 3], None)],
    ],
)
def test_what_is_no_cloud_and_no_points_is_refused(t, call, subject, error, text):
    with pytest.raises(error, match=f"expected {text}|{text}"):
        call(subject, t)


@pytest.mark.parametrize("xyzw", [(math.nan, 0, 0, 1), (0, math.inf, 0, 0), (1e200, 0, 0, 0)], ids=str)
def test_a_cloud_needs_a_finite_rotation(cloud, xyzw):
    with pytest.raises(ValueError, match="transform.rotation: expected a quaternion of finite length"):
        tf2.do_transform_cloud(cloud, transform("map", "base", 0, xyzw=xyzw))


VIEWS = {
    "whole numbers": lambda p: p.astype(np.int16),
    "lists": lambda p: p.tolist() or np.zeros((0, 3)),
    "plain": lambda p: p,
    "fortran": np.asfortranarray,
    "reversed": lambda p: p[::-1],
    "every third": lambda p: np.repeat(p, 3, axis=0)[::3],
    "columns of more": lambda p: np.hstack([p, p, p])[:, 3:6],
    "columns backwards": lambda p: p[:, ::-1].copy()[:, ::-1],
    "unaligned": lambda p: np.frombuffer(b"x" + p.tobytes(), np.uint8)[1:].view(p.dtype).reshape(p.shape),
    "broadcast": lambda p: np.broadcast_to(p[:1], p.shape),
    "read-only": lambda p: np.frombuffer(p.tobytes(), p.dtype).reshape(p.shape),
    "other byte order": lambda p: p.astype(p.dtype.newbyteorder()),
}


@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@given(t=transforms, count=st.sampled_from([0, 1, 2, 8, 9, 1000]), seed=st.integers(0, 9))
def test_points_of_an_array_of_any_strides(view, dtype, t, count, seed):
    points = VIEWS[view](np.random.default_rng(seed).uniform(-100, 100, (count, 3)).astype(dtype))
    before = np.array(points)
    dtype = before.dtype.newbyteorder("=") if before.dtype.kind == "f" else np.float64
    got = tf2.transform_points(points, t)
    assert got.dtype == dtype and got.shape == (count, 3)
    wanted = transformed(before.astype(np.float64), t)
    # The translation reaches 1e6.
    assert_allclose(got, wanted, rtol=2e-7 if dtype == np.float32 else 1e-12, atol=1e-8)
    assert np.array_equal(points, before)
    assert np.array_equal(tf2.transform_points(points, t.transform), got)


def test_what_an_imu_marks_as_absent_stays_so(t):
    imu = Maker(2).message(Imu)
    imu.orientation = Quaternion(x=0.0, y=0.0, z=0.0, w=0.0)
    parts = [f"{name}_covariance" for name in ("orientation", "angular_velocity", "linear_acceleration")]
    for part in parts:
        setattr(imu, part, [-1.0] + [0.0] * 8)
    got = tf2.do_transform_imu(imu, t)
    assert got.orientation == imu.orientation
    assert all(getattr(got, part).tolist() == [-1.0] + [0.0] * 8 for part in parts)
    imu.orientation.w = math.nan
    assert math.isnan(tf2.do_transform_imu(imu, t).orientation.w)


def test_calls_leave_nothing_behind(cloud, t):
    broken, points = copy.deepcopy(cloud), np.zeros((9, 3))
    broken.height = 99

    def call():
        tf2.do_transform_cloud(cloud, t)
        tf2.transform_points(points, t)
        for function, wrong in ((tf2.do_transform_cloud, broken), (tf2.transform_points, points[0])):
            with suppress(ValueError):
                function(wrong, t)

    assert_nothing_is_left(call, cloud.data, points, times=1000)
