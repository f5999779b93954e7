"""What clouds and sensor readings become in another frame; clouds are judged byte by byte."""

import array
import copy
import math
import sys
import threading
from contextlib import suppress
from types import SimpleNamespace

import numpy as np
import pytest
from expected import transformed
from geometry_msgs.msg import Quaternion, Vector3
from hypothesis import given
from hypothesis import strategies as st
from leaks import assert_nothing_is_left
from making import stamp_ns, transform
from numpy.testing import assert_allclose
from random_messages import Maker, transforms
from sensor_msgs.msg import Imu, PointCloud2, PointField

import tf2_sensor_msgs as tf2

pytestmark = pytest.mark.ours

DATATYPES = {
    "f4": PointField.FLOAT32,
    "f8": PointField.FLOAT64,
    "u2": PointField.UINT16,
    "i4": PointField.INT32,
}
# Coordinates up to some hundred metres; float32 is rounded once, from the exact result.
TOLERANCE = {"f4": {"rtol": 2e-7, "atol": 1e-5}, "f8": {"rtol": 1e-13, "atol": 1e-9}}
XYZ = ("x", "y", "z")
NORMAL = ("normal_x", "normal_y", "normal_z")
VIEWPOINT = ("vp_x", "vp_y", "vp_z")


@pytest.fixture
def t():
    return transform("map", "base", 7.25, (1, 2, 3), (0.1, 0.2, 0.3, 0.9))


class Arrangement:
    """How a cloud's bytes lie: fields in order with the gaps before them, rows, and what follows."""

    def __init__(self, columns, gap=0, after_row=0, after_all=0, big=False, height=1, width=100):
        self.kinds = dict(columns)
        offsets, end = [], gap
        for kind in self.kinds.values():
            offsets.append(end)
            end += int(kind[1]) + gap
        formats = [(">" if big else "<") + kind for kind in self.kinds.values()]
        parts = {"names": [*self.kinds], "formats": formats, "offsets": offsets, "itemsize": end}
        self.point, self.shape, self.big = np.dtype(parts), (height, width), big
        self.row_step = end * width + after_row
        self.size = self.row_step * height + after_all

    def points(self, data):
        """A view of the points, of shape (height, width)."""
        return np.ndarray(self.shape, self.point, bytes(1) if 0 in self.shape else data, 0, self.strides)

    @property
    def strides(self):
        return self.row_step, self.point.itemsize

    def cloud(self):
        random = np.random.default_rng(0)
        data = bytearray(random.bytes(self.size))
        points = self.points(data)
        for name, kind in self.kinds.items():
            if kind[0] == "f" and points.size:
                points[name] = random.uniform(-100, 100, self.shape)
        for column, name in enumerate(XYZ):  # points that are none
            if points.size:
                points[name][:, 3 + column :: 11] = math.nan
        height, width = self.shape
        message = PointCloud2(height=height, width=width, is_bigendian=self.big)
        message.header.frame_id, message.header.stamp.sec, message.header.stamp.nanosec = "base", 3, 7
        message.fields = [
            PointField(name=name, offset=self.point.fields[name][1], datatype=DATATYPES[kind], count=1)
            for name, kind in self.kinds.items()
        ]
        message.point_step, message.row_step = self.point.itemsize, self.row_step
        message.data = array.array("B", data)
        return message

    def expected(self, cloud):
        """Arrangement and bytes of the result: points of x, y and z alone end with their last coordinate."""
        end = max(offset + kind.itemsize for kind, offset in self.point.fields.values())
        if {*self.kinds} != {*XYZ} or end == self.point.itemsize:
            return self, bytearray(cloud.data)
        new = copy.copy(self)
        new.point = np.dtype(
            {
                "names": XYZ,
                "formats": [self.point[n] for n in XYZ],
                "offsets": [self.point.fields[n][1] for n in XYZ],
            }
        )
        new.row_step = end * self.shape[1]
        if 0 in self.shape:
            return new, bytearray()
        kept = np.ndarray((*self.shape, end), np.uint8, bytes(cloud.data), 0, (*self.strides, 1))
        return new, bytearray(kept.tobytes())


