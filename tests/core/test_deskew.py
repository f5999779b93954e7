# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Deskewing: each point of a cloud is moved from where the sensor was when it measured that point."""

import array
import mmap
import threading
import warnings
from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest
from rclpy.duration import Duration
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header
from times_and_transforms import S, about_z, at_ns, stamp_ns, transform
from waiting import DEADLINE_S, until

import tf2_sensor_msgs._deskew as inside
from tf2_py.typing import LookupPolicy
from tf2_ros import (
    Buffer,
    BufferCore,
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
    TransformException,
)
from tf2_sensor_msgs import deskew, do_transform_cloud

START = 1_700_000_000 * S
SWEEP = S // 10
STAMP = START + 2 * SWEEP
KINDS = {"f4": PointField.FLOAT32, "f8": PointField.FLOAT64, "u4": PointField.UINT32, "u2": PointField.UINT16}
XYZ = [("x", "f4", 0), ("y", "f4", 4), ("z", "f4", 8)]
SINCE_STAMP = np.linspace(0, SWEEP, 4000).astype(np.int64)
# The fields as the drivers write them, and the time of each point, from the ns since the stamp.
DRIVERS = {
    "velodyne": ([*XYZ, ("intensity", "f4", 12), ("ring", "u2", 16), ("time", "f4", 18)], 22,
                 lambda ns: ns / S),
    "ouster": ([*XYZ, ("intensity", "f4", 16), ("t", "u4", 20), ("ring", "u2", 26)], 48, lambda ns: ns),
    "livox": ([*XYZ, ("intensity", "f4", 12), ("timestamp", "f8", 18)], 26, lambda ns: STAMP + ns),
    "hesai": ([*XYZ, ("intensity", "f4", 12), ("ring", "u2", 16), ("timestamp", "f8", 18)], 26,
              lambda ns: (STAMP + ns) / S),
    "seconds in double": ([*XYZ, ("time", "f8", 12)], 20, lambda ns: ns / S),
}  # fmt: skip
NAT = np.datetime64("NaT", "ns")
TIME_FIELDS = ("time", "t", "offset_time", "timestamp")


def dtype_of(fields, step, order="<"):
    names, formats, offsets = zip(*fields, strict=True)
    formats = [order + one for one in formats]
    return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": step})


def as_cloud(points, fields, rows=1, padding=0):
    """A cloud of a structured array, in rows with padding behind each."""
    cloud = PointCloud2(header=Header(frame_id="lidar", stamp=at_ns(STAMP).to_msg()))
    cloud.fields = [
        PointField(name=name, offset=at, datatype=KINDS[kind], count=1) for name, kind, at in fields
    ]
    cloud.height, cloud.width = rows, len(points) // rows
    cloud.point_step, cloud.row_step = points.dtype.itemsize, points.dtype.itemsize * cloud.width + padding
    cloud.is_bigendian = points.dtype["x"].byteorder == ">"
    cloud.is_dense = True
    rows_of_bytes = [row.tobytes() + b"\xaa" * padding for row in points.reshape(rows, -1)]
    cloud.data = array.array("B", b"".join(rows_of_bytes))
    return cloud


def points_of(cloud, dtype):
    used = cloud.width * cloud.point_step
    data = bytes(cloud.data)
    rows = [data[i * cloud.row_step : i * cloud.row_step + used] for i in range(cloud.height)]
    return np.frombuffer(b"".join(rows), dtype)


def xyz_of(points):
    return np.stack([points[name] for name in "xyz"], axis=1).astype(float)


def measured(driver, since_stamp=SINCE_STAMP, order="<", **shape):
    """A sweep as this driver writes it, its points, and the ns of each."""
    fields, step, time_of = DRIVERS[driver]
    points = np.zeros(len(since_stamp), dtype_of(fields, step, order))
    coordinates = np.random.default_rng(4).uniform(-100, 100, (len(points), 3))
    for i, name in enumerate("xyz"):
        points[name] = coordinates[:, i]
    for name, _, _ in fields[3:]:
        if name not in ("x", "y", "z"):
            points[name] = np.arange(len(points)) % 60000
    points[name_of_times(fields)] = time_of(since_stamp)
    return as_cloud(points, fields, **shape), points, STAMP + since_stamp


def name_of_times(fields):
    return next(name for name, _, _ in fields if name in TIME_FIELDS)


def driving(speed=8.0, turn=1.0, hops=1, make=Buffer):
    """A robot on a curve, with samples at uneven times; the lidar is mounted on it."""
    buffer, dice = make(Duration(seconds=100)), np.random.default_rng(2)
    chain = ["odom", *(f"joint_{i}" for i in range(hops - 1)), "base"]
    for parent, child in zip(chain[:-1], chain[1:], strict=True):
        for ns in START + np.cumsum(dice.integers(4_000_000, 14_000_000, 80)):
            seconds = (int(ns) - START) / S
            xyz = speed * seconds, np.sin(turn * seconds), 0.1 * seconds
            buffer.set_transform(
                transform(parent, child, ns=int(ns), xyz=xyz, xyzw=about_z(turn * seconds)), "x"
            )
    mount = transform("base", "lidar", xyz=(0.4, 0.1, 1.6), xyzw=(0.5, 0.5, 0.5, 0.5))
    buffer.set_transform_static(mount, "x")
    return buffer


@pytest.fixture(scope="module")
def buffer():
    return driving()


def expected(buffer, xyz, times, target="odom", **how):
    return buffer.transform_points(xyz, times, target, "lidar", **how)