def judge(arrangement, cloud, got, t, triples):
    """
    Carried coordinates are equal but for the last bits, every other byte is the same.

    :param triples: pairs of three names, and whether they move and not only turn.
    """
    arrangement, wanted_bytes = arrangement.expected(cloud)
    got_bytes = bytearray(got.data)
    assert len(got_bytes) == len(wanted_bytes)
    wanted, found = arrangement.points(wanted_bytes), arrangement.points(got_bytes)
    for names, moves in triples:
        by = copy.deepcopy(t)
        if not moves:
            by.transform.translation = Vector3()
        before = np.stack([wanted[name].ravel() for name in names], axis=-1).astype(np.float64)
        for name, column in zip(names, transformed(before, by).T, strict=True):
            assert_allclose(found[name].ravel(), column, **TOLERANCE[arrangement.kinds[name]])
            if found.size:
                found[name] = wanted[name]
    assert got_bytes == wanted_bytes
    assert (got.point_step, got.row_step) == (arrangement.point.itemsize, arrangement.row_step)


extra_fields = st.sampled_from([[], [("intensity", "f4")], [("ring", "u2"), ("time", "f8")], [("rgb", "i4")]])


@st.composite
def arrangements(draw):
    kind = draw(st.sampled_from(["f4", "f8"]))
    columns = [(name, kind) for name in XYZ]
    if draw(st.booleans()):
        columns += [(name, draw(st.shared(st.sampled_from(["f4", "f8"]), key="normal"))) for name in NORMAL]
    if draw(st.booleans()):
        columns += [(name, "f4") for name in VIEWPOINT]
    columns += draw(extra_fields)
    if draw(st.booleans()):
        columns = draw(st.permutations(columns))
    return Arrangement(
        columns,
        gap=draw(st.sampled_from([0, 0, 1, 4])),
        after_row=draw(st.sampled_from([0, 3, 16])),
        after_all=draw(st.sampled_from([0, 1, 64])),
        big=draw(st.booleans()),
        height=draw(st.sampled_from([0, 1, 2, 5])),
        width=draw(st.sampled_from([0, 1, 7, 8, 9, 40, 1000])),
    )


@given(arrangements(), transforms, st.booleans())
def test_clouds_of_every_arrangement(arrangement, t, only_xyz):
    # Coordinates of clouds do not reach 1e6 in float32.
    for axis in "xyz":
        setattr(t.transform.translation, axis, getattr(t.transform.translation, axis) * 1e-4)
    cloud = arrangement.cloud()
    before = copy.deepcopy(cloud)
    got = tf2.do_transform_cloud(cloud, t, only_xyz=only_xyz)
    triples = [(XYZ, True)]
    if not only_xyz:
        triples += [(NORMAL, False)] * ("normal_x" in arrangement.kinds)
        triples += [(VIEWPOINT, True)] * ("vp_x" in arrangement.kinds)
    judge(arrangement, cloud, got, t, triples)
    assert cloud == before
    for field in ("height", "width", "fields", "is_bigendian", "is_dense"):
        assert getattr(got, field) == getattr(cloud, field)


@pytest.fixture
def arrangement():
    columns = [(name, "f4") for name in (*XYZ, *NORMAL, *VIEWPOINT)]
    return Arrangement(columns, height=3, width=20)


def test_a_cloud_keeps_its_own_stamp_and_gets_the_frame_of_the_transform(arrangement, t):
    cloud = arrangement.cloud()
    got = tf2.do_transform_cloud(cloud, t)
    assert (got.header.frame_id, stamp_ns(got)) == ("map", 3_000_000_007)
    got.header.stamp.sec, got.fields[0].name = 0, "changed"
    assert stamp_ns(cloud) == 3_000_000_007 and cloud.fields[0].name == "x" and stamp_ns(t) == 7_250_000_000


WAYS = {
    "array.array": lambda data: data,
    "bytes": bytes,
    "bytearray": bytearray,
    "ndarray": lambda data: np.frombuffer(data, np.uint8),
    "ndarray with strides": lambda data: np.repeat(np.frombuffer(data, np.uint8), 2)[::2],
    "list": list,
    "tuple": tuple,
}


@pytest.mark.parametrize("way", WAYS)
def test_data_may_come_in_every_form(arrangement, t, way):
    cloud = arrangement.cloud()
    wanted = tf2.do_transform_cloud(cloud, t)
    data = WAYS[way](cloud.data)
    cloud.data = data  # what rosidl makes of it
    assert tf2.do_transform_cloud(cloud, t) == wanted
    cloud._data = data  # the thing itself
    assert tf2.do_transform_cloud(cloud, t) == wanted
    fields = {name: getattr(cloud, name) for name in PointCloud2.get_fields_and_field_types()}
    assert tf2.do_transform_cloud(SimpleNamespace(**fields), t) == wanted


def spoil(cloud, **changes):
    for name, value in changes.items():
        if name in PointCloud2.get_fields_and_field_types():
            setattr(cloud, name, value)
        else:
            field = next(f for f in cloud.fields if f.name == name)
            for key, part in value.items():
                setattr(field, key, part)
    return cloud


@pytest.mark.parametrize("name", [*NORMAL, *VIEWPOINT])
@pytest.mark.parametrize(
    "change", [{"name": "other"}, {"datatype": PointField.INT32}, {"datatype": 0}], ids=str
)
def test_normals_and_viewpoints_that_are_not_whole_stay_as_they_are(arrangement, t, name, change):
    cloud = spoil(arrangement.cloud(), **{name: change})
    other = (VIEWPOINT, True) if name in NORMAL else (NORMAL, False)
    judge(arrangement, cloud, tf2.do_transform_cloud(cloud, t), t, [(XYZ, True), other])


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        *[({name: {"name": "other"}}, f"no field '{name}'") for name in XYZ],
        ({"x": {"datatype": 9}}, "field 'x' is of datatype 9"),
        ({"z": {"datatype": 0}}, "field 'z' is of datatype 0"),
        ({"y": {"count": 2}}, "field 'y' holds 2 numbers"),
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
def test_a_cloud_that_contradicts_itself_is_a_value_error(arrangement, t, changes, reason):
    with pytest.raises(ValueError, match=reason) as raised:
        tf2.do_transform_cloud(spoil(arrangement.cloud(), **changes), t)
    # What tf2 raises where a field is missing.
    assert isinstance(raised.value, AssertionError) or "no field" not in reason


@pytest.mark.parametrize("row_step", [0, 1, 719, 721, 2160, 2**32 - 1])
def test_a_row_step_that_the_bytes_contradict_is_put_right(arrangement, t, row_step):
    # 721 would fit but for the last row.
    wanted = tf2.do_transform_cloud(arrangement.cloud(), t)
    assert tf2.do_transform_cloud(spoil(arrangement.cloud(), row_step=row_step), t) == wanted


def test_the_last_row_need_not_have_its_padding(t):
    columns = [*((name, "f4") for name in XYZ), ("ring", "u2")]
    padded = Arrangement(columns, after_row=5, height=3, width=20)
    cloud = padded.cloud()
    kept = np.frombuffer(tf2.do_transform_cloud(cloud, t).data, np.uint8).reshape(3, -1)[:, :-5]
    cloud.data = cloud.data[:-5]
    got = tf2.do_transform_cloud(cloud, t)
    assert (got.row_step, got.data.tobytes()) == (20 * padded.point.itemsize, kept.tobytes())


def test_other_threads_run_meanwhile(t):
    cloud = Arrangement([(name, "f4") for name in XYZ], width=1_000_000).cloud()
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
def test_a_cloud_needs_a_finite_rotation(arrangement, xyzw):
    with pytest.raises(ValueError, match="rotation of a transform"):
        tf2.do_transform_cloud(arrangement.cloud(), transform("map", "base", 0, xyzw=xyzw))


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


def test_calls_leave_nothing_behind(arrangement, t):
    cloud, broken, points = arrangement.cloud(), arrangement.cloud(), np.zeros((9, 3))
    broken.height = 99

    def call():
        tf2.do_transform_cloud(cloud, t)
        tf2.transform_points(points, t)
        for function, wrong in ((tf2.do_transform_cloud, broken), (tf2.transform_points, points[0])):
            with suppress(ValueError):
                function(wrong, t)

    assert_nothing_is_left(call, cloud.data, points, times=1000)