def assert_moved(cloud, wanted, xyz, dtype, time_error_m=2e-5):
    """By at most what is promised, how exact the times are, and the rounding of coordinates of this type."""
    got = xyz_of(points_of(cloud, dtype))
    distance = np.linalg.norm(xyz, axis=1, keepdims=True)
    allowed = 1e-5 + 1e-6 * distance + time_error_m + np.abs(wanted) * np.finfo(dtype["x"]).eps
    assert (np.abs(got - wanted) <= allowed).all()


# 238 ns, the distance of doubles of seconds since 1970, at 8 m/s and 1 rad/s in 170 m.
OF_TIMES_M = 238e-9 * (8 + 170)


def test_a_jerk_between_two_samples_is_not_missed(buffer):
    """A sample that differs from both neighbors, a millisecond apart, within a sweep of few poses."""
    buffer = driving(turn=0.0)
    for ns, x in ((0, 0.0), (1_000_000, 5.0), (2_000_000, 0.0)):
        jerk = transform("odom", "base", ns=STAMP + SWEEP // 3 + ns, xyz=(x, 0, 0), xyzw=about_z(x))
        buffer.set_transform(jerk, "x")
    cloud, points, times = measured("ouster", np.linspace(0, SWEEP, 20_000).astype(np.int64))
    assert_moved(
        deskew(cloud, buffer, "odom"), expected(buffer, xyz_of(points), times), xyz_of(points), points.dtype
    )


def swinging(angles, lengths, segments):
    """
    Arms that swing against each other, from one end to the other between two samples.

    Each arm turns by minus to plus its angle, and what it carries turns back, so that the lidar only shifts:
    by the sum of the lengths times cos or sin of the angles.
    """
    buffer = Buffer(float("inf"))
    for i, (angle, length) in enumerate(zip(angles, lengths, strict=True)):
        parent, child = f"link_{i}" if i else "odom", f"link_{i + 1}" if i + 1 < len(angles) else "lidar"
        arm = transform(f"swing_{i}", f"arm_{i}", xyz=(length, 0, 0))
        buffer.set_transform_static(arm, "x")
        for k in range(segments + 1):
            ns = STAMP + SWEEP * k // segments
            turned = angle if k % 2 else -angle
            buffer.set_transform(transform(parent, f"swing_{i}", ns=ns, xyzw=about_z(turned)), "x")
            buffer.set_transform(transform(f"arm_{i}", child, ns=ns, xyzw=about_z(-turned)), "x")
    return buffer


def balanced(angles, parts):
    """Lengths of the arms, 1 m for the first, with which the lidar is on a line at these parts of a swing."""
    bends = [[np.cos(a * (2 * part - 1)) - np.cos(a) for a in angles] for part in parts]
    bends += [[np.sin(a * (2 * part - 1)) - (2 * part - 1) * np.sin(a) for a in angles] for part in parts]
    bends = np.array(bends)
    rest = np.linalg.lstsq(bends[:, 1:], -bends[:, 0], rcond=None)[0]
    return [1.0, *rest]


@pytest.mark.parametrize("segments", [1, 7, 40, 100])
@pytest.mark.parametrize(
    ("degrees", "parts"),
    [
        ((20, 10), [0.5]),
        ((5, 2.5), [0.5]),
        ((30, 10), [0.5]),
        ((30, 20, 10), [0.25, 0.75]),
        ((40, 30, 20, 10), [0.25, 0.5, 0.75]),
        ((80, 60, 40, 20, 10), [1 / 3, 2 / 3, 0.1]),
    ],
)
def test_a_motion_that_looks_steady_at_some_times_keeps_the_bound(segments, degrees, parts):
    """In the middle between two samples, at the quarters, or elsewhere, the lidar is where a line leads."""
    angles = np.radians(degrees)
    buffer = swinging(angles, balanced(angles, parts), segments)
    cloud, points, times = measured("ouster", np.linspace(0, SWEEP, 50_000).astype(np.int64))
    moved = deskew(cloud, buffer, "odom")
    assert_moved(moved, expected(buffer, xyz_of(points), times), xyz_of(points), points.dtype, 0.0)


@pytest.mark.parametrize("arm", [0, 1000])
@pytest.mark.parametrize("reached", ["odom", "lidar"])
def test_the_bound_holds_in_a_target_that_turns(reached, arm):
    """A SLAM may publish the pose of odom in the robot, as a child; it turns at the end of an arm."""
    buffer = Buffer(float("inf"))
    for i in range(30):
        ns = STAMP + (i - 10) * SWEEP // 4
        xyz, turned = (arm, arm * i / 1000, 0), about_z(0.1 * i)
        buffer.set_transform(transform("lidar", "odom", ns=ns, xyz=xyz, xyzw=turned), "x")
    cloud, points, times = measured("velodyne", np.linspace(0, SWEEP, 100_000).astype(np.int64))
    how = {} if reached == "odom" else {"fixed_frame": "odom", "target_time": at_ns(STAMP)}
    moved = deskew(cloud, buffer, reached, *how.values())
    wanted = expected(buffer, xyz_of(points), times, reached, **how)
    assert_moved(moved, wanted, xyz_of(points), points.dtype)


# What points lack.


@pytest.mark.parametrize("driver", ["velodyne", "ouster", "livox"])
def test_nothing_is_waited_for_without_coordinates(driver):
    buffer, (_, points, _) = Buffer(), measured(driver)
    points["x"] = np.nan
    buffer.set_transform(transform("odom", "lidar", ns=STAMP - SWEEP), "x")
    no_points, nan = measured(driver, SINCE_STAMP[:0])[0], as_cloud(points, DRIVERS[driver][0])
    for one in (no_points, nan):
        assert deskew(one, buffer, "odom", timeout=float("inf")).header.frame_id == "odom"


def missing_in(cloud, dtype):
    return np.flatnonzero(np.isnan(xyz_of(points_of(cloud, dtype))).all(axis=1)).tolist()


def test_garbage_does_not_delay_the_other_points(tf2_ros):
    """The wait is for the last time that is near the stamp; its transform arrives during the wait."""
    buffer = tf2_ros.Buffer(Duration(seconds=100))
    buffer.set_transform(transform("odom", "lidar", ns=STAMP), "x")
    cloud, points, times = measured("velodyne")
    points["time"][[0, 1234]] = 1000.0
    late = transform("odom", "lidar", ns=STAMP + 2 * SWEEP, xyz=(1, 0, 0))
    thread = threading.Timer(0.1, lambda: buffer.set_transform(late, "x"))
    thread.start()
    moved = deskew(as_cloud(points, DRIVERS["velodyne"][0]), buffer, "odom", timeout=3600, on_missing="nan")
    thread.join()
    assert missing_in(moved, points.dtype) == [0, 1234]


@pytest.mark.parametrize(
    ("given", "error", "text"),
    [
        ([0, -5, 2**31 * S - 1], ExtrapolationException, r"^times\[7\]: Lookup"),
        ([2**31 * S], OverflowError, r"^times\[7\]: the time 2147483648\.000000000 s does not fit"),
        ([0, 1 - 2**63, 2**63 - 1], OverflowError, r"^times\[8\]: the time -9223372036\.854775807 s does"),
    ],
)
def test_garbage_among_given_times(buffer, given, error, text):
    cloud, points, times = measured("ouster")
    times = times.copy()
    times[7 : 7 + len(given)] = given
    with pytest.raises(error, match=text):
        deskew(cloud, buffer, "odom", times=times)
    moved = deskew(cloud, buffer, "odom", times=times, on_missing="nan")
    assert missing_in(moved, points.dtype) == list(range(7, 7 + len(given)))


def test_no_pose_is_interpolated_between_times_that_no_stamp_can_hold():
    """Static transforms answer at any other time."""
    buffer = Buffer(Duration(seconds=10))
    buffer.set_transform_static(transform("odom", "lidar", xyz=(1, 0, 0)), "x")
    cloud, points, times = measured("ouster")
    late = times - times[0] + 2**31 * S
    with pytest.raises(OverflowError, match=r"^times\[0\]: the time 2147483648\.000000000 s does not fit"):
        deskew(cloud, buffer, "odom", times=late)
    moved = deskew(cloud, buffer, "odom", times=late - S // 20, on_missing="nan")
    assert missing_in(moved, points.dtype) == np.flatnonzero(late - S // 20 >= 2**31 * S).tolist()


def test_the_least_integer_is_not_a_time(buffer):
    """It is NaT in the memory of a datetime64."""
    cloud, points, times = measured("ouster")
    times = np.where(np.arange(len(times)) == 7, -(2**63), times)
    with pytest.raises(ValueError, match=r"^times\[7\]: expected a time, got NaT \(the smallest int64\)$"):
        deskew(cloud, buffer, "odom", times=times)
    assert missing_in(deskew(cloud, buffer, "odom", times=times, on_missing="nan"), points.dtype) == [7]


def test_a_time_of_any_type_may_be_missing(buffer):
    cloud, points, times = measured("velodyne", SINCE_STAMP[:4])
    stamps = times.view("M8[ns]")
    wanted = deskew(cloud, buffer, "odom", times=np.where([0, 1, 0, 0], NAT, stamps), on_missing="nan")
    mixed = [times[0].item(), NAT, at_ns(times[2].item()), stamps[3].astype("M8[ns]")]
    for given in ([stamps[0], NAT, *stamps[2:]], mixed, np.array(mixed, object)):
        moved = deskew(cloud, buffer, "odom", times=given, on_missing="nan")
        assert moved.data == wanted.data


@pytest.mark.long("needs pandas")
def test_a_time_of_pandas_may_be_missing(buffer):
    pandas = pytest.importorskip("pandas")
    cloud, points, times = measured("velodyne", SINCE_STAMP[:4])
    stamps = np.where([0, 1, 0, 0], NAT, times.view("M8[ns]"))
    wanted = deskew(cloud, buffer, "odom", times=stamps, on_missing="nan")
    given = [pandas.Timestamp(times[0]), pandas.NaT, *map(pandas.Timestamp, times[2:])]
    assert deskew(cloud, buffer, "odom", times=given, on_missing="nan").data == wanted.data
    with pytest.raises(ValueError, match=r"^times\[1\]: expected a time, got NaT"):
        deskew(cloud, buffer, "odom", times=given)


# What a 1 in the field means.


@pytest.mark.parametrize(
    ("driver", "end", "unit", "said"),
    [
        ("velodyne", 99_800, 1.0, "all times span 99800 s: if they are not s after the stamp, pass"),
        ("velodyne", -50, 1.0, "all times span 50 s: if they are not s after the stamp, pass time_unit)"),
        ("ouster", 2e9 * 2, 1e-9, "all times span 4.29397 s: if they are not ns after the stamp, pass"),
    ],
)
def test_a_sweep_of_any_length_is_moved_but_an_error_in_a_long_one_says_so(buffer, driver, end, unit, said):
    """Then the numbers may be milliseconds or microseconds."""
    long = Buffer(float("inf"))
    for ns, x in ((START - 10**6 * S, -1e6), (START + 10**6 * S, 1e6)):
        long.set_transform(transform("odom", "lidar", ns=ns, xyz=(x, 0, 0)), "x")
    fields, step, _ = DRIVERS[driver]
    points = np.zeros(4001, dtype_of(fields, step))
    points[name_of_times(fields)] = np.linspace(0, end, 4001)
    cloud = as_cloud(points, fields)
    numbers = points[name_of_times(fields)].astype(float)
    if driver == "ouster":
        numbers[numbers >= 2**31] -= 2**32
    moved = points_of(deskew(cloud, long, "odom"), points.dtype)
    assert moved["x"] == pytest.approx(numbers * unit + (STAMP - START) / S, abs=1e-3, rel=1e-6)
    with pytest.raises(ExtrapolationException, match=r"^points\[\d+\]") as error:
        deskew(cloud, buffer, "odom")
    assert said in str(error.value)
    assert deskew(cloud, buffer, "odom", on_missing="nan") == deskew(
        cloud, buffer, "odom", on_missing="nan", time_unit=unit
    )


@pytest.mark.parametrize("factor", [0, 1e-6, 1e-3, 0.0099], ids=["unset", "ms", "us", "990 us"])
def test_a_sweep_of_many_points_in_no_time_is_reported(buffer, factor):
    cloud, points, _ = measured("ouster", (SINCE_STAMP * factor).astype(int))
    with pytest.warns(
        UserWarning, match=r"^deskew: the field t \(ns after the stamp\) spans \S+ s in 4000 points, so "
    ):
        moved = deskew(cloud, buffer, "odom")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert deskew(cloud, buffer, "odom", time_unit=1e-9) == moved
        assert deskew(cloud, buffer, "odom", times=STAMP + points["t"].astype(int)) == moved
        for few_or_long in (SINCE_STAMP[:999] * factor, SINCE_STAMP * 0.011):
            deskew(measured("ouster", few_or_long.astype(int))[0], buffer, "odom")


@pytest.mark.parametrize(
    ("name", "kind", "numbers", "text"),
    [
        ("time", "f4", np.linspace(0, 1, 4000),
         "time is from 0 to 1, which may be seconds or fractions of a sweep: pass time_unit=1, or the "
         "duration of a sweep, for example time_unit=0.1"),
        ("time", "f4", np.random.default_rng(5).permutation(np.linspace(-1, 0, 4000)),
         "time is from -1 to 0, which may be seconds or fractions of a sweep: "),
        ("time", "f8", 1.7e18, "the cloud's stamp if the numbers are s after the stamp. If that is right, "),
        ("time", "f8", (STAMP + SINCE_STAMP) / S,
         "time is from 1700000000 to 1700000000, 1.7e+09 s after the cloud's stamp if the numbers are s "
         "after the stamp. If that is right, pass time_unit=1; otherwise the right unit, or times"),
        ("timestamp", "f8", SINCE_STAMP / S, "1.7e+09 s before the cloud's stamp if the numbers are s since"),
        ("timestamp", "f8", (STAMP + SINCE_STAMP) / 1e3, "before the cloud's stamp if the numbers are ns "),
    ],
)  # fmt: skip
def test_unlikely_times_are_asked_about(buffer, name, kind, numbers, text):
    """Fractions, or those of another clock or unit; with 'nan', no point would be left."""
    fields = [*XYZ, (name, kind, 12)]
    points = np.zeros(4000, dtype_of(fields, 20))
    points[name] = numbers
    for on_missing in ("raise", "nan"):
        with pytest.raises(ValueError) as error:
            deskew(as_cloud(points, fields), buffer, "odom", on_missing=on_missing)
        assert text in str(error.value)


def test_the_stamp_of_a_cloud_with_absolute_times_may_be_unset(buffer):
    cloud, points, times = measured("hesai")
    cloud.header.stamp.sec = cloud.header.stamp.nanosec = 0
    moved = deskew(cloud, buffer, "odom")
    assert_moved(moved, expected(buffer, xyz_of(points), times), xyz_of(points), points.dtype, OF_TIMES_M)


@pytest.mark.parametrize("unit", [np.float32(2.9e-9), Fraction(3, 2 * S), np.longdouble("1.5e-9"), 1 / 65536])
def test_no_unit_is_cut_off(buffer, unit):
    with pytest.raises(ValueError, match=r"time_unit: expected whole nanoseconds, got .* ns: pass times"):
        deskew(measured("ouster")[0], buffer, "odom", time_unit=unit)


def test_given_times_of_points_without_coordinates_are_not_waited_for(tf2_ros):
    cloud, points, times = measured("velodyne")
    points["x"][::2] = np.nan
    times[::2] += 100 * S
    filled, before = driving(make=tf2_ros.Buffer), times.copy()
    moved = deskew(as_cloud(points, DRIVERS["velodyne"][0]), filled, "odom", times=times, timeout=3600)
    assert np.array_equal(times, before)
    assert missing_in(moved, points.dtype) == list(range(0, 4000, 2))


@pytest.mark.parametrize("unit", [0, -1.0, 1e-10, float("-inf"), 3601, float("inf")])
def test_a_time_unit_is_from_1_ns_to_1_hour(buffer, unit):
    cloud, _, times = measured("ouster")
    with pytest.raises(ValueError, match="time_unit: expected 1e-9 to 3600 s, got "):
        deskew(cloud, buffer, "odom", time_unit=unit)
    with pytest.raises(TypeError, match="^pass times or time_unit, .* but not both$"):
        deskew(cloud, buffer, "odom", times=times, time_unit=1)


def test_integers_cannot_be_nan(buffer):
    fields = [("x", "f4", 0), ("y", "u2", 4), ("z", "f4", 6), ("time", "f4", 10)]
    points = np.ones(40, dtype_of(fields, 14))
    points["time"] = 0.05
    with pytest.raises(ValueError, match="^on_missing: 'nan' needs .* floats, but y is uint16$"):
        deskew(as_cloud(points, fields), buffer, "odom", on_missing="nan")
    assert deskew(as_cloud(points, fields), buffer, "odom").is_dense


def test_a_cloud_without_times_names_its_fields_and_takes_them_as_an_argument(buffer):
    cloud, points, times = measured("velodyne")
    fields = [("stamp" if name == "time" else name, *rest) for name, *rest in DRIVERS["velodyne"][0]]
    cloud = as_cloud(points, fields)
    with pytest.raises(ValueError) as error:
        deskew(cloud, buffer, "odom")
    assert str(error.value) == (
        "no field with the times of the points: expected one of time (float32 or float64), t (uint32), "
        "offset_time (uint32), timestamp (float64), but the cloud has x (float32), y (float32), z (float32), "
        "intensity (float32), ring (uint16), stamp (float32). "
        "If one of the first three has another type, pass time_unit; if the times are elsewhere, pass times"
    )
    before = times.copy()
    for given in (times, times.tolist(), times.astype("M8[ns]")):
        moved = deskew(cloud, buffer, "odom", times=given)
        assert_moved(moved, expected(buffer, xyz_of(points), times), xyz_of(points), points.dtype)
    assert np.array_equal(times, before)
    moved = deskew(cloud, buffer, "lidar", "odom", times=times)
    assert np.array_equal(points_of(moved, points.dtype)["time"], points["time"])
    with pytest.raises(ValueError, match="expected one for each of 4000 points, got 3"):
        deskew(cloud, buffer, "odom", times=times[:3])


def test_a_field_of_a_known_name_but_another_type_is_not_one_of_times(buffer):
    fields = [*XYZ, ("t", "f4", 12)]
    cloud = as_cloud(np.zeros(10, dtype_of(fields, 16)), fields)
    with pytest.raises(ValueError, match=r"the cloud has .* t \(float32\)\. If one"):
        deskew(cloud, buffer, "odom")


# Arguments.


def moving_lidar():
    """A lidar that moves in odom itself, without a robot between them, and a camera that is fixed to it."""
    buffer = driving()
    for ns, x in ((START, 0), (STAMP, 1), (STAMP + S, 9)):
        buffer.set_transform(transform("odom", "other_lidar", ns=ns, xyz=(x, 0, 0)), "x")
    buffer.set_transform_static(transform("other_lidar", "camera"), "x")
    return buffer


@pytest.mark.parametrize(
    ("source", "frame"),
    [
        *(("lidar", frame) for frame in ("base", "lidar")),
        *(("other_lidar", frame) for frame in ("other_lidar", "camera")),
        *(("camera", frame) for frame in ("other_lidar", "camera")),
    ],
)
def test_a_frame_that_moves_with_the_sensor_is_refused(source, frame):
    """Also the cloud's own frame, which is what people try first."""
    buffer = moving_lidar()
    cloud, _, _ = measured("ouster")
    cloud.header.frame_id = source
    with pytest.raises(ValueError) as error:
        deskew(cloud, buffer, frame)
    where = "itself" if frame == source else f"[{frame}], which moves with it"
    assert str(error.value) == (
        f"[{source}] does not move in {where}: pass a fixed_frame, for example [odom]"
    )
    if frame != source:
        where = f"fixed_frame {where}"
    for target in ("odom", "base", frame):
        with pytest.raises(ValueError) as error:
            deskew(cloud, buffer, target, frame)
        assert str(error.value) == (
            f"[{source}] does not move in {where}: pass another fixed_frame, for example [odom]"
        )


def test_no_sensor_moves_in_its_own_frame():
    """Also in a tree whose root it is, as where a SLAM publishes the pose of odom in the sensor."""
    buffer = Buffer(Duration(seconds=100))
    for ns, x in ((START, 0), (STAMP, 1), (STAMP + S, 9)):
        buffer.set_transform(transform("lidar", "odom", ns=ns, xyz=(x, 0, 0)), "x")
    cloud, points, times = measured("ouster")
    for how in (("lidar",), ("odom", "lidar")):
        with pytest.raises(ValueError, match=r"\[lidar\] does not move in itself: pass a.* fixed_frame in"):
            deskew(cloud, buffer, *how)
    moved = deskew(cloud, buffer, "odom")
    assert_moved(moved, expected(buffer, xyz_of(points), times), xyz_of(points), points.dtype)


@pytest.mark.parametrize("loop", [("base", "lidar"), ("base", "mast", "lidar"), ("mast", "base")])
@pytest.mark.parametrize("frame", ["base", "lidar"])
def test_a_loop_of_static_transforms_is_named(loop, frame):
    looped = Buffer()
    for parent, child in zip(loop, (*loop[1:], loop[0]), strict=True):
        looped.set_transform_static(transform(parent, child), "x")
    looped.set_transform_static(transform(loop[0], "lidar"), "x")
    cloud, _, _ = measured("ouster")
    if frame == "lidar":
        with pytest.raises(LookupException, match="contains a loop"):
            deskew(cloud, looped, frame)
    with pytest.raises(LookupException, match="contains a loop"):
        deskew(cloud, looped, frame, "lidar")


@pytest.mark.parametrize("how", [("base",), ("base", "base")])
def test_a_loop_above_frames_that_do_not_move_leaves_the_points(how):
    """As a lookup does, which goes no further than the frame that both share."""
    looped = Buffer()
    for parent, child in (("base", "lidar"), ("map", "base"), ("base", "map")):
        looped.set_transform_static(transform(parent, child), "x")
    cloud, points, times = measured("ouster")
    moved = deskew(cloud, looped, *how)
    wanted = expected(looped, xyz_of(points), times, how[0])
    assert_moved(moved, wanted, xyz_of(points), points.dtype)


def test_a_sensor_that_never_moves_needs_none():
    still = Buffer()
    still.set_transform_static(transform("map", "lidar", xyz=(1, 2, 3)), "x")
    cloud, points, _ = measured("ouster")
    moved = points_of(deskew(cloud, still, "map"), points.dtype)
    assert xyz_of(moved) == pytest.approx(xyz_of(points) + (1, 2, 3), abs=1e-5)


def test_names_of_a_subclass_replace_no_methods_that_tf2_lacks():
    class Mine(Buffer):
        frames = _poses_between = None

    buffer = Mine(Duration(seconds=100))
    for ns in (START, STAMP + S):
        buffer.set_transform(transform("odom", "base", ns=ns), "x")
    buffer.set_transform_static(transform("base", "lidar", xyz=(1, 2, 3)), "x")
    cloud, points, _ = measured("ouster")
    with pytest.raises(ValueError, match=r"\[lidar\] does not move in \[base\]"):
        deskew(cloud, buffer, "base")
    moved = points_of(deskew(cloud, buffer, "odom"), points.dtype)
    assert xyz_of(moved) == pytest.approx(xyz_of(points) + (1, 2, 3), abs=1e-5)


def test_a_prefix_goes_before_the_frame_of_the_cloud(buffer):
    cloud, points, times = measured("ouster")
    wanted = deskew(cloud, buffer, "odom")
    cloud.header.frame_id = "dar"
    assert deskew(cloud, buffer, "odom", prefix="li") == wanted
    assert cloud.header.frame_id == "dar"


def test_the_target_time_may_be_the_latest(buffer):
    cloud, points, times = measured("ouster")
    newest = buffer.get_latest_common_time("lidar", "odom")
    moved = deskew(cloud, buffer, "lidar", "odom", 0)
    assert stamp_ns(moved) == newest.nanoseconds
    wanted = expected(buffer, xyz_of(points), times, "lidar", fixed_frame="odom", target_time=newest)
    assert_moved(moved, wanted, xyz_of(points), points.dtype)


def test_a_target_time_without_a_transform_is_named(buffer):
    cloud, _, _ = measured("ouster")
    with pytest.raises(ExtrapolationException, match=r"^target_time: Lookup .*Requested time 900\.0"):
        deskew(cloud, buffer, "lidar", "odom", at_ns(900 * S))


def test_only_the_field_that_was_read_has_the_new_time(buffer):
    cloud, points, times = measured("ouster")
    moved = deskew(cloud, buffer, "lidar", "odom", at_ns(STAMP + S // 20), times=times)
    assert (points_of(moved, points.dtype)["t"] == points["t"]).all()


def test_wrong_arguments_are_named(buffer):
    cloud, _, _ = measured("ouster")
    with pytest.raises(TypeError, match=r"buffer: expected a tf2_ros\.Buffer, got str"):
        deskew(cloud, "odom", buffer)
    with pytest.raises(TypeError, match=r"cloud: expected a sensor_msgs/PointCloud2, got TransformStamped"):
        deskew(transform("map", "odom", 1), buffer, "odom")
    with pytest.raises(TypeError, match="target_time needs a fixed_frame"):
        deskew(cloud, buffer, "odom", target_time=at_ns(STAMP))
    with pytest.raises(LookupException, match=r"odometry.*Did you mean \[odom\]"):
        deskew(cloud, buffer, "odometry")
    for wrong in (5, b"odom"):
        for how in ({}, {"target_time": 0}):
            with pytest.raises(TypeError, match="^fixed_frame: expected a str, got "):
                deskew(cloud, buffer, "base", fixed_frame=wrong, **how)
    with pytest.raises(InvalidArgumentException):
        deskew(cloud, buffer, "lidar", fixed_frame="")
    with pytest.raises(ValueError, match="on_missing"):
        deskew(cloud, buffer, "odom", on_missing="skip")
    with pytest.raises(TypeError, match=r"^deskew\(\) got .* 'tolerence'\. Did you mean 'tolerance'\?$"):
        deskew(cloud, buffer, "odom", tolerence=1)
    with pytest.raises(ValueError, match=r"^max_age .* for points, use tolerance$"):
        deskew(cloud, buffer, "base", "odom", 0, max_age=1)
    with pytest.raises(TypeError, match=r"timeout: only a tf2_ros\.Buffer can wait, not a BufferCore"):
        deskew(cloud, driving(make=BufferCore), "odom", timeout=1)
    cloud.data = cloud.data[:100]
    with pytest.raises(ValueError, match="data has 100 bytes"):
        deskew(cloud, buffer, "odom")


def test_the_bytes_after_the_points_of_each_row_stay(buffer):
    cloud, _, _ = measured("ouster", rows=4)
    used, before = cloud.row_step, cloud.data.tobytes()
    moved = deskew(cloud, buffer, "odom").data.tobytes()
    for seed in range(5):  # new memory may have the bytes of the last one
        padding = np.random.default_rng(seed).bytes(7 * cloud.height)

        def padded(rows, padding=padding):
            return b"".join(rows[i * used :][:used] + padding[7 * i :][:7] for i in range(cloud.height))

        cloud.row_step, cloud.data = used + 7, array.array("B", padded(before))
        got = deskew(cloud, buffer, "odom")
        assert (got.row_step, got.data.tobytes()) == (used + 7, padded(moved))


def test_what_lacks_a_part_of_a_cloud_is_refused_as_by_do_transform_cloud(buffer):
    cloud, _, _ = measured("ouster")
    parts = {name: getattr(cloud, name) for name in cloud.get_fields_and_field_types()}
    assert deskew(SimpleNamespace(**parts), buffer, "odom") == deskew(cloud, buffer, "odom")
    wrong = [{name: one for name, one in parts.items() if name != lacking} for lacking in parts]
    wrong += [
        parts | {"header": 5},
        parts | {"fields": [5]},
        parts | {"height": None},
        parts | {"width": 1.5},
    ]
    for one in wrong:
        for call in (lambda cloud: do_transform_cloud(cloud, transform("odom", "lidar")),
                     lambda cloud: deskew(cloud, buffer, "odom", on_missing="nan")):  # fmt: skip
            with pytest.raises(TypeError, match="expected a"):
                call(SimpleNamespace(**one))
    with pytest.raises(ValueError, match="^width = -1 is out of the range"):
        deskew(SimpleNamespace(**parts | {"width": -1}), buffer, "odom")


def test_each_argument_of_the_table_is_taken(buffer):
    cloud, _, _ = measured("ouster")
    given = dict.fromkeys(LookupPolicy.__annotations__)
    assert deskew(cloud, buffer, "odom", **given) == deskew(cloud, buffer, "odom")


# The policy of lookups applies to all of them.


def sampled_at(*offsets_ns):
    """A buffer whose lidar moves in odom at 1 m/s, with samples at these times after the stamp."""
    buffer = Buffer(Duration(seconds=100))
    for ns in offsets_ns:
        buffer.set_transform(transform("odom", "lidar", ns=STAMP + ns, xyz=(ns / S, 0, 0)), "x")
    return buffer


@pytest.mark.parametrize("frames", [("odom",), ("lidar", "odom", at_ns(STAMP))])
def test_no_pose_is_interpolated_across_a_gap_that_is_too_long(frames):
    gap = SWEEP // 4, SWEEP // 2  # after the stamp
    buffer = sampled_at(*(10_000_000 * i for i in range(11) if not gap[0] < 10_000_000 * i < gap[1]))
    cloud, points, times = measured("ouster")
    with pytest.raises(ExtrapolationException, match=r"^points\[\d+\], t = .* max_gap, 0.020000000 s$"):
        deskew(cloud, buffer, *frames, max_gap=0.02)
    moved = deskew(cloud, buffer, *frames, max_gap=0.02, on_missing="nan")
    inside_gap = (STAMP + 20_000_000 < times) & (times < STAMP + gap[1])
    assert missing_in(moved, points.dtype) == np.flatnonzero(inside_gap).tolist()
    assert missing_in(deskew(cloud, buffer, *frames), points.dtype) == []


@pytest.mark.parametrize("frames", [("odom",), ("lidar", "odom", at_ns(STAMP))])
def test_the_last_point_is_waited_for_under_the_policy(frames, monkeypatch):
    """Otherwise, a tolerance that accepts older data would not spare the wait for newer data."""
    buffer, waits = sampled_at(0, SWEEP // 2), []
    for name in ("lookup_transform", "lookup_transform_full"):
        monkeypatch.setattr(buffer, name, lambda *given, **policy: waits.append((given[-1], policy)))
    deskew(measured("ouster")[0], buffer, *frames, timeout=DEADLINE_S, tolerance=1.0)
    [(timeout_s, policy)] = waits
    assert 0 < timeout_s <= DEADLINE_S and policy == {"tolerance": 1.0}


def test_the_target_time_is_not_blamed_if_the_policy_accepts_it():
    buffer, target_time = sampled_at(0, SWEEP), at_ns(STAMP + 2 * SWEEP)
    cloud, _, _ = measured("ouster", np.array([0, SWEEP // 2, 9 * SWEEP]))
    with pytest.raises(ExtrapolationException, match=r"^points\[2\], t = .*; tolerance allows 0\.2"):
        deskew(cloud, buffer, "lidar", "odom", target_time, tolerance=0.2)
    with pytest.raises(ExtrapolationException, match="^target_time: "):
        deskew(cloud, buffer, "lidar", "odom", target_time)


# Bytes that change meanwhile.


@pytest.mark.filterwarnings("ignore:deskew. the field .* hardly any motion is corrected:UserWarning")
@pytest.mark.parametrize("driver", ["velodyne", "ouster", "hesai"])
def test_bytes_that_change_meanwhile_do_no_harm(buffer, driver):
    """Another thread owns the memory of the cloud, and fills it with anything."""
    cloud, points, _ = measured(driver, np.linspace(0, SWEEP, 20_000).astype(np.int64))
    cloud._data = bytearray(cloud.data)
    shared = memoryview(cloud._data)
    noise = [np.random.default_rng(i).bytes(len(shared)) for i in range(3)]
    noise += [bytes(shared), b"\xff" * len(shared)]
    stop = threading.Event()

    def change():
        while not stop.is_set():
            for one in noise:
                shared[:] = one

    thread = threading.Thread(target=change)
    thread.start()
    try:
        for _ in range(60):
            try:
                moved = deskew(cloud, buffer, "odom", on_missing="nan")
            except ValueError as error:
                assert " is from " in str(error)
            else:
                assert len(moved.data) == len(shared)
    finally:
        stop.set()
        thread.join()


def test_data_that_shrinks_during_the_wait_is_refused(monkeypatch):
    cloud, buffer = measured("ouster")[0], sampled_at(0, SWEEP)
    monkeypatch.setattr(buffer, "lookup_transform", lambda *_: cloud.data.pop())
    with pytest.raises(ValueError, match="^data had 192000 bytes when deskew began, but now has 191999$"):
        deskew(cloud, buffer, "odom", timeout=DEADLINE_S)


def test_an_error_that_is_kept_does_not_keep_the_memory_of_the_cloud():
    cloud, _, _ = measured("ouster")
    with mmap.mmap(-1, len(cloud.data)) as shared:
        shared[:], cloud._data = cloud.data, shared
        with pytest.raises(ExtrapolationException) as error:
            deskew(cloud, sampled_at(0, 1), "odom")
    assert shared.closed and str(error.value).startswith("points[1], t = ")


# How it is done.


def test_few_poses_are_looked_up_for_many_points(buffer, monkeypatch):
    found, steady_poses = [], inside._steady_poses
    monkeypatch.setattr(inside, "_steady_poses", lambda *how: found.append(steady_poses(*how)) or found[-1])
    cloud, _, _ = measured("ouster", np.linspace(0, SWEEP, 100_000).astype(np.int64))
    deskew(cloud, buffer, "odom")
    [poses] = found
    assert 0 < len(poses.matrices) < 1000


@pytest.mark.parametrize("on_missing", ["raise", "nan"])
def test_a_timeout_does_not_change_what_is_missing(on_missing):
    """At the time of the last point, the lidar is in another tree."""
    buffer = Buffer()
    for i in range(5):
        parent = "odom" if i < 2 else "other"
        buffer.set_transform(transform(parent, "lidar", ns=STAMP + i * SWEEP, xyz=(i, 0, 0)), "x")
    buffer.set_transform_static(transform("map", "odom"), "x")
    cloud, points, _ = measured("ouster", np.array([0, SWEEP // 2, 5 * SWEEP // 2, 3 * SWEEP]))
    for timeout in (0, 0.1):
        if on_missing == "nan":
            moved = deskew(cloud, buffer, "odom", on_missing="nan", timeout=timeout)
            assert missing_in(moved, points.dtype) == [2, 3]
        else:
            with pytest.raises(TransformException, match=r"^points\[2\], t = "):
                deskew(cloud, buffer, "odom", timeout=timeout)


def test_the_latest_common_time_is_waited_for(tf2_ros):
    """The first transforms arrive during the call."""
    buffer, cloud = tf2_ros.Buffer(Duration(seconds=100)), measured("ouster")[0]
    both = [transform("odom", "lidar", ns=STAMP + ns, xyz=(ns / S, 0, 0)) for ns in (0, SWEEP)]

    def fill():
        until(lambda: buffer.statistics()["waiters"])
        buffer.set_transforms(both, "x")

    thread = threading.Thread(target=fill)
    thread.start()
    moved = deskew(cloud, buffer, "lidar", "odom", 0, timeout=DEADLINE_S)
    thread.join()
    assert moved == deskew(cloud, buffer, "lidar", "odom", at_ns(STAMP + SWEEP))


def test_the_timeout_is_that_of_the_whole_call(monkeypatch):
    """Both for the target time and for the last point."""
    cloud, _, _ = measured("ouster")
    buffer, waits = Buffer(), []
    for ns in (0, SWEEP // 2):
        buffer.set_transform(transform("odom", "lidar", ns=STAMP + ns, xyz=(ns, 0, 0)), "x")

    def looked_up(*arguments, **_):
        waits.append(arguments[-1])
        until = inside.time.monotonic_ns() + 10_000_000
        while inside.time.monotonic_ns() < until:
            pass
        raise ExtrapolationException

    monkeypatch.setattr(buffer, "lookup_transform", looked_up)
    monkeypatch.setattr(buffer, "lookup_transform_full", looked_up)
    deskew(cloud, buffer, "lidar", "odom", 0, on_missing="nan", timeout=100)
    first, second = waits
    assert second <= first - 0.01 <= 100


def test_rows_without_points_take_no_time(buffer):
    """A message of 200 bytes can claim 2**32 of them: with a pass over each, this would take minutes."""
    cloud, *_ = measured("velodyne")
    cloud.height, cloud.width, cloud.row_step, cloud.data = 2**32 - 1, 0, 0, array.array("B")
    for _ in range(100):
        moved = deskew(cloud, buffer, "odom")
    assert (moved.height, moved.width, len(moved.data)) == (2**32 - 1, 0, 0)
